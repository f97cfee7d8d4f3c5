#include "wheels.h"

#include "numbers.h"
#include "period.h"
#include "robot.h"

#define STALL_TARGET_M_S 0.03f
/* Below one count a period: a wheel that is measured slower than this stands. */
#define REST_M_S 0.005f
/* A tenth of the wire's step: what is slower is the rounding of a wheel that should rest. */
#define LEAST_TARGET_M_S 1e-5f
#define STALLED_MAX 60000u

static float towards(float value, float wanted, float step)
{
    if (wanted > value + step) {
        return value + step;
    }
    return wanted > value - step ? wanted : value - step;
}

static void measure(wheel_t *wheel, uint16_t count, float speed_per_count)
{
    if (wheel->counted) {
        const int16_t moved = wrapped16((uint16_t)(count - wheel->count));
        /* One count a period is 13 mm/s: average two periods. */
        wheel->speed_m_s += 0.5f * ((float)moved * speed_per_count - wheel->speed_m_s);
    }
    wheel->counted = true;
    wheel->count = count;
}

static void let_go(wheel_t *wheel)
{
    wheel->integral = 0.0f;
    wheel->stalled = 0;
}

static float control(wheel_t *wheel, float target_m_s, float scale)
{
    const float speed = wheel->speed_m_s;
    const float far = absolute(target_m_s);
    float base = ROBOT_FEED_FORWARD * target_m_s;
    if (target_m_s > LEAST_TARGET_M_S) {
        base += ROBOT_FRICTION;
    } else if (target_m_s < -LEAST_TARGET_M_S) {
        base -= ROBOT_FRICTION;
    } else if (absolute(speed) < REST_M_S) {
        let_go(wheel);
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
        wheel->integral + ROBOT_INTEGRAL_PER_S * PERIOD_S * error, ROBOT_INTEGRAL_LIMIT);
    return clamped((base + wheel->integral + ROBOT_PROPORTIONAL * error) * scale, 1.0f);
}

void wheels_start(
    wheels_t *wheels, float metres_per_count, float wheel_ratio, float wheel_base_m)
{
    const wheels_t at_rest = {0};
    *wheels = at_rest;
    const float mean = metres_per_count / PERIOD_S;
    wheels->left_speed_per_count = mean * 2.0f / (1.0f + wheel_ratio);
    wheels->right_speed_per_count = mean * 2.0f * wheel_ratio / (1.0f + wheel_ratio);
    wheels->half_base_m = 0.5f * wheel_base_m;
}

void wheels_limit(
    wheels_t *wheels, float speed_m_s, float yaw_rate_rad_s, float deceleration_m_s2)
{
    wheels->v_max_m_s = speed_m_s;
    wheels->yaw_rate_max_rad_s = yaw_rate_rad_s;
    wheels->v_step_m_s = deceleration_m_s2 * PERIOD_S;
}

duties_t wheels_step(wheels_t *wheels, float v_m_s, float yaw_rate_rad_s, uint16_t left_count,
    uint16_t right_count, float supply_v)
{
    const float yaw_step = wheels->v_step_m_s / wheels->half_base_m;
    const float scale = ROBOT_NOMINAL_V / larger(supply_v, ROBOT_LEAST_V);
    wheels->v_m_s =
        towards(wheels->v_m_s, clamped(v_m_s, wheels->v_max_m_s), wheels->v_step_m_s);
    wheels->yaw_rate_rad_s = towards(wheels->yaw_rate_rad_s,
        clamped(yaw_rate_rad_s, wheels->yaw_rate_max_rad_s), yaw_step);
    const float turn = wheels->half_base_m * wheels->yaw_rate_rad_s;
    measure(&wheels->left, left_count, wheels->left_speed_per_count);
    measure(&wheels->right, right_count, wheels->right_speed_per_count);
    const duties_t duties = {
        control(&wheels->left, wheels->v_m_s - turn, scale),
        control(&wheels->right, wheels->v_m_s + turn, scale),
    };
    return duties;
}

void wheels_coast(wheels_t *wheels, uint16_t left_count, uint16_t right_count)
{
    measure(&wheels->left, left_count, wheels->left_speed_per_count);
    measure(&wheels->right, right_count, wheels->right_speed_per_count);
    let_go(&wheels->left);
    let_go(&wheels->right);
    wheels->v_m_s = 0.0f;
    wheels->yaw_rate_rad_s = 0.0f;
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
