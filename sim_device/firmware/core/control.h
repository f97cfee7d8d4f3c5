/* What moves the wheels: mode table, latch, watchdogs, own planner and wheel control joined. */
#ifndef CONTROL_H
#define CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#include "health.h"
#include "latch.h"
#include "log.h"
#include "model.h"
#include "modes.h"
#include "onboard.h"
#include "parameters.h"
#include "readings.h"
#include "reflexes.h"
#include "watchdog.h"
#include "wheels.h"

/* Half of what the motors could: enough to see a wheel turn, on a robot that is held up. */
#define BRINGUP_DUTY_MAX 5000

typedef struct {
    state_t state;
    latch_t latch;
    watchdog_t setpoints; /* 0.0001 m/s and 0.0002 rad/s, as on the wire */
    watchdog_t duties;    /* 0.0001, capped */
    bool expired;         /* the setpoint ran out and no other has come */
    wheels_t wheels;
    health_t health;
    reflexes_t reflexes;
    bool drivers; /* enabled */
    uint8_t rest_ticks;
    uint16_t told_bits;
    board_power_t power; /* as last measured */
    model_t model;
    float battery_low_v;
    float battery_empty_v;
    int64_t now_us; /* of the period */
    bool planned;   /* there is a plan, if only the last one */
    onboard_t plan;
    log_t log;
} control_t;

/* All zero before. At rest and latched: it moves only when it is asked to. */
void control_start(control_t *control, const parameters_t *parameters);

/* Keep to what was set, as far as it counts at once. */
void control_apply(control_t *control, const parameters_t *parameters);

/* ---- what may happen ----------------------------------------------------------------------- */

/* Let an event happen, as the mode table says, `holding` being so: -1, or a refusal's reason. */
int control_fire(control_t *control, event_t event, unsigned holding);

/* Latch a stop and leave any driving mode. Of events other than EVENT_STOP the table may say that
 * they change nothing: a host that leaves after an orderly end makes no lost link of it. */
void control_stop(control_t *control, uint8_t cause, event_t event);

/* Release the latch if `cause` is what holds it and no longer so: -1, or a refusal's reason. */
int control_clear(control_t *control, uint8_t cause);

/* Start the planner of this number: -1, or a refusal's reason. */
int control_start_planner(control_t *control, uint8_t number);

/* Take what the host sends cyclically; false where it is stale. */
bool control_velocity(
    control_t *control, const sp_velocity_setpoint_t *wanted, int64_t extra, int64_t arrived_us);
bool control_wheel_duty(
    control_t *control, const sp_wheel_duty_t *wanted, int64_t extra, int64_t arrived_us);

/* Nothing that a session sent outlives it. */
void control_forget_host(control_t *control);

/* ---- time ---------------------------------------------------------------------------------- */

typedef struct {
    int16_t left; /* of BOARD_DUTY_ONE */
    int16_t right;
    bool drivers; /* enabled */
} motors_t;

/* One control period. `around` is given in those in which the rangers were read, else NULL. */
motors_t control_tick(control_t *control, uint32_t tick, int64_t now_us,
    readings_t *readings, const around_t *around);

/* Take a reading of the supply. */
void control_power(control_t *control, const board_power_t *power);

/* ---- what is so ---------------------------------------------------------------------------- */

/* SP_FAULT_* */
uint16_t control_faults(const control_t *control);

/* Of what the host sends cyclically in this mode. */
const watchdog_t *control_watchdog(const control_t *control);

/* Of the plan that runs, or the last one. */
void control_planner_state(const control_t *control, sp_planner_state_t *out);

#endif
