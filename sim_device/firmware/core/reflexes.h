/* The device's own reaction to a cliff and to a pressed bumper, whatever speed is requested. At a
 * cliff the robot may reverse and turn, but not go ahead. With a bumper pressed it only creeps.
 * Neither reaction latches a stop; a robot that insists on a cliff does: see reflexes_over(). */
#ifndef REFLEXES_H
#define REFLEXES_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"

typedef struct {
    bool at_cliff; /* enabled reflexes, by parameter */
    bool at_bumper;
    bool over;      /* the floor has ended, and the robot is still there */
    uint8_t shown;  /* periods for which a limit stays visible */
    uint16_t ticks; /* periods over a cliff with forward speed requested */
    board_encoders_t counts;
    int32_t ahead; /* counts of both wheels since the floor ended */
} reflexes_t;

/* Return the allowed forward speed, once per control period in which the robot may drive; contacts
 * are SP_CONTACT_*. */
float reflexes_limit(
    reflexes_t *reflexes, float v_m_s, uint8_t contacts, const board_encoders_t *counts);

/* Count a period without own motion. */
void reflexes_rest(reflexes_t *reflexes);

/* Return whether the robot insists on the cliff: for 1 s, or 5 cm further ahead. */
bool reflexes_over(const reflexes_t *reflexes, float metres_per_count);

/* Return whether a speed was limited recently. */
static inline bool reflexes_limited(const reflexes_t *reflexes)
{
    return reflexes->shown != 0;
}

#endif
