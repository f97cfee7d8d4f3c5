#include "driver.h"

#include "robot.h"
#include "sweepctl_protocol.h"

#define STEP_MAX_S 0.1f      /* s; a longer gap (a pause) is not integrated */
#define BRAKE_SHARE 0.75f    /* share of the acceleration limit; the rest is for control */
#define LAG_S 0.10f          /* time from a command to the wheels' response */
#define CREEP_M_S 0.025f     /* a contact at this speed does not count as a collision */
#define LOOKAHEAD_M 0.25f    /* lane keeping steers to the point this far ahead on the line */
#define TURN_RATE_SHARE 0.75f /* share of the yaw rate limit; the rest is for control */
#define MIN_TURN_RAD_S 0.10f /* below this rate the wheels may stall */
#define HEADING_TOLERANCE_RAD 0.004f
#define POINT_TOLERANCE_M 0.006f
#define LOWPASS 0.6f /* factor of the velocity smoothing, per step */
#define REST_M_S 0.01f
#define REST_RAD_S 0.03f
#define SETTLE_S 0.6f /* maximum time from the stop of a leg to its end, even if not at rest */
#define STALL_S 1.5f
#define STALL_M 0.003f
#define STALL_RAD 0.02f
#define TURN_TIMEOUT_S 15.0f
#define DRIVE_TIMEOUT_S 600.0f
#define TURN_IN_PLACE_RAD (PI_F / 4.0f) /* above this bearing, turn in place to the point first */

#define ROTARY_KP 5.0f
#define ROTARY_TD_S 0.03f
#define DISTANCE_KP 1.5f
#define DISTANCE_TD_S 0.02f
#define BEARING_KP 4.0f
#define BEARING_TD_S 0.03f

#define BRAKE_M_S2 (BRAKE_SHARE * ROBOT_MAX_ACCEL_M_S2)
#define BRAKE_RAD_S2 (0.5f * ROBOT_MAX_YAW_ACCEL_RAD_S2)

static const velocity_t HALT = {0.0f, 0.0f};

void driver_start(driver_t *driver, const model_t *model)
{
    const driver_t at_rest = {0};
    *driver = at_rest;
    driver->cruise_m_s = model->cruise_speed_m_s;
    driver->max_m_s = model->max_speed_m_s;
    driver->turn_rate_rad_s = TURN_RATE_SHARE * model->max_yaw_rate_rad_s;
}

void driver_halt(driver_t *driver)
{
    driver->smooth = HALT;
}

/* ---- controllers ---------------------------------------------------------------------------- */

/* The paper's PD (section 3.3, eq. 1) with limited output; the first sample has no derivative. */
static float proportional_derivative(
    memory_t *memory, float error, float kp, float td_s, float limit, float dt_s)
{
    float output = kp * error;
    if (dt_s > 0.0f && memory->known) {
        output += kp * td_s * (error - memory->error) / dt_s;
    }
    memory->known = true;
    memory->error = error;
    return clamped(output, limit);
}

/* Yaw rate that turns to a heading, limited so that the robot can stop at the heading. */
static float turn_rate(driver_t *driver, float target_rad, float heading_rad, float dt_s)
{
    const float error = wrapped(target_rad - heading_rad);
    const float rate = proportional_derivative(&driver->heading_error, error, ROTARY_KP,
        ROTARY_TD_S, driver->turn_rate_rad_s, dt_s);
    return clamped(rate, sqrtf(2.0f * BRAKE_RAD_S2 * absolute(error)));
}

/* Low-pass, then an acceleration limit (paper, section 3.3, part 5). */
static float smoothed(float last, float target, float max_accel, float dt_s)
{
    return dt_s > 0.0f ? last + clamped(LOWPASS * (target - last), max_accel * dt_s) : last;
}

