#include "control.h"

#include <stddef.h>

#include "names.h"
#include "numbers.h"
#include "robot.h"

#define V_STEP 0.0001f
#define YAW_STEP 0.0002f

void control_start(control_t *control, const parameters_t *parameters)
{
    control->state = STATE_STOPPED;
    control->latch.cause = SP_STOP_CAUSE_SESSION_END;
    control->power.battery_mv = (uint16_t)(ROBOT_BATTERY_V * 1000.0f);
    model_apply(&control->model, parameters);
    wheels_start(&control->wheels, control->model.metres_per_count, control->model.wheel_ratio,
        control->model.wheel_base_m);
    health_start(&control->health);
    control_apply(control, parameters);
}

void control_apply(control_t *control, const parameters_t *parameters)
{
    model_apply(&control->model, parameters);
    wheels_limit(&control->wheels, control->model.max_speed_m_s, control->model.max_yaw_rate_rad_s,
        parameters_value(parameters, PARAMETER_STOP_DECELERATION));
    control->reflexes.at_cliff = parameters_value(parameters, PARAMETER_CLIFF_REFLEX) != 0.0f;
    control->reflexes.at_bumper = parameters_value(parameters, PARAMETER_BUMPER_REFLEX) != 0.0f;
    control->battery_low_v = parameters_value(parameters, PARAMETER_BATTERY_LOW);
    control->battery_empty_v = parameters_value(parameters, PARAMETER_BATTERY_EMPTY);
}

/* ---- events --------------------------------------------------------------------------------- */

static void end_plan(control_t *control)
{
    const char *const reason = onboard_finish_reason(&control->plan);
    onboard_end(&control->plan);
    text_t *const line = log_begin(&control->log, SP_LOG_LEVEL_INFO);
    text_add(line, "planner paper ");
    if (reason == NULL) {
        text_add(line, "aborted");
    } else {
        text_add(line, "finished: ");
        text_add(line, reason);
    }
}

int control_fire(control_t *control, event_t event, unsigned holding)
{
    const state_t before = control->state;
    /* These events require a working IMU, because no host checks the heading. */
    const bool sets_off =
        event == EVENT_SET_ONBOARD || event == EVENT_START || event == EVENT_RESUME;
    if (health_stopping(&control->health) != NULL
        || (sets_off && (control->health.bits & SP_FAULT_IMU))) {
        holding |= GUARD_FAULT_HOLDS;
    }
    const outcome_t outcome = modes_fire(&control->state, event, holding);
    if (!outcome.went) {
        return outcome.rejected ? outcome.reason : -1;
    }
    if (event == EVENT_START) {
        control->planned = true;
        onboard_start(&control->plan, &control->model, control->now_us);
        log_add(&control->log, SP_LOG_LEVEL_INFO, "planner paper: at rest first, for the gyro");
    } else if (event == EVENT_PAUSE) {
        onboard_pause(&control->plan);
    } else if (event == EVENT_RESUME) {
        onboard_resume(&control->plan);
    } else if (modes_planning(before)) {
        end_plan(control);
    }
    watchdog_halt(&control->setpoints);
    watchdog_halt(&control->duties);
    return -1;
}

void control_stop(control_t *control, uint8_t cause, event_t event)
{
    (void)control_fire(control, event, 0);
    if (control->state != STATE_STOPPED
        || (event != EVENT_STOP && control->latch.cause != SP_STOP_CAUSE_NONE)) {
        return;
    }
    if (latch_set(&control->latch, cause)) {
        text_t *const line = log_begin(&control->log, SP_LOG_LEVEL_WARNING);
        text_add(line, "stop latched: ");
        text_add(line, name_of_cause(control->latch.cause));
    }
}

