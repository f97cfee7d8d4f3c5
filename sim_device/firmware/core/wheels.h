/* Wheel speed control from encoder counts: ramp, feed-forward and PI, once a control period. */
#ifndef WHEELS_H
#define WHEELS_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"

/* One wheel: measures its speed, holds the speed wanted. */
typedef struct {
    float speed_m_s;
    float integral;
    float duty;       /* of the last period */
    float fall;       /* what the duty loses in a period of the safe state */
    uint16_t stalled; /* periods for which it has been driven and has not turned */
    uint16_t count;
} wheel_t;

typedef struct {
    float left;
    float right;
} duties_t;

/* Both, following a body velocity within the acceleration limit. */
typedef struct {
    wheel_t left;
    wheel_t right;
    bool counted;  /* there is a sample before */
    bool released; /* the last period was one of the safe state */
    uint32_t sampled_us;
    float left_metres_per_count;
    float right_metres_per_count;
    float half_base_m;
    float v_m_s; /* ramped */
    float yaw_rate_rad_s;
    float v_max_m_s;
    float yaw_rate_max_rad_s;
    float v_step_m_s; /* in a period */
} wheels_t;

/* At rest; what has a bearing on geometry stays as it is for this boot. */
void wheels_start(
    wheels_t *wheels, float metres_per_count, float wheel_ratio, float wheel_base_m);

/* Keep to these limits from now on. */
void wheels_limit(
    wheels_t *wheels, float speed_m_s, float yaw_rate_rad_s, float deceleration_m_s2);

/* One period: counts in, duties out, exactly 0 for a wheel that should rest and does. */
duties_t wheels_step(wheels_t *wheels, float v_m_s, float yaw_rate_rad_s,
    const board_encoders_t *counts, float supply_v);

/* One period in which somebody else gives the duties. */
void wheels_coast(wheels_t *wheels, const board_encoders_t *counts, duties_t duties);

/* One period of the safe state: duties only fall, whatever the encoders say, to 0 within 0.1 s of
 * when the ramp would be at rest. The next wheels_step() starts from zero integrators. */
duties_t wheels_release(wheels_t *wheels, const board_encoders_t *counts);

/* As the wheels turn, counter-clockwise. */
float wheels_yaw_rate_rad_s(const wheels_t *wheels);

/* Whether a wheel is measured to turn. */
bool wheels_moving(const wheels_t *wheels);

/* Periods for which a driven wheel has not turned: the longer one. */
uint16_t wheels_stalled(const wheels_t *wheels);

#endif