static velocity_t send(driver_t *driver, float v_m_s, float yaw_rate_rad_s, float dt_s)
{
    velocity_t *const last = &driver->smooth;
    last->v_m_s = smoothed(last->v_m_s, v_m_s, ROBOT_MAX_ACCEL_M_S2, dt_s);
    last->yaw_rate_rad_s =
        smoothed(last->yaw_rate_rad_s, yaw_rate_rad_s, ROBOT_MAX_YAW_ACCEL_RAD_S2, dt_s);
    return *last;
}

/* Maximum speed from which the robot stops within a distance, with lag: from d = v t + v^2/2a. */
static float brake_speed(float remaining_m)
{
    const float push = BRAKE_M_S2 * LAG_S;
    const float speed =
        sqrtf(push * push + 2.0f * BRAKE_M_S2 * larger(remaining_m, 0.0f)) - push;
    return larger(speed, CREEP_M_S);
}

/* Distance that the robot still covers after a zero command: half of the lag times the speed. */
static float run_out_m(const observation_t *seen)
{
    return 0.5f * LAG_S * absolute(seen->v_m_s);
}

/* Maximum speed from which the robot stops at the stop range; 0 when the range is reached. */
static float approach(driver_t *driver, const observation_t *seen, float dt_s)
{
    if (driver->leg.stop_range_m <= 0.0f) {
        return driver->speed_m_s;
    }
    range_ahead_update(&driver->ahead, seen->ultrasonic_mm, seen->v_m_s * dt_s, dt_s);
    if (!driver->ahead.known) {
        return driver->speed_m_s;
    }
    const float remaining_m = driver->ahead.range_m - driver->leg.stop_range_m;
    if (remaining_m <= run_out_m(seen)) {
        return 0.0f;
    }
    return smaller(driver->speed_m_s, brake_speed(remaining_m));
}

/* ---- ends of legs --------------------------------------------------------------------------- */

static leg_end_t hit(const observation_t *seen)
{
    if (seen->contacts & SP_CONTACT_CLIFF) {
        return END_CLIFF;
    }
    return seen->contacts ? END_BUMPER : END_NONE;
}

static bool stalled(driver_t *driver, float progress, float least)
{
    if (absolute(progress - driver->mark) > least) {
        driver->mark = progress;
        driver->mark_s = driver->elapsed_s;
        return false;
    }
    return driver->elapsed_s - driver->mark_s > STALL_S;
}

static velocity_t stop(driver_t *driver, leg_end_t reason, float dt_s)
{
    driver->stopping = reason;
    driver->stopped_s = 0.0f;
    if (reason == END_BUMPER || reason == END_CLIFF) {
        driver_halt(driver);
        return HALT;
    }
    return send(driver, 0.0f, 0.0f, dt_s);
}

/* Ramp down to zero. The leg ends at rest, when its distance and pose are final. */
static velocity_t settle(driver_t *driver, const observation_t *seen, float dt_s)
{
    driver->stopped_s += dt_s;
    velocity_t command = send(driver, 0.0f, 0.0f, dt_s);
    const bool quiet =
        absolute(command.v_m_s) < REST_M_S && absolute(command.yaw_rate_rad_s) < REST_RAD_S;
    if (quiet) {
        driver_halt(driver);
        command = HALT;
    }
    const bool rests =
        absolute(seen->v_m_s) < REST_M_S && absolute(seen->yaw_rate_rad_s) < REST_RAD_S;
    if ((quiet && rests) || driver->stopped_s > SETTLE_S) {
        driver->result.reason = driver->stopping;
        driver->result.distance_m = driver->along_m;
        driver->result.pose = seen->pose;
    }
    return command;
}

/* ---- kinds of leg --------------------------------------------------------------------------- */

