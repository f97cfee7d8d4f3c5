/* Wheel speed control from encoder counts: ramp, feed-forward and PI, once a control period. */
#ifndef WHEELS_H
#define WHEELS_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"

/* One wheel: its measured speed and its speed control. */
typedef struct {
    float speed_m_s;
    float integral;
    float duty;       /* of the last period */
    float fall;       /* decrease of the duty per period in the safe state */
    uint16_t stalled; /* periods for which it was driven without turning */
    uint16_t count;
} wheel_t;

typedef struct {
    float left;
    float right;
} duties_t;

/* Both wheels, which follow a body velocity within the acceleration limit. */
typedef struct {
    wheel_t left;
    wheel_t right;
    bool counted;  /* there is an earlier sample */
    bool released; /* the last period was one of the safe state */
    uint32_t sampled_us;
    float left_metres_per_count;
    float right_metres_per_count;
    float half_base_m;
    float v_m_s; /* ramped */
    float yaw_rate_rad_s;
    float v_max_m_s;
    float yaw_rate_max_rad_s;
    float v_step_m_s; /* per period */
} wheels_t;

/* Start at rest; values that affect geometry do not change during this boot. */
void wheels_start(
    wheels_t *wheels, float metres_per_count, float wheel_ratio, float wheel_base_m);

/* Use these limits from now on. */
void wheels_limit(
    wheels_t *wheels, float speed_m_s, float yaw_rate_rad_s, float deceleration_m_s2);

/* Run one period: take counts, return duties; exactly 0 for a wheel that should rest and does. */
duties_t wheels_step(wheels_t *wheels, float v_m_s, float yaw_rate_rad_s,
    const board_encoders_t *counts, float supply_v);

/* Count one period in which other code sets the duties. */
void wheels_coast(wheels_t *wheels, const board_encoders_t *counts, duties_t duties);

/* Run one period of the safe state: duties only fall, whatever the encoders report. They reach 0 at
 * most 0.1 s after the ramp would be at rest. The next wheels_step() starts with zero integrators.
 */
duties_t wheels_release(wheels_t *wheels, const board_encoders_t *counts);

/* Return the yaw rate by the wheels, counter-clockwise. */
float wheels_yaw_rate_rad_s(const wheels_t *wheels);

/* Return whether a wheel turns by its counts. */
bool wheels_moving(const wheels_t *wheels);

/* Return the number of periods for which a driven wheel has not turned: the longer one. */
uint16_t wheels_stalled(const wheels_t *wheels);

#endif
