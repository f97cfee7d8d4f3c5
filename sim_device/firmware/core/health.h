/* The firmware's checks of its own hardware: a fault bit means that the readings contradict each
 * other.
 *
 * bit           set                                                    cleared
 * imu           at rest a rate above 20 deg/s or a gravity off by      readings that agree
 *               0.3 g, for 0.3 s; or repeated registers
 * encoder       a driven wheel without counts for 1 s whose motor      a count
 *               draws no stall current; or no new sample for 0.5 s
 * encoder_left_reversed and so on: counts against the duty (signs.h)   counts that agree
 * ultrasonic    two frontal contacts that it did not see; or an        a contact that it saw,
 *               unchanged range over 0.4 m                             a range that changes
 * infrared      an unchanged range while turning by 60 deg in place    a range that changes
 * motor_stall   a driven wheel that has not turned for 1 s and draws   it turns or is idle
 *               current
 * battery_low   below the parameter battery_low                        above it
 * lifted        no floor ahead after a jolt up or down                 the floor is back
 * bumper        a switch pressed for 10 s without a near obstacle      the switch opens
 *               or a stall
 *
 * The setpoint watchdog in control.c sets setpoint_expired.
 */
#ifndef HEALTH_H
#define HEALTH_H

#include <stdbool.h>
#include <stdint.h>

#include "readings.h"
#include "signs.h"
#include "wheels.h"

/* Number of samples in the mean acceleration for jolt detection (80 ms), and in the mean that is
 * used as gravity (1.3 s). */
#define JOLT_MEAN_TICKS 8u
#define GRAVITY_TICKS 128u

typedef struct {
    uint16_t bits; /* SP_FAULT_* */
    bool battery_empty;
    uint8_t empty_readings;
    uint16_t left_ma;
    uint16_t right_ma;

    board_imu_t imu; /* reading of the previous period */
    bool imu_known;
    uint16_t ticks; /* the next counters saturate above their limits */
    uint16_t repeats;
    uint16_t rest_ticks;
    uint16_t unsampled; /* periods without a new sample of the encoders */
    uint16_t jolt_ticks;
    uint16_t longest_repeat;
    uint16_t disagrees;
    uint16_t implausible;
    int16_t up[JOLT_MEAN_TICKS]; /* the last readings along z */
    uint8_t up_place;
    uint8_t gravity_ticks;
    int32_t up_sum;       /* sum of `up` */
    int32_t gravity_sum;  /* sum over the last complete run of GRAVITY_TICKS samples */
    int32_t gravity_next; /* sum over the present run so far */
    signs_t signs;

    board_encoders_t counts;
    board_encoders_t range_counts; /* counts at the last range reading */
    uint8_t pressed[2]; /* number of readings with a pressed switch and no other evidence of contact
                           */
    bool touched;
    uint8_t blows;
    uint16_t sonar_mm; /* last range that differed from its predecessor */
    float unseen_m;
    uint16_t side_dmm[2];
    float side_rad[2];
} health_t;

void health_start(health_t *health);

/* Check one control period, after the wheel control; the duties are those sent to the board. */
void health_tick(health_t *health, const readings_t *readings, const wheels_t *wheels,
    int16_t left_duty, int16_t right_duty);

/* Process a reading of the supply (5 Hz). */
void health_power(health_t *health, const board_power_t *power, float low_v, float empty_v);

/* Process a reading of rangers and contacts. */
void health_around(health_t *health, const around_t *around, float wheel_base_m,
    float metres_per_count, bool has_ultrasonic);

/* Return a description of the fault that prevents driving; NULL without such a fault. */
const char *health_stopping(const health_t *health);

/* Return whether a motor has drawn its stall current for too long. */
bool health_burning(const wheels_t *wheels);

#endif
