/* Check that each encoder counts in the direction of its motor, and on its own side.
 *
 * A wheel that counts against its duty has a reversed encoder or motor. Swapped encoders look
 * correct while the robot drives straight. In a turn each wheel then seems to count against its
 * duty, because the other wheel turns the other way. Two reversed encoders look the same in a turn
 * on the spot: the firmware then reports swapped ones. The host's bring-up turns one wheel at a
 * time and distinguishes the two faults. */
#ifndef SIGNS_H
#define SIGNS_H

#include <stdbool.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

#define SIGNS_FAULTS                                                                        \
    (SP_FAULT_ENCODER_LEFT_REVERSED | SP_FAULT_ENCODER_RIGHT_REVERSED                       \
        | SP_FAULT_ENCODERS_SWAPPED)

/* Numbers of consecutive periods in which one wheel's counts agree or disagree with its duty. */
typedef struct {
    uint8_t against;
    uint8_t agrees;
    uint8_t own;     /* agrees, and the other wheel is not driven the same way */
    uint8_t crossed; /* it stands, and the other one turns instead */
    bool was_ahead;  /* the sign of its duty */
} side_t;

typedef struct {
    uint16_t bits; /* SP_FAULT_* */
    side_t left;
    side_t right;
} signs_t;

typedef struct {
    int16_t duty; /* in units of BOARD_DUTY_ONE */
    float speed_m_s;
} pull_t;

/* Take duties and measured speeds of one control period. */
void signs_tick(signs_t *signs, pull_t left, pull_t right);

#endif
