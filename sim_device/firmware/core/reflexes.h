/* The device's reflexes at a cliff and at a pressed bumper: they limit any requested speed. At a
 * cliff the robot may reverse and turn, but not drive forward. With a pressed bumper the robot
 * drives slowly. These reflexes do not latch a stop. But a stop is latched if the robot stays over
 * a cliff: see reflexes_over(). */
#ifndef REFLEXES_H
#define REFLEXES_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"

typedef struct {
    bool at_cliff; /* true if the reflex is enabled, as set by its parameter */
    bool at_bumper;
    bool over;      /* a cliff was detected, and the robot is still there */
    uint8_t shown;  /* remaining periods for which a limit stays reported */
    uint16_t ticks; /* number of periods over a cliff with a forward command */
    board_encoders_t counts;
    int32_t ahead; /* sum of both wheels' counts since the cliff was detected */
} reflexes_t;

/* Return the allowed forward speed, once per control period in which the robot may drive; contacts
 * are SP_CONTACT_*. */
float reflexes_limit(
    reflexes_t *reflexes, float v_m_s, uint8_t contacts, const board_encoders_t *counts);

/* Count a control period without a motion command. */
void reflexes_rest(reflexes_t *reflexes);

/* Return whether a stop must latch: 1 s of forward commands over a cliff, or 5 cm beyond the
 * edge. */
bool reflexes_over(const reflexes_t *reflexes, float metres_per_count);

/* Return whether a speed was limited recently. */
static inline bool reflexes_limited(const reflexes_t *reflexes)
{
    return reflexes->shown != 0;
}

#endif