int control_clear(control_t *control, uint8_t cause)
{
    unsigned holding = 0;
    if (cause != control->latch.cause) {
        holding |= GUARD_OTHER_CAUSE;
    }
    if (cause == SP_STOP_CAUSE_HARDWARE && health_stopping(&control->health) != NULL) {
        holding |= GUARD_CAUSE_HOLDS;
    }
    const state_t was = control->state;
    const int reason = control_fire(control, EVENT_CLEAR, holding);
    if (reason < 0 && was == STATE_STOPPED && latch_clear(&control->latch, cause)) {
        text_t *const line = log_begin(&control->log, SP_LOG_LEVEL_INFO);
        text_add(line, "stop cleared: ");
        text_add(line, name_of_cause(cause));
    }
    return reason;
}

int control_start_planner(control_t *control, uint8_t number)
{
    const bool ours = number == SP_ONBOARD_PLANNER_PAPER;
    return control_fire(control, EVENT_START, ours ? 0u : GUARD_NO_PLANNER);
}

bool control_velocity(
    control_t *control, const sp_velocity_setpoint_t *wanted, int64_t extra, int64_t arrived_us)
{
    const setpoint_t setpoint = {
        wanted->v, wanted->yaw_rate, wanted->time_to_live, wanted->counter};
    return watchdog_offer(&control->setpoints, &setpoint, extra, arrived_us);
}

static int16_t capped(int16_t duty)
{
    if (duty > BRINGUP_DUTY_MAX) {
        return BRINGUP_DUTY_MAX;
    }
    return duty < -BRINGUP_DUTY_MAX ? -BRINGUP_DUTY_MAX : duty;
}

bool control_wheel_duty(
    control_t *control, const sp_wheel_duty_t *wanted, int64_t extra, int64_t arrived_us)
{
    const setpoint_t setpoint = {
        capped(wanted->left), capped(wanted->right), wanted->time_to_live, wanted->counter};
    return watchdog_offer(&control->duties, &setpoint, extra, arrived_us);
}

void control_forget_host(control_t *control)
{
    watchdog_reset(&control->setpoints);
    watchdog_reset(&control->duties);
}

/* ---- time ----------------------------------------------------------------------------------- */

static int16_t duty_steps(float duty)
{
    return (int16_t)sp_round(duty * BOARD_DUTY_ONE, -BOARD_DUTY_ONE, BOARD_DUTY_ONE);
}

static velocity_t run_plan(control_t *control, uint32_t tick, uint32_t ticks,
    readings_t *readings, const around_t *around)
{
    const velocity_t wanted = onboard_step(
        &control->plan, tick, ticks, control->now_us, readings, around, &control->log);
    if (onboard_finish_reason(&control->plan) != NULL) {
        (void)control_fire(control, EVENT_FINISHED, 0);
    }
    return wanted;
}

/* Return the duties that follow a velocity, limited by the reflexes. */
static duties_t follow(control_t *control, readings_t *readings, velocity_t wanted)
{
    const float v_m_s = reflexes_limit(&control->reflexes, wanted.v_m_s,
        readings_contacts(readings), &readings->counts);
    return wheels_step(&control->wheels, v_m_s, wanted.yaw_rate_rad_s, &readings->counts,
        (float)control->power.battery_mv / 1000.0f);
}

/* Return the duties for the present state and latch. */
static duties_t drive(control_t *control, uint32_t tick, uint32_t ticks, readings_t *readings,
    const around_t *around)
{
    if (control->latch.cause == SP_STOP_CAUSE_NONE) {
        if (control->state == STATE_VELOCITY
            && watchdog_left_us(&control->setpoints, control->now_us) != 0) {
            const velocity_t wanted = {(float)control->setpoints.first * V_STEP,
                (float)control->setpoints.second * YAW_STEP};
            return follow(control, readings, wanted);
        }
        if (control->state == STATE_BRINGUP) {
            const duties_t requested = {(float)control->duties.first / BOARD_DUTY_ONE,
                (float)control->duties.second / BOARD_DUTY_ONE};
            reflexes_rest(&control->reflexes);
            wheels_coast(&control->wheels, &readings->counts, requested);
            return requested;
        }
        if (modes_planning(control->state)) {
            return follow(control, readings, run_plan(control, tick, ticks, readings, around));
        }
    }
    reflexes_rest(&control->reflexes);
    return wheels_release(&control->wheels, &readings->counts);
}

