/* Detects reversed and swapped encoders: compares each wheel's counts with its motor's duty.
 *
 * If a wheel counts against its duty, its encoder or motor is reversed. Swapped encoders (left and
 * right exchanged) look correct while the robot drives straight. In a turn in place the wheels turn
 * in opposite directions, so with swapped encoders both wheels count against their duties. Two
 * reversed encoders give the same counts in a turn in place. The firmware reports both cases as
 * swapped encoders. The host's bring-up turns one wheel at a time, so it can distinguish these
 * faults. */
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
    uint8_t own;     /* counts agree, and the other wheel is not driven in the same direction */
    uint8_t crossed; /* the wheel stands, and the other wheel turns instead */
    bool was_ahead;  /* true if its duty is positive */
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

/* Process duties and measured speeds of one control period. */
void signs_tick(signs_t *signs, pull_t left, pull_t right);

#endif
