#include "wheels.h"

#include "numbers.h"
#include "period.h"
#include "robot.h"

#define STALL_TARGET_M_S 0.03f
/* Maximum measured speed of a standing wheel. It is less than one count per period. */
#define REST_M_S 0.005f
/* Minimum target speed of a wheel: a tenth of the resolution of a velocity setpoint. A smaller
 * target is a rounding error of zero. */
#define MIN_TARGET_M_S 1e-5f
/* Maximum gap between samples that is integrated. */
#define SINCE_MAX_S 0.05f
#define STALLED_MAX 60000u
/* In the safe state the duty decreases linearly. It is 0 this number of periods after the end of
 * the speed ramp. wheels.h promises 10 periods (0.1 s); two are for the first period and for
 * rounding. */
#define RELEASE_PERIODS 8.0f

static float towards(float value, float wanted, float step)
{
    if (wanted > value + step) {
        return value + step;
    }
    return wanted > value - step ? wanted : value - step;
}

static void measure(wheel_t *wheel, uint16_t count, float metres_per_count, float since_s)
{
    if (since_s > 0.0f) {
        const float moved_m =
            (float)wrapped16((uint16_t)(count - wheel->count)) * metres_per_count;
        /* One count per period is 13 mm/s, a coarse step, so average two periods. */
        wheel->speed_m_s += 0.5f * (moved_m / since_s - wheel->speed_m_s);
    }
    wheel->count = count;
}

/* Measure both speeds from a sample and its own time, because a period may have no new sample or a
 * late sample. Return the time between this sample and the last one, for the integrators. */
static float measure_both(wheels_t *wheels, const board_encoders_t *counts)
{
    const bool first = !wheels->counted;
    const uint32_t since_us = first ? 0u : counts->sampled_us - wheels->sampled_us;
    const float since_s = (float)since_us * 1e-6f;
    if (first || since_us != 0) {
        wheels->counted = true;
        wheels->sampled_us = counts->sampled_us;
        measure(&wheels->left, counts->left, wheels->left_metres_per_count, since_s);
        measure(&wheels->right, counts->right, wheels->right_metres_per_count, since_s);
    }
    return first ? PERIOD_S : smaller(since_s, SINCE_MAX_S);
}

static void release_wheel(wheel_t *wheel)
{
    wheel->integral = 0.0f;
    wheel->stalled = 0;
}

static float control(wheel_t *wheel, float target_m_s, float scale, float since_s)
{
    const float speed = wheel->speed_m_s;
    const float far = absolute(target_m_s);
    float base = ROBOT_FEED_FORWARD * target_m_s;
    if (target_m_s > MIN_TARGET_M_S) {
        base += ROBOT_FRICTION;
    } else if (target_m_s < -MIN_TARGET_M_S) {
        base -= ROBOT_FRICTION;
    } else if (absolute(speed) < REST_M_S) {
        release_wheel(wheel);
        return 0.0f;
    }
    if (far > STALL_TARGET_M_S && absolute(speed) < 0.1f * far) {
        if (wheel->stalled < STALLED_MAX) {
            wheel->stalled++;
        }
    } else {
        wheel->stalled = 0;
    }
    const float error = target_m_s - speed;
    wheel->integral = clamped(
        wheel->integral + ROBOT_INTEGRAL_PER_S * since_s * error, ROBOT_INTEGRAL_LIMIT);
    return clamped((base + wheel->integral + ROBOT_PROPORTIONAL * error) * scale, 1.0f);
}

void wheels_start(
    wheels_t *wheels, float metres_per_count, float wheel_ratio, float wheel_base_m)
{
    const wheels_t at_rest = {0};
    *wheels = at_rest;
    wheels->periods = 1.0f;
    wheels->left_metres_per_count = metres_per_count * 2.0f / (1.0f + wheel_ratio);
    wheels->right_metres_per_count = metres_per_count * 2.0f * wheel_ratio / (1.0f + wheel_ratio);
    wheels->half_base_m = 0.5f * wheel_base_m;
}

