/* The onboard mode: the device runs the paper's planner itself, from its own readings. The gyro is
 * read in each control period and the rangers at 20 Hz. Wheel counts are read and decisions are
 * made in every second control period. Positions are in the start frame: its origin is the robot's
 * place at the start of the plan, and its x axis is the heading at the start. */
#ifndef ONBOARD_H
#define ONBOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "leg_executor.h"
#include "log.h"
#include "model.h"
#include "odometry.h"
#include "paper.h"
#include "readings.h"
#include "sweepctl_protocol.h"

typedef enum {
    PLAN_RESTS, /* at rest, to measure the gyro bias */
    PLAN_RUNS,
    PLAN_PAUSED,
    PLAN_FINISHED,
    PLAN_ABORTED
} plan_state_t;

typedef struct {
    plan_state_t state;
    plan_state_t before_pause;
    int64_t move_us; /* earliest time of a move */
    bool looked;     /* the rangers were read since the start */
    bool began;      /* a leg has begun */
    uint16_t ultrasonic_mm;
    model_t model;
    odometry_t odometry;
    leg_executor_t executor;
    paper_t paper;
    velocity_t wanted;
    const char *finish_reason;
} onboard_t;

/* Rest for 2.5 s to measure the gyro bias, then begin the first leg. */
void onboard_start(onboard_t *plan, const model_t *model, int64_t now_us);

/* Pause: stop the robot; the estimate continues. Resume: continue the interrupted leg. */
void onboard_pause(onboard_t *plan);
void onboard_resume(onboard_t *plan);

/* End the plan after its last leg or at an abort. */
void onboard_end(onboard_t *plan);

/* Run one control period: process the readings and return the velocity. `ticks` is the number of
 * periods since the last call, with missed ones. Decisions are written to the log. `around` is NULL
 * in periods without a range measurement. */
velocity_t onboard_step(onboard_t *plan, uint32_t tick, uint32_t ticks, int64_t now_us,
    readings_t *readings, const around_t *around, log_t *log);

/* Return the reason why the plan has ended by itself; NULL while it runs. */
const char *onboard_finish_reason(const onboard_t *plan);

/* Return the paper's variables and the target point; without a target, the robot's position. */
void onboard_state(const onboard_t *plan, sp_planner_state_t *out);

#endif
