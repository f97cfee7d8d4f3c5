/* What was read from the board in this control period: each sensor once at most. */
#ifndef READINGS_H
#define READINGS_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"
#include "parameters.h"

/* Distances and contacts, sampled together. */
typedef struct {
    board_ranges_t ranges;
    uint8_t contacts; /* SP_CONTACT_* */
} around_t;

/* A calibration of one ranger: scale · raw + offset. */
typedef struct {
    float scale;
    float offset_m;
} correction_t;

typedef struct {
    board_t *board;
    correction_t ultrasonic, infrared_left, infrared_right;
    bool begun;          /* `zero` is known */
    board_encoders_t zero;
    board_encoders_t counts; /* since boot */
    board_imu_t imu;
    bool contacts_known;
    uint8_t contacts;
    bool around_known;
    around_t around;
} readings_t;

/* Read from this board, with the rangers' calibration as it is for this boot. */
void readings_start(readings_t *readings, board_t *board, const parameters_t *parameters);

/* Start a period: counts and IMU are read in each. */
void readings_begin(readings_t *readings);

/* SP_CONTACT_* in this period: both bumper halves and the cliff sensor. */
uint8_t readings_contacts(readings_t *readings);

/* Rangers, bumpers and cliff in this period, read when they are first asked for. */
const around_t *readings_around(readings_t *readings);

/* Whether a range was seen. */
static inline bool seen(uint16_t range)
{
    return range != BOARD_NO_RANGE;
}

#endif
