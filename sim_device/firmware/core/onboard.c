#include "onboard.h"

#include <stddef.h>

#include "board.h"
#include "period.h"

/* Time at rest before the first move, us. The gyro bias is the mean of 250 samples in this time. */
#define BIAS_US 2500000
#define DECIDE_PERIODS 2u
/* Maximum number of consecutive legs that end in the step in which they begin. A larger number
 * means that the planner is in an endless loop. */
#define DECISIONS_MAX 16u

static const velocity_t HALT = {0.0f, 0.0f};

void onboard_start(onboard_t *plan, const model_t *model, int64_t now_us)
{
    const onboard_t nothing = {0};
    *plan = nothing;
    plan->state = PLAN_RESTS;
    plan->move_us = now_us + BIAS_US;
    plan->ultrasonic_mm = BOARD_NO_RANGE;
    plan->model = *model;
    odometry_start(&plan->odometry, model);
    leg_executor_start(&plan->executor, model);
}

void onboard_pause(onboard_t *plan)
{
    plan->before_pause = plan->state;
    plan->state = PLAN_PAUSED;
    leg_executor_halt(&plan->executor);
    plan->wanted = HALT;
}

void onboard_resume(onboard_t *plan)
{
    plan->state = plan->before_pause;
}

void onboard_end(onboard_t *plan)
{
    plan->state = plan->finish_reason != NULL ? PLAN_FINISHED : PLAN_ABORTED;
    plan->wanted = HALT;
}

const char *onboard_finish_reason(const onboard_t *plan)
{
    return plan->finish_reason;
}

/* ---- running -------------------------------------------------------------------------------- */

/* Begin the first or the next leg; return false if the plan has no further leg. */
static bool next_leg(onboard_t *plan, const observation_t *observed, log_t *log)
{
    if (!plan->began) {
        plan->began = true;
        paper_start(&plan->paper, &plan->model, &observed->pose, log);
    } else if (!paper_next(&plan->paper, &plan->executor.result, &observed->pose, log)) {
        plan->finish_reason = plan->paper.finish_reason;
        return false;
    }
    leg_executor_begin(&plan->executor, &plan->paper.leg, observed);
    return true;
}

/* Run one decision step: execute the present leg, and begin the next leg when it ends. */
static velocity_t run(onboard_t *plan, const observation_t *observed, log_t *log)
{
    if (plan->began) {
        const velocity_t wanted = leg_executor_step(&plan->executor, observed);
        if (plan->executor.result.reason == END_NONE) {
            return wanted;
        }
    }
    for (unsigned i = 0; i < DECISIONS_MAX; i++) {
        if (!next_leg(plan, observed, log)) {
            return HALT;
        }
        const velocity_t wanted = leg_executor_step(&plan->executor, observed);
        if (plan->executor.result.reason == END_NONE) {
            return wanted;
        }
    }
    plan->finish_reason = "planner made no progress";
    return HALT;
}

velocity_t onboard_step(onboard_t *plan, uint32_t tick, uint32_t ticks, int64_t now_us,
    readings_t *readings, const around_t *around, log_t *log)
{
    const bool decides = due_every(DECIDE_PERIODS, 0, tick, ticks);
    odometry_imu(&plan->odometry, &readings->imu, now_us);
    if (decides) {
        odometry_encoders(&plan->odometry, readings->counts, now_us);
    }
    if (around != NULL) {
        plan->looked = true;
        plan->ultrasonic_mm = around->ranges.ultrasonic_mm;
    }
    if (decides && plan->state == PLAN_RUNS) {
        const observation_t observed = {now_us, plan->odometry.pose, plan->odometry.v_m_s,
            plan->odometry.yaw_rate_rad_s, plan->ultrasonic_mm, readings_contacts(readings)};
        plan->wanted = run(plan, &observed, log);
    } else if (decides && plan->state == PLAN_RESTS && plan->looked && now_us >= plan->move_us) {
        plan->state = PLAN_RUNS; /* effective from the next decision step */
    }
    return plan->wanted;
}

/* ---- reports -------------------------------------------------------------------------------- */

static uint8_t phase(const onboard_t *plan)
{
    static const uint8_t phases[] = {
        [AT_LANE] = SP_PLANNER_PHASE_LANE,
        [AT_STEP] = SP_PLANNER_PHASE_STEP,
        [AT_RECOVERY_BACK] = SP_PLANNER_PHASE_RECOVERY_BACK,
        [AT_OCCLUDED_LANE] = SP_PLANNER_PHASE_RECOVERY_LANE,
        [AT_OCCLUDED_STEP] = SP_PLANNER_PHASE_RECOVERY_LANE,
        [AT_RETURN] = SP_PLANNER_PHASE_RECOVERY_RETURN,
    };
    switch (plan->state) {
    case PLAN_RESTS:
        return SP_PLANNER_PHASE_IDLE;
    case PLAN_PAUSED:
        return SP_PLANNER_PHASE_PAUSED;
    case PLAN_FINISHED:
        return SP_PLANNER_PHASE_FINISHED;
    case PLAN_ABORTED:
        return SP_PLANNER_PHASE_ABORTED;
    case PLAN_RUNS:
        break;
    }
    const paper_at_t at = plan->paper.at;
    const bool reports_turns = at == AT_LANE || at == AT_STEP;
    if (reports_turns && plan->executor.leg.kind == LEG_TURN) {
        return SP_PLANNER_PHASE_TURN;
    }
    return phases[at];
}

void onboard_state(const onboard_t *plan, sp_planner_state_t *out)
{
    const paper_t *const paper = &plan->paper;
    const bool returns = paper->at == AT_RETURN;
    const float x_m = returns ? paper->leave.x_m : plan->odometry.pose.x_m;
    const float y_m = returns ? paper->leave.y_m : plan->odometry.pose.y_m;
    out->phase = phase(plan);
    out->turn_count = (uint8_t)paper->turns;
    out->target_x = sp_planner_state_target_x_from_m(x_m);
    out->target_y = sp_planner_state_target_y_from_m(y_m);
    out->lane_distance = sp_planner_state_lane_distance_from_m(absolute(paper->lane_distance_m));
    out->previous_lane_distance =
        sp_planner_state_previous_lane_distance_from_m(absolute(paper->previous_lane_distance_m));
    out->length = sp_planner_state_length_from_m(absolute(paper->length_m));
    out->lane_case = paper->lane_case;
}