static velocity_t turn(driver_t *driver, const observation_t *seen, float dt_s)
{
    const float target_rad = driver->leg.heading_rad;
    const float heading_rad = seen->pose.heading_rad;
    const float error = wrapped(target_rad - heading_rad);
    const float run_out_rad = 0.5f * LAG_S * absolute(seen->yaw_rate_rad_s);
    if (absolute(error) < HEADING_TOLERANCE_RAD + run_out_rad) {
        return stop(driver, END_DONE, dt_s);
    }
    if (stalled(driver, heading_rad, STALL_RAD)) {
        return stop(driver, END_STALLED, dt_s);
    }
    float rate = turn_rate(driver, target_rad, heading_rad, dt_s);
    if (absolute(rate) < MIN_TURN_RAD_S) {
        rate = copysignf(MIN_TURN_RAD_S, error);
    }
    return send(driver, 0.0f, rate, dt_s);
}

static velocity_t drive(driver_t *driver, const observation_t *seen, float dt_s)
{
    const leg_t *const leg = &driver->leg;
    const float direction = driver->backward ? -1.0f : 1.0f;
    float speed = driver->speed_m_s;
    if (!driver->backward) {
        const leg_end_t contact = hit(seen);
        if (contact != END_NONE) {
            return stop(driver, contact, dt_s);
        }
        speed = approach(driver, seen, dt_s);
        if (speed <= 0.0f) {
            return stop(driver, END_RANGE, dt_s);
        }
    }
    if (leg->bounded) {
        const float remaining_m = (leg->distance_m - driver->along_m) * direction;
        if (remaining_m <= run_out_m(seen)) {
            return stop(driver, END_DISTANCE, dt_s);
        }
        speed = smaller(speed, brake_speed(remaining_m));
    }
    if (stalled(driver, driver->along_m, STALL_M)) {
        return stop(driver, END_STALLED, dt_s);
    }
    const float across_m = (seen->pose.y_m - driver->origin.y_m) * driver->cos_heading
        - (seen->pose.x_m - driver->origin.x_m) * driver->sin_heading;
    const float aim_rad = leg->heading_rad - direction * atan2f(across_m, LOOKAHEAD_M);
    const float rate = turn_rate(driver, aim_rad, seen->pose.heading_rad, dt_s);
    const float off_rad = wrapped(leg->heading_rad - seen->pose.heading_rad);
    return send(driver, direction * speed * larger(cosf(off_rad), 0.0f), rate, dt_s);
}

/* PD on distance and bearing (paper, section 3.3, part 4). */
static velocity_t go_to(driver_t *driver, const observation_t *seen, float dt_s)
{
    const leg_end_t contact = hit(seen);
    if (contact != END_NONE) {
        return stop(driver, contact, dt_s);
    }
    const float dx_m = driver->leg.x_m - seen->pose.x_m;
    const float dy_m = driver->leg.y_m - seen->pose.y_m;
    const float left_m = hypotf(dx_m, dy_m);
    const float bearing =
        left_m > 0.0f ? wrapped(atan2f(dy_m, dx_m) - seen->pose.heading_rad) : 0.0f;
    float speed = proportional_derivative(
        &driver->distance_error, left_m, DISTANCE_KP, DISTANCE_TD_S, driver->max_m_s, dt_s);
    float rate = proportional_derivative(&driver->bearing_error, bearing, BEARING_KP,
        BEARING_TD_S, driver->turn_rate_rad_s, dt_s);
    const bool near = left_m < 5.0f * POINT_TOLERANCE_M;
    if (left_m < POINT_TOLERANCE_M || (near && absolute(bearing) > 0.5f * PI_F)) {
        return stop(driver, END_DONE, dt_s);
    }
    speed = absolute(bearing) > TURN_IN_PLACE_RAD ? 0.0f : speed * cosf(bearing);
    if (speed <= 0.0f) {
        range_ahead_reset(&driver->ahead); /* the turn changes which obstacle is ahead */
        speed = 0.0f;
        if (absolute(rate) < MIN_TURN_RAD_S) {
            rate = copysignf(MIN_TURN_RAD_S, bearing);
        }
    } else {
        const float most = approach(driver, seen, dt_s);
        if (most <= 0.0f) {
            return stop(driver, END_RANGE, dt_s);
        }
        speed = smaller(smaller(larger(speed, CREEP_M_S), most), brake_speed(left_m));
    }
    if (stalled(driver, driver->along_m + seen->pose.heading_rad, STALL_M)) {
        return stop(driver, END_STALLED, dt_s);
    }
    return send(driver, speed, rate, dt_s);
}

