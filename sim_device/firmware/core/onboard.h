/* The onboard mode: the device runs the paper's planner itself, from its own readings: gyro in each
 * control period, wheels and decisions in every other, rangers at 20 Hz. Positions are in the frame
 * of the start: the robot stands at its origin, heading along x, as it is started. */
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
    PLAN_RESTS, /* for the gyro's bias */
    PLAN_RUNS,
    PLAN_PAUSED,
    PLAN_FINISHED,
    PLAN_ABORTED
} plan_state_t;

typedef struct {
    plan_state_t state;
    plan_state_t before_pause;
    int64_t move_us; /* not before this */
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

/* Start to rest; the first leg begins 2.5 s later. */
void onboard_start(onboard_t *plan, const model_t *model, int64_t now_us);

/* Hold still, the leg under way kept; the estimate goes on. And go on where it was held. */
void onboard_pause(onboard_t *plan);
void onboard_resume(onboard_t *plan);

/* Let go of the plan: it has finished, or is aborted. */
void onboard_end(onboard_t *plan);

/* One control period: readings in, the velocity wanted out; decisions go to the log. `around` is
 * given in the periods in which the rangers were read, else NULL. */
velocity_t onboard_step(onboard_t *plan, uint32_t tick, int64_t now_us, readings_t *readings,
    const around_t *around, log_t *log);

/* Why the plan ended by itself; NULL while it has not. */
const char *onboard_finish_reason(const onboard_t *plan);

/* The paper's variables and the point driven to; the robot's own where there is none. */
void onboard_tell(const onboard_t *plan, sp_planner_state_t *out);

#endif