void wheels_limit(
    wheels_t *wheels, float speed_m_s, float yaw_rate_rad_s, float deceleration_m_s2)
{
    wheels->v_max_m_s = speed_m_s;
    wheels->yaw_rate_max_rad_s = yaw_rate_rad_s;
    wheels->v_step_m_s = deceleration_m_s2 * PERIOD_S;
}

duties_t wheels_step(wheels_t *wheels, float v_m_s, float yaw_rate_rad_s,
    const board_encoders_t *counts, float supply_v)
{
    const float v_step = wheels->v_step_m_s * wheels->periods;
    const float yaw_step = v_step / wheels->half_base_m;
    const float scale = ROBOT_NOMINAL_V / larger(supply_v, ROBOT_LEAST_V);
    wheels->v_m_s =
        towards(wheels->v_m_s, clamped(v_m_s, wheels->v_max_m_s), v_step);
    wheels->yaw_rate_rad_s = towards(wheels->yaw_rate_rad_s,
        clamped(yaw_rate_rad_s, wheels->yaw_rate_max_rad_s), yaw_step);
    const float turn = wheels->half_base_m * wheels->yaw_rate_rad_s;
    const float since_s = measure_both(wheels, counts);
    const duties_t duties = {
        control(&wheels->left, wheels->v_m_s - turn, scale, since_s),
        control(&wheels->right, wheels->v_m_s + turn, scale, since_s),
    };
    wheels->left.duty = duties.left;
    wheels->right.duty = duties.right;
    wheels->released = false;
    return duties;
}

void wheels_coast(wheels_t *wheels, const board_encoders_t *counts, duties_t duties)
{
    (void)measure_both(wheels, counts);
    release_wheel(&wheels->left);
    release_wheel(&wheels->right);
    wheels->left.duty = duties.left;
    wheels->right.duty = duties.right;
    wheels->v_m_s = 0.0f;
    wheels->yaw_rate_rad_s = 0.0f;
    wheels->released = false;
}

/* Return a reduced duty in the safe state; `target_m_s` is the wheel's last ramp value. */
static float falling_duty(const wheels_t *wheels, wheel_t *wheel, float target_m_s)
{
    if (!wheels->released) {
        const float periods = absolute(target_m_s) / wheels->v_step_m_s + RELEASE_PERIODS;
        wheel->fall = absolute(wheel->duty) / periods;
    }
    release_wheel(wheel);
    wheel->duty = towards(wheel->duty, 0.0f, wheel->fall * wheels->periods);
    return wheel->duty;
}

duties_t wheels_release(wheels_t *wheels, const board_encoders_t *counts)
{
    const float turn = wheels->half_base_m * wheels->yaw_rate_rad_s;
    (void)measure_both(wheels, counts);
    const duties_t duties = {
        falling_duty(wheels, &wheels->left, wheels->v_m_s - turn),
        falling_duty(wheels, &wheels->right, wheels->v_m_s + turn),
    };
    const float v_step = wheels->v_step_m_s * wheels->periods;
    wheels->v_m_s = towards(wheels->v_m_s, 0.0f, v_step);
    wheels->yaw_rate_rad_s = towards(wheels->yaw_rate_rad_s, 0.0f, v_step / wheels->half_base_m);
    wheels->released = true;
    return duties;
}

float wheels_yaw_rate_rad_s(const wheels_t *wheels)
{
    return (wheels->right.speed_m_s - wheels->left.speed_m_s) * 0.5f / wheels->half_base_m;
}

bool wheels_moving(const wheels_t *wheels)
{
    return absolute(wheels->left.speed_m_s) >= REST_M_S
        || absolute(wheels->right.speed_m_s) >= REST_M_S;
}

uint16_t wheels_stalled(const wheels_t *wheels)
{
    return wheels->left.stalled > wheels->right.stalled ? wheels->left.stalled
                                                        : wheels->right.stalled;
}
