/* Readings of the board in this control period: each sensor is read at most once. */
#ifndef READINGS_H
#define READINGS_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"
#include "parameters.h"

/* Ranges and contacts, sampled together. */
typedef struct {
    board_ranges_t ranges;
    uint8_t contacts; /* SP_CONTACT_* */
} around_t;

/* Calibration of one ranger: range = scale · raw + offset. */
typedef struct {
    float scale;
    float offset_m;
} correction_t;

typedef struct {
    board_t *board;
    /* Inputs of parts that are not connected float, so they are not used. */
    uint8_t connected_contacts; /* SP_CONTACT_* */
    bool has_ultrasonic, has_infrared;
    correction_t ultrasonic, infrared_left, infrared_right;
    bool begun;          /* `zero` is valid */
    board_encoders_t zero;
    board_encoders_t counts; /* since boot */
    board_imu_t imu;
    bool contacts_known;
    uint8_t contacts;
    bool around_known;
    around_t around;
} readings_t;

/* Initialise for a board, with the rangers' calibration at this boot. */
void readings_start(readings_t *readings, board_t *board, const parameters_t *parameters);

/* Start a period: read counts and IMU. */
void readings_begin(readings_t *readings);

/* Return SP_CONTACT_* in this period: both bumper switches and the cliff sensor. */
uint8_t readings_contacts(readings_t *readings);

/* Return rangers, bumpers and cliff in this period, read at the first call. */
const around_t *readings_around(readings_t *readings);

/* Return whether a range is present. */
static inline bool seen(uint16_t range)
{
    return range != BOARD_NO_RANGE;
}

#endif
