/* The onboard mode: the device runs the paper's planner itself, from its own readings: gyro in each
 * control period, wheels and decisions in every other one, rangers at 20 Hz. Positions are in the
 * start frame: the origin is the robot's place at the start of the plan, and x its heading. */
#ifndef ONBOARD_H
#define ONBOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "driver.h"
#include "log.h"
#include "model.h"
#include "odometry.h"
#include "paper.h"
#include "readings.h"
#include "sweepctl_protocol.h"

typedef enum {
    PLAN_RESTS, /* to measure the gyro bias */
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
    bool began;      /* there is a leg */
    uint16_t ultrasonic_mm;
    model_t model;
    odometry_t odometry;
    driver_t driver;
    paper_t paper;
    velocity_t wanted;
    const char *finish_reason;
} onboard_t;

/* Start with 2.5 s at rest, then begin the first leg. */
void onboard_start(onboard_t *plan, const model_t *model, int64_t now_us);

/* Hold still and keep the leg; the estimate continues. The other function continues the leg. */
void onboard_pause(onboard_t *plan);
void onboard_resume(onboard_t *plan);

/* End the plan, finished or aborted. */
void onboard_end(onboard_t *plan);

/* Run one control period: take the readings, return the velocity; decisions go to the log. `around`
 * is NULL in periods without a range measurement. */
velocity_t onboard_step(onboard_t *plan, uint32_t tick, int64_t now_us, readings_t *readings,
    const around_t *around, log_t *log);

/* Return the reason for which the plan ended by itself; NULL while it runs. */
const char *onboard_finish_reason(const onboard_t *plan);

/* Return the paper's variables and the target point; without a target, the robot's position. */
void onboard_state(const onboard_t *plan, sp_planner_state_t *out);

#endif
