/* What the device does by itself at a cliff and with a bumper pressed, whoever asks for speed: at a
 * cliff the robot may reverse and turn, and no more go ahead; with a bumper pressed it creeps.
 * Neither latches a stop; a robot that would go on over a cliff does: reflexes_over(). */
#ifndef REFLEXES_H
#define REFLEXES_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"

typedef struct {
    bool at_cliff; /* which are on, by parameter */
    bool at_bumper;
    bool over;      /* the floor has ended, and the robot has yet to leave the place */
    uint8_t shown;  /* periods for which a limit stays visible */
    uint16_t ticks; /* periods over a cliff in which speed ahead was asked for */
    board_encoders_t counts;
    int32_t ahead; /* counts of both wheels since the floor ended */
} reflexes_t;

/* The forward speed that is allowed, once a control period in which the robot may drive; contacts
 * are SP_CONTACT_*. */
float reflexes_limit(
    reflexes_t *reflexes, float v_m_s, uint8_t contacts, const board_encoders_t *counts);

/* A period in which nothing drives by itself. */
void reflexes_rest(reflexes_t *reflexes);

/* Whether the robot would go on over a cliff: asked to for 1 s, or 5 cm further ahead. */
bool reflexes_over(const reflexes_t *reflexes, float metres_per_count);

/* Whether a speed was held back lately. */
static inline bool reflexes_limited(const reflexes_t *reflexes)
{
    return reflexes->shown != 0;
}

#endif
