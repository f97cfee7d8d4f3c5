#include "leg_executor.h"

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
#define RAMP_S 0.6f /* maximum time from the stop of a leg to its end, even if not at rest */
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

void leg_executor_start(leg_executor_t *executor, const model_t *model)
{
    const leg_executor_t at_rest = {0};
    *executor = at_rest;
    executor->cruise_m_s = model->cruise_speed_m_s;
    executor->max_m_s = model->max_speed_m_s;
    executor->turn_rate_rad_s = TURN_RATE_SHARE * model->max_yaw_rate_rad_s;
}

void leg_executor_halt(leg_executor_t *executor)
{
    executor->smooth = HALT;
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
static float turn_rate(leg_executor_t *executor, float target_rad, float heading_rad, float dt_s)
{
    const float error = wrapped(target_rad - heading_rad);
    const float rate = proportional_derivative(&executor->heading_error, error, ROTARY_KP,
        ROTARY_TD_S, executor->turn_rate_rad_s, dt_s);
    return clamped(rate, sqrtf(2.0f * BRAKE_RAD_S2 * absolute(error)));
}

/* Low-pass, then an acceleration limit (paper, section 3.3, part 5). */
static float smoothed(float last, float target, float max_accel, float dt_s)
{
    return dt_s > 0.0f ? last + clamped(LOWPASS * (target - last), max_accel * dt_s) : last;
}

static velocity_t send(leg_executor_t *executor, float v_m_s, float yaw_rate_rad_s, float dt_s)
{
    velocity_t *const last = &executor->smooth;
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
static float approach(leg_executor_t *executor, const observation_t *seen, float dt_s)
{
    if (executor->leg.stop_range_m <= 0.0f) {
        return executor->speed_m_s;
    }
    range_ahead_update(&executor->ahead, seen->ultrasonic_mm, seen->v_m_s * dt_s, dt_s);
    if (!executor->ahead.known) {
        return executor->speed_m_s;
    }
    const float remaining_m = executor->ahead.range_m - executor->leg.stop_range_m;
    if (remaining_m <= run_out_m(seen)) {
        return 0.0f;
    }
    return smaller(executor->speed_m_s, brake_speed(remaining_m));
}

/* ---- ends of legs --------------------------------------------------------------------------- */

static leg_end_t hit(const observation_t *seen)
{
    if (seen->contacts & SP_CONTACT_CLIFF) {
        return END_CLIFF;
    }
    return seen->contacts ? END_BUMPER : END_NONE;
}

static bool stalled(leg_executor_t *executor, float progress, float least)
{
    if (absolute(progress - executor->mark) > least) {
        executor->mark = progress;
        executor->mark_s = executor->elapsed_s;
        return false;
    }
    return executor->elapsed_s - executor->mark_s > STALL_S;
}

static velocity_t stop(leg_executor_t *executor, leg_end_t reason, float dt_s)
{
    executor->stopping = reason;
    executor->stopped_s = 0.0f;
    if (reason == END_BUMPER || reason == END_CLIFF) {
        leg_executor_halt(executor);
        return HALT;
    }
    return send(executor, 0.0f, 0.0f, dt_s);
}

/* Ramp down to zero. The leg ends at rest, when its distance and pose are final. */
static velocity_t ramp_down(leg_executor_t *executor, const observation_t *seen, float dt_s)
{
    executor->stopped_s += dt_s;
    velocity_t command = send(executor, 0.0f, 0.0f, dt_s);
    const bool quiet =
        absolute(command.v_m_s) < REST_M_S && absolute(command.yaw_rate_rad_s) < REST_RAD_S;
    if (quiet) {
        leg_executor_halt(executor);
        command = HALT;
    }
    const bool rests =
        absolute(seen->v_m_s) < REST_M_S && absolute(seen->yaw_rate_rad_s) < REST_RAD_S;
    if ((quiet && rests) || executor->stopped_s > RAMP_S) {
        executor->result.reason = executor->stopping;
        executor->result.distance_m = executor->along_m;
        executor->result.pose = seen->pose;
    }
    return command;
}

/* ---- kinds of leg --------------------------------------------------------------------------- */

static velocity_t turn(leg_executor_t *executor, const observation_t *seen, float dt_s)
{
    const float target_rad = executor->leg.heading_rad;
    const float heading_rad = seen->pose.heading_rad;
    const float error = wrapped(target_rad - heading_rad);
    const float run_out_rad = 0.5f * LAG_S * absolute(seen->yaw_rate_rad_s);
    if (absolute(error) < HEADING_TOLERANCE_RAD + run_out_rad) {
        return stop(executor, END_DONE, dt_s);
    }
    if (stalled(executor, heading_rad, STALL_RAD)) {
        return stop(executor, END_STALLED, dt_s);
    }
    float rate = turn_rate(executor, target_rad, heading_rad, dt_s);
    if (absolute(rate) < MIN_TURN_RAD_S) {
        rate = copysignf(MIN_TURN_RAD_S, error);
    }
    return send(executor, 0.0f, rate, dt_s);
}

static velocity_t drive(leg_executor_t *executor, const observation_t *seen, float dt_s)
{
    const leg_t *const leg = &executor->leg;
    const float direction = executor->backward ? -1.0f : 1.0f;
    float speed = executor->speed_m_s;
    if (!executor->backward) {
        const leg_end_t contact = hit(seen);
        if (contact != END_NONE) {
            return stop(executor, contact, dt_s);
        }
        speed = approach(executor, seen, dt_s);
        if (speed <= 0.0f) {
            return stop(executor, END_RANGE, dt_s);
        }
    }
    if (leg->bounded) {
        const float remaining_m = (leg->distance_m - executor->along_m) * direction;
        if (remaining_m <= run_out_m(seen)) {
            return stop(executor, END_DISTANCE, dt_s);
        }
        speed = smaller(speed, brake_speed(remaining_m));
    }
    if (stalled(executor, executor->along_m, STALL_M)) {
        return stop(executor, END_STALLED, dt_s);
    }
    const float across_m = (seen->pose.y_m - executor->origin.y_m) * executor->cos_heading
        - (seen->pose.x_m - executor->origin.x_m) * executor->sin_heading;
    const float aim_rad = leg->heading_rad - direction * atan2f(across_m, LOOKAHEAD_M);
    const float rate = turn_rate(executor, aim_rad, seen->pose.heading_rad, dt_s);
    const float off_rad = wrapped(leg->heading_rad - seen->pose.heading_rad);
    return send(executor, direction * speed * larger(cosf(off_rad), 0.0f), rate, dt_s);
}

/* PD on distance and bearing (paper, section 3.3, part 4). */
static velocity_t go_to(leg_executor_t *executor, const observation_t *seen, float dt_s)
{
    const leg_end_t contact = hit(seen);
    if (contact != END_NONE) {
        return stop(executor, contact, dt_s);
    }
    const float dx_m = executor->leg.x_m - seen->pose.x_m;
    const float dy_m = executor->leg.y_m - seen->pose.y_m;
    const float left_m = hypotf(dx_m, dy_m);
    const float bearing =
        left_m > 0.0f ? wrapped(atan2f(dy_m, dx_m) - seen->pose.heading_rad) : 0.0f;
    float speed = proportional_derivative(
        &executor->distance_error, left_m, DISTANCE_KP, DISTANCE_TD_S, executor->max_m_s, dt_s);
    float rate = proportional_derivative(&executor->bearing_error, bearing, BEARING_KP,
        BEARING_TD_S, executor->turn_rate_rad_s, dt_s);
    const bool near = left_m < 5.0f * POINT_TOLERANCE_M;
    if (left_m < POINT_TOLERANCE_M || (near && absolute(bearing) > 0.5f * PI_F)) {
        return stop(executor, END_DONE, dt_s);
    }
    speed = absolute(bearing) > TURN_IN_PLACE_RAD ? 0.0f : speed * cosf(bearing);
    if (speed <= 0.0f) {
        range_ahead_reset(&executor->ahead); /* the turn changes which obstacle is ahead */
        speed = 0.0f;
        if (absolute(rate) < MIN_TURN_RAD_S) {
            rate = copysignf(MIN_TURN_RAD_S, bearing);
        }
    } else {
        const float most = approach(executor, seen, dt_s);
        if (most <= 0.0f) {
            return stop(executor, END_RANGE, dt_s);
        }
        speed = smaller(smaller(larger(speed, CREEP_M_S), most), brake_speed(left_m));
    }
    if (stalled(executor, executor->along_m + seen->pose.heading_rad, STALL_M)) {
        return stop(executor, END_STALLED, dt_s);
    }
    return send(executor, speed, rate, dt_s);
}

static velocity_t rest(leg_executor_t *executor, float dt_s)
{
    if (executor->elapsed_s >= executor->leg.duration_s) {
        return stop(executor, END_DONE, dt_s);
    }
    return send(executor, 0.0f, 0.0f, dt_s);
}

/* ---- running -------------------------------------------------------------------------------- */

/* Compute line, speed and timeout of a drive leg. */
static void lay_out(leg_executor_t *executor, const observation_t *seen)
{
    const leg_t *const leg = &executor->leg;
    float heading_rad = leg->heading_rad;
    float length_m = leg->distance_m;
    bool bounded = leg->bounded;
    if (leg->kind == LEG_GO_TO) {
        heading_rad = atan2f(leg->y_m - seen->pose.y_m, leg->x_m - seen->pose.x_m);
        length_m = hypotf(leg->x_m - seen->pose.x_m, leg->y_m - seen->pose.y_m);
        bounded = true;
    }
    executor->speed_m_s = smaller(
        leg->speed_m_s > 0.0f ? leg->speed_m_s : executor->cruise_m_s, executor->max_m_s);
    executor->cos_heading = cosf(heading_rad);
    executor->sin_heading = sinf(heading_rad);
    executor->backward = bounded && length_m < 0.0f;
    executor->timeout_s =
        bounded ? 5.0f + 2.0f * absolute(length_m) / executor->speed_m_s : DRIVE_TIMEOUT_S;
}

void leg_executor_begin(leg_executor_t *executor, const leg_t *leg, const observation_t *seen)
{
    executor->leg = *leg;
    executor->result.reason = END_NONE;
    executor->stopping = END_NONE;
    executor->elapsed_s = 0.0f;
    executor->stopped_s = 0.0f;
    executor->last_us = seen->now_us;
    executor->origin = seen->pose;
    executor->along_m = 0.0f;
    executor->mark = 0.0f;
    executor->mark_s = 0.0f;
    executor->heading_error.known = false;
    executor->distance_error.known = false;
    executor->bearing_error.known = false;
    range_ahead_reset(&executor->ahead);
    executor->backward = false;
    if (leg->kind == LEG_TURN) {
        executor->timeout_s = TURN_TIMEOUT_S;
    } else if (leg->kind == LEG_REST) {
        /* a safety limit only; this leg ends by itself */
        executor->timeout_s = leg->duration_s + TURN_TIMEOUT_S;
    } else {
        lay_out(executor, seen);
    }
}

velocity_t leg_executor_step(leg_executor_t *executor, const observation_t *seen)
{
    if (executor->leg.kind == LEG_NONE || executor->result.reason != END_NONE) {
        return HALT;
    }
    const float since_s = (float)(seen->now_us - executor->last_us) * 1e-6f;
    const float dt_s = smaller(larger(since_s, 0.0f), STEP_MAX_S);
    executor->last_us = seen->now_us;
    executor->elapsed_s += dt_s;
    if (executor->leg.kind == LEG_DRIVE || executor->leg.kind == LEG_GO_TO) {
        executor->along_m = (seen->pose.x_m - executor->origin.x_m) * executor->cos_heading
            + (seen->pose.y_m - executor->origin.y_m) * executor->sin_heading;
    }
    if (executor->stopping != END_NONE) {
        return ramp_down(executor, seen, dt_s);
    }
    if (executor->elapsed_s > executor->timeout_s) {
        return stop(executor, END_TIMEOUT, dt_s);
    }
    switch (executor->leg.kind) {
    case LEG_TURN:
        return turn(executor, seen, dt_s);
    case LEG_DRIVE:
        return drive(executor, seen, dt_s);
    case LEG_GO_TO:
        return go_to(executor, seen, dt_s);
    case LEG_REST:
        return rest(executor, dt_s);
    case LEG_NONE:
        break;
    }
    return HALT;
}
