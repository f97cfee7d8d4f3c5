/* The firmware's checks of its own hardware: a fault is what the readings contradict.
 *
 * bit           set                                                    cleared
 * imu           at rest a rate above 20 deg/s or a gravity off by      readings that agree
 *               0.3 g, for 0.3 s; or repeated registers
 * encoder       a driven wheel without counts for 1 s whose motor      its count
 *               draws no stall current
 * encoder_left_reversed and so on: counts against the duty (signs.h)   counts that agree
 * ultrasonic    two blows ahead that it did not see; or an unchanged   a blow that it saw, a range
 *               range over 0.4 m                                       that changes
 * infrared      an unchanged range while turning by 60 deg in place    a range that changes
 * motor_stall   a driven wheel that has not turned for 1 s and draws   it turns or rests
 *               current
 * battery_low   below the parameter battery_low                        above it
 * lifted        no floor ahead after a jolt upwards or down            the floor is back
 * bumper        a switch pressed for 10 s with nothing near and no     the switch opens
 *               stall
 *
 * setpoint_expired is the setpoint watchdog's (control.c).
 */
#ifndef HEALTH_H
#define HEALTH_H

#include <stdbool.h>
#include <stdint.h>

#include "readings.h"
#include "signs.h"
#include "wheels.h"

/* What a jolt is told by: a mean over 80 ms, compared with one over 1.3 s. */
#define JOLT_MEAN_TICKS 8u
#define GRAVITY_TICKS 128u

typedef struct {
    uint16_t bits; /* SP_FAULT_* */
    bool battery_empty;
    uint8_t empty_readings;
    uint16_t left_ma;
    uint16_t right_ma;

    board_imu_t imu; /* of the period before */
    bool imu_known;
    uint16_t ticks; /* these four stop at a bound beyond all that they are compared with */
    uint16_t repeats;
    uint16_t rest_ticks;
    uint16_t jolt_ticks;
    uint16_t longest_repeat;
    uint16_t disagrees;
    uint16_t strange;
    int16_t up[JOLT_MEAN_TICKS]; /* the last readings along z */
    uint8_t up_place;
    uint8_t gravity_ticks;
    int32_t up_sum;       /* of `up` */
    int32_t gravity_sum;  /* over the last whole stretch of GRAVITY_TICKS ... */
    int32_t gravity_next; /* ... and over the present one so far */
    signs_t signs;

    board_encoders_t counts;
    board_encoders_t range_counts; /* as the ranges were last looked at */
    uint8_t pressed[2]; /* readings for which a switch was held by nothing else that is felt */
    bool touched;
    uint8_t blows;
    uint16_t sonar_mm; /* last one that differed */
    float unseen_m;
    uint16_t side_dmm[2];
    float side_rad[2];
} health_t;

void health_start(health_t *health);

/* One control period, after the wheels were controlled; duties as the board is given them. */
void health_tick(health_t *health, const readings_t *readings, const wheels_t *wheels,
    int16_t left_duty, int16_t right_duty);

/* Take a reading of the supply, five a second. */
void health_power(health_t *health, const board_power_t *power, float low_v, float empty_v);

/* Take a reading of rangers and contacts. */
void health_around(
    health_t *health, const around_t *around, float wheel_base_m, float metres_per_count);

/* What must not be driven with, in words; NULL where nothing stands against it. */
const char *health_stopping(const health_t *health);

/* Whether a motor has stood under current for longer than is good for it. */
bool health_burning(const wheels_t *wheels);

#endif