static velocity_t rest(driver_t *driver, float dt_s)
{
    if (driver->elapsed_s >= driver->leg.duration_s) {
        return stop(driver, END_DONE, dt_s);
    }
    return send(driver, 0.0f, 0.0f, dt_s);
}

/* ---- running -------------------------------------------------------------------------------- */

/* Compute line, speed and timeout of a drive leg. */
static void lay_out(driver_t *driver, const observation_t *seen)
{
    const leg_t *const leg = &driver->leg;
    float heading_rad = leg->heading_rad;
    float length_m = leg->distance_m;
    bool bounded = leg->bounded;
    if (leg->kind == LEG_GO_TO) {
        heading_rad = atan2f(leg->y_m - seen->pose.y_m, leg->x_m - seen->pose.x_m);
        length_m = hypotf(leg->x_m - seen->pose.x_m, leg->y_m - seen->pose.y_m);
        bounded = true;
    }
    driver->speed_m_s = smaller(
        leg->speed_m_s > 0.0f ? leg->speed_m_s : driver->cruise_m_s, driver->max_m_s);
    driver->cos_heading = cosf(heading_rad);
    driver->sin_heading = sinf(heading_rad);
    driver->backward = bounded && length_m < 0.0f;
    driver->timeout_s =
        bounded ? 5.0f + 2.0f * absolute(length_m) / driver->speed_m_s : DRIVE_TIMEOUT_S;
}

void driver_begin(driver_t *driver, const leg_t *leg, const observation_t *seen)
{
    driver->leg = *leg;
    driver->result.reason = END_NONE;
    driver->stopping = END_NONE;
    driver->elapsed_s = 0.0f;
    driver->stopped_s = 0.0f;
    driver->last_us = seen->now_us;
    driver->origin = seen->pose;
    driver->along_m = 0.0f;
    driver->mark = 0.0f;
    driver->mark_s = 0.0f;
    driver->heading_error.known = false;
    driver->distance_error.known = false;
    driver->bearing_error.known = false;
    range_ahead_reset(&driver->ahead);
    driver->backward = false;
    if (leg->kind == LEG_TURN) {
        driver->timeout_s = TURN_TIMEOUT_S;
    } else if (leg->kind == LEG_REST) {
        driver->timeout_s = leg->duration_s + TURN_TIMEOUT_S; /* a safety limit only; this leg ends
                                                                 by itself */
    } else {
        lay_out(driver, seen);
    }
}

velocity_t driver_step(driver_t *driver, const observation_t *seen)
{
    if (driver->leg.kind == LEG_NONE || driver->result.reason != END_NONE) {
        return HALT;
    }
    const float since_s = (float)(seen->now_us - driver->last_us) * 1e-6f;
    const float dt_s = smaller(larger(since_s, 0.0f), STEP_MAX_S);
    driver->last_us = seen->now_us;
    driver->elapsed_s += dt_s;
    if (driver->leg.kind == LEG_DRIVE || driver->leg.kind == LEG_GO_TO) {
        driver->along_m = (seen->pose.x_m - driver->origin.x_m) * driver->cos_heading
            + (seen->pose.y_m - driver->origin.y_m) * driver->sin_heading;
    }
    if (driver->stopping != END_NONE) {
        return settle(driver, seen, dt_s);
    }
    if (driver->elapsed_s > driver->timeout_s) {
        return stop(driver, END_TIMEOUT, dt_s);
    }
    switch (driver->leg.kind) {
    case LEG_TURN:
        return turn(driver, seen, dt_s);
    case LEG_DRIVE:
        return drive(driver, seen, dt_s);
    case LEG_GO_TO:
        return go_to(driver, seen, dt_s);
    case LEG_REST:
        return rest(driver, dt_s);
    case LEG_NONE:
        break;
    }
    return HALT;
}
