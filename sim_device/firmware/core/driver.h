/* Drives one leg at a time: observations in, velocities out. */
#ifndef DRIVER_H
#define DRIVER_H

#include <stdbool.h>
#include <stdint.h>

#include "leg.h"
#include "model.h"
#include "range_ahead.h"

/* One step's view of the world: what the robot's own sensors tell. */
typedef struct {
    int64_t now_us;
    pose_t pose;
    float v_m_s;
    float yaw_rate_rad_s;
    uint16_t ultrasonic_mm; /* BOARD_NO_RANGE: no echo */
    uint8_t contacts;       /* SP_CONTACT_* */
} observation_t;

typedef struct {
    float v_m_s;
    float yaw_rate_rad_s;
} velocity_t;

/* The error of the step before, for a derivative. */
typedef struct {
    bool known;
    float error;
} memory_t;

typedef struct {
    float cruise_m_s;
    float max_m_s;
    float turn_rate_rad_s;

    leg_t leg;
    leg_result_t result; /* reason END_NONE: under way */
    leg_end_t stopping;  /* why it is being brought to rest */
    bool backward;
    float speed_m_s;
    float timeout_s;
    float elapsed_s;
    float stopped_s;
    int64_t last_us;
    pose_t origin;
    float cos_heading, sin_heading;
    float along_m;
    float mark; /* progress, last time that it was made */
    float mark_s;

    memory_t heading_error;
    memory_t distance_error;
    memory_t bearing_error;
    range_ahead_t ahead;
    velocity_t smooth; /* last output */
} driver_t;

/* At rest, with no leg. */
void driver_start(driver_t *driver, const model_t *model);

/* Begin a leg at the observed pose. */
void driver_begin(driver_t *driver, const leg_t *leg, const observation_t *seen);

/* The velocity to drive now; zero when there is nothing to do. The leg has ended once
 * driver->result.reason is there. A bumper or a cliff ends any forward leg at once with a halt that
 * is not ramped; it does not end a turn in place or a leg backwards, which are the ways out. */
velocity_t driver_step(driver_t *driver, const observation_t *seen);

/* The robot was stopped from outside: the next step ramps up from rest. */
void driver_halt(driver_t *driver);

#endif
