/* Whether each encoder counts the way its motor pulls, and on its own side.
 *
 * A wheel that counts against its duty has a reversed encoder, or motor. Swapped encoders agree while
 * the robot drives straight; in a turn each wheel seems to count against its duty, as the other one
 * turns the other way. Both reversed look the same in a turn on the spot: then it says swapped, and
 * the host's bring-up, which turns one wheel at a time, tells them apart. */
#ifndef SIGNS_H
#define SIGNS_H

#include <stdbool.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

#define SIGNS_FAULTS                                                                        \
    (SP_FAULT_ENCODER_LEFT_REVERSED | SP_FAULT_ENCODER_RIGHT_REVERSED                       \
        | SP_FAULT_ENCODERS_SWAPPED)

/* One wheel: for how many periods in a row its counts have said what. */
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
    int16_t duty; /* of BOARD_DUTY_ONE */
    float speed_m_s;
} pull_t;

/* One control period: duties, and speeds by the counts. */
void signs_tick(signs_t *signs, pull_t left, pull_t right);

#endif
