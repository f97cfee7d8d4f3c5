/* Wheel speed control from encoder counts: ramp, feed-forward and PI, once per control period. */
#ifndef WHEELS_H
#define WHEELS_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"

/* One wheel: its measured speed and its speed control. */
typedef struct {
    float speed_m_s;
    float integral;
    float duty;       /* duty in the last period */
    float fall;       /* decrease of the duty per period in the safe state */
    uint16_t stalled; /* number of periods for which it was driven without turning */
    uint16_t count;
} wheel_t;

typedef struct {
    float left;
    float right;
} duties_t;

/* Control of both wheels, so that the body follows a velocity within the acceleration limit. */
typedef struct {
    wheel_t left;
    wheel_t right;
    bool counted;  /* a sample has been measured */
    bool released; /* the last period was in the safe state */
    uint32_t sampled_us;
    float left_metres_per_count;
    float right_metres_per_count;
    float half_base_m;
    float v_m_s; /* ramped */
    float yaw_rate_rad_s;
    float v_max_m_s;
    float yaw_rate_max_rad_s;
    float v_step_m_s; /* per period */
    float periods;    /* since the last step: 1, and the missed ones */
} wheels_t;

/* Start at rest; values that affect geometry do not change during this boot. */
void wheels_start(
    wheels_t *wheels, float metres_per_count, float wheel_ratio, float wheel_base_m);

/* Set new limits. */
void wheels_limit(
    wheels_t *wheels, float speed_m_s, float yaw_rate_rad_s, float deceleration_m_s2);

/* Run one period with new encoder counts; return the duties. A duty is exactly 0 if the wheel's
 * target is rest and it rests. */
duties_t wheels_step(wheels_t *wheels, float v_m_s, float yaw_rate_rad_s,
    const board_encoders_t *counts, float supply_v);

/* Run one period in which other code sets the duties: only measure the wheel speeds. */
void wheels_coast(wheels_t *wheels, const board_encoders_t *counts, duties_t duties);

/* Run one period of the safe state: duties only decrease, for any encoder counts. They reach 0 at
 * most 0.1 s after the time at which the ramp would be at rest, also if periods are missed. The next
 * wheels_step() starts with zero integrators. */
duties_t wheels_release(wheels_t *wheels, const board_encoders_t *counts);

/* Return the yaw rate computed from the wheels, counter-clockwise. */
float wheels_yaw_rate_rad_s(const wheels_t *wheels);

/* Return whether a wheel turns, according to its counts. */
bool wheels_moving(const wheels_t *wheels);

/* Return the number of periods for which a driven wheel has not turned; the maximum of both
 * wheels. */
uint16_t wheels_stalled(const wheels_t *wheels);

#endif
