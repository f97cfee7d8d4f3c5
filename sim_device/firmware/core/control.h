/* Motion control of the device: mode table, stop latch, watchdogs, onboard planner, wheel control.
 */
#ifndef CONTROL_H
#define CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#include "health.h"
#include "latch.h"
#include "log.h"
#include "model.h"
#include "modes.h"
#include "motor_drivers.h"
#include "onboard.h"
#include "parameters.h"
#include "readings.h"
#include "reflexes.h"
#include "watchdog.h"
#include "wheels.h"

/* Maximum duty in bring-up mode: half of full scale. It turns the wheels of a lifted robot visibly.
 */
#define BRINGUP_DUTY_MAX 5000

typedef struct {
    state_t state;
    latch_t latch;
    watchdog_t setpoints; /* units of 0.0001 m/s and 0.0002 rad/s, as in the message */
    watchdog_t duties;    /* units of 0.0001 of full scale, limited */
    bool expired;         /* the setpoint has expired, and no new setpoint has arrived */
    wheels_t wheels;
    health_t health;
    reflexes_t reflexes;
    motor_drivers_t drivers;
    uint16_t logged_bits;
    board_power_t power; /* last measurement */
    model_t model;
    float battery_low_v;
    float battery_empty_v;
    int64_t now_us; /* start of the control period */
    bool planned;   /* a plan exists; it runs or has ended */
    onboard_t plan;
    log_t log;
} control_t;

/* Start at rest with a latched stop; the struct must be zero before. The robot moves only after the
 * latch is cleared. */
void control_start(control_t *control, const parameters_t *parameters);

/* Apply the parameters that take effect at once. */
void control_apply(control_t *control, const parameters_t *parameters);

/* ---- events --------------------------------------------------------------------------------- */

/* Apply an event by the mode table; `holding` contains the conditions that are true. Return -1, or
 * the reason of a rejection. */
int control_fire(control_t *control, event_t event, unsigned holding);

/* Latch a stop and leave any driving mode. Only EVENT_STOP can replace the cause of a latched stop.
 * For example, if a host ends its session and then disconnects, the cause stays `session_end` and
 * does not become `link`. */
void control_stop(control_t *control, uint8_t cause, event_t event);

/* Release the latch if `cause` is the latched cause and its condition has ended. Return -1, or the
 * reason of a rejection. */
int control_clear(control_t *control, uint8_t cause);

/* Start the planner with this number. Return -1, or the reason of a rejection. */
int control_start_planner(control_t *control, uint8_t number);

/* Store the host's cyclic values; return false if they are stale. */
bool control_velocity(
    control_t *control, const sp_velocity_setpoint_t *wanted, int64_t extra, int64_t arrived_us);
bool control_wheel_duty(
    control_t *control, const sp_wheel_duty_t *wanted, int64_t extra, int64_t arrived_us);

/* Discard everything that a session has sent. */
void control_forget_host(control_t *control);

/* ---- time ----------------------------------------------------------------------------------- */

typedef struct {
    int16_t left; /* in units of BOARD_DUTY_ONE */
    int16_t right;
    bool drivers; /* enabled */
} motors_t;

/* Run one control period. `ticks` is the number of periods since the last call, with missed ones.
 * `around` is NULL in periods without a range measurement. */
motors_t control_tick(control_t *control, uint32_t tick, uint32_t ticks, int64_t now_us,
    readings_t *readings, const around_t *around);

/* Process a reading of the supply. */
void control_power(control_t *control, const board_power_t *power);

/* Check the newest reading of the supply; called at 5 Hz, whatever the stream's rate. */
void control_check_power(control_t *control);

/* ---- present state -------------------------------------------------------------------------- */

/* SP_FAULT_* */
uint16_t control_faults(const control_t *control);

/* Return the watchdog of the host's cyclic message in the present mode. */
const watchdog_t *control_watchdog(const control_t *control);

/* Return the state of the running plan, or of the last one. */
void control_planner_state(const control_t *control, sp_planner_state_t *out);

#endif