static void log_faults(control_t *control, uint16_t bits)
{
    const uint16_t now = (uint16_t)(bits & ~control->logged_bits);
    const uint16_t gone = (uint16_t)(control->logged_bits & ~bits);
    control->logged_bits = bits;
    if (now != 0) {
        text_t *const line = log_begin(&control->log, SP_LOG_LEVEL_WARNING);
        text_add(line, "fault: ");
        add_fault_names(line, now);
    }
    if (gone != 0) {
        text_t *const line = log_begin(&control->log, SP_LOG_LEVEL_INFO);
        text_add(line, "fault gone: ");
        add_fault_names(line, gone);
    }
}

/* Stop any motion that is unsafe with the present faults. */
static void judge(control_t *control)
{
    const state_t before = control->state;
    const char *why = health_stopping(&control->health);
    if (why == NULL && reflexes_over(&control->reflexes, control->model.metres_per_count)) {
        why = "no floor ahead";
    }
    if (why == NULL && health_burning(&control->wheels)) {
        why = "motor stalled";
    }
    if (why == NULL && (control->health.bits & SP_FAULT_IMU) && modes_planning(before)) {
        why = "no heading";
    }
    if (why == NULL) {
        return;
    }
    control_stop(control, SP_STOP_CAUSE_HARDWARE, EVENT_FAULT);
    if (control->state != before) {
        text_t *const line = log_begin(&control->log, SP_LOG_LEVEL_ERROR);
        text_add(line, "stopped by itself: ");
        text_add(line, why);
    }
}

motors_t control_tick(control_t *control, uint32_t tick, uint32_t ticks, int64_t now_us,
    readings_t *readings, const around_t *around)
{
    const state_t state = control->state;
    control->now_us = now_us;
    control->wheels.periods = (float)ticks;
    watchdog_t *const watchdog =
        control->state == STATE_BRINGUP ? &control->duties : &control->setpoints;
    if (watchdog_expired(watchdog, now_us)) {
        control->expired = true;
    } else if (watchdog_left_us(watchdog, now_us) != 0) {
        control->expired = false;
    }
    const duties_t duties = drive(control, tick, ticks, readings, around);
    motors_t motors = {duty_steps(duties.left), duty_steps(duties.right), false};
    motor_drivers_switch(&control->drivers, state,
        motors.left == 0 && motors.right == 0 && !wheels_moving(&control->wheels));
    motors.drivers = control->drivers.enabled;
    health_tick(&control->health, readings, &control->wheels, motors.left, motors.right);
    if (around != NULL) {
        health_around(&control->health, around, control->model.wheel_base_m,
            control->model.metres_per_count, readings->has_ultrasonic);
    }
    if (control->health.bits != control->logged_bits) {
        log_faults(control, control->health.bits);
    }
    if (control->state != STATE_STOPPED) {
        judge(control);
    }
    return motors;
}

void control_power(control_t *control, const board_power_t *power)
{
    control->power = *power;
}

void control_check_power(control_t *control)
{
    health_power(
        &control->health, &control->power, control->battery_low_v, control->battery_empty_v);
}

/* ---- present state -------------------------------------------------------------------------- */

uint16_t control_faults(const control_t *control)
{
    unsigned bits = control->health.bits;
    if (control->expired) {
        bits |= SP_FAULT_SETPOINT_EXPIRED;
    }
    if (reflexes_limited(&control->reflexes)) {
        bits |= SP_FAULT_LIMITED;
    }
    if (!control->drivers.enabled) {
        bits |= SP_FAULT_DRIVERS_OFF;
    }
    return (uint16_t)bits;
}

const watchdog_t *control_watchdog(const control_t *control)
{
    return control->state == STATE_BRINGUP ? &control->duties : &control->setpoints;
}

void control_planner_state(const control_t *control, sp_planner_state_t *out)
{
    if (control->planned) {
        onboard_state(&control->plan, out);
    } else {
        const sp_planner_state_t none = {0};
        *out = none;
    }
}
