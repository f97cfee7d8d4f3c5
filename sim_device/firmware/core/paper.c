#include "paper.h"

#include <stddef.h>

#include "sweepctl_protocol.h"

/* Characters of log lines: a variable of the paper, and the multiplication sign. */
#define PHI "\xCE\xA6"
#define TIMES "\xC2\xB7"

/* Maximum difference of D and Prev-D that counts as equal, m. The lengths of two lanes are never
 * exactly equal. */
#define EQUAL_TOLERANCE_M 0.02f
/* Ultrasonic range at which the robot stops at a wall, m. The sensor is 4 cm behind the front, so
 * the clearance is 6 mm. A side step stops earlier, because the next lane runs along the wall. */
#define STOP_RANGE_M 0.046f
#define STEP_STOP_RANGE_M 0.054f
/* Distance to reverse after a contact, m, so that the robot does not graze the obstacle in the
 * turn. */
#define BACK_OFF_M 0.015f
#define BACK_OFF_M_S 0.05f
#define CLIFF_BACK_OFF_M 0.05f
#define CLIFF_BACK_OFF_M_S 0.1f
/* Maximum difference between a blocked side step and its length at which the step still counts as
 * complete, m. */
#define SHORT_STEP_M 0.015f
#define MIN_STEP_M 0.02f /* minimum length of a side step */
/* Time at rest at the end of every lane, s. The gyro bias is measured in the second half of this
 * time. */
#define REST_S 0.6f
#define LANES_MAX 2000u
/* Number of consecutive blocked side steps after which the robot counts as enclosed, for any length
 * of the lanes. */
#define BLOCKED_MAX 3u

/* ---- log of decisions ----------------------------------------------------------------------- */

static void decide(log_t *log, const char *kind, const char *what, const char *why)
{
    text_t *const line = log_begin(log, SP_LOG_LEVEL_INFO);
    text_add(line, kind);
    text_add(line, ": ");
    text_add(line, what);
    text_add(line, why);
}

static void log_blocked(log_t *log, const leg_t *leg, leg_end_t reason)
{
    text_t *const line = log_begin(log, SP_LOG_LEVEL_INFO);
    text_add(line, "blocked: ");
    text_add(line, leg->purpose);
    text_add(line, " ended early: ");
    text_add(line, leg_end_name(reason));
}

/* ---- lanes and side steps ------------------------------------------------------------------- */

/* Return the distance of a pose from the first lane, along the stepping direction. */
static float offset_m(const paper_t *paper, const pose_t *pose)
{
    return (pose->x_m - paper->origin.x_m) * cosf(paper->step_heading_rad)
        + (pose->y_m - paper->origin.y_m) * sinf(paper->step_heading_rad);
}

static void turn_to(paper_t *paper, float heading_rad)
{
    const leg_t turn = {.kind = LEG_TURN, .purpose = "turn", .heading_rad = heading_rad};
    paper->part = PART_TURN;
    paper->leg = turn;
}

/* Turn to the lane's heading and drive until an obstacle stops the robot. */
static void begin_lane(paper_t *paper, paper_at_t at, float heading_rad)
{
    const leg_t lane = {.kind = LEG_DRIVE,
        .purpose = "lane",
        .heading_rad = heading_rad,
        .stop_range_m = STOP_RANGE_M};
    paper->lanes++;
    paper->at = at;
    paper->main = lane;
    turn_to(paper, heading_rad);
}

/* Turn perpendicular to the lanes and drive to the line `path_m` beyond the intended line of the
 * last lane. If `path_m` is negative, turn and drive against the direction of the side steps.
 * Because the reference is the intended line, lanes stay W apart despite contacts or slip. */
static void begin_step(paper_t *paper, paper_at_t at, const pose_t *pose, float path_m)
{
    const float direction = path_m < 0.0f ? -1.0f : 1.0f;
    const float heading_rad =
        wrapped(paper->step_heading_rad + (path_m < 0.0f ? PI_F : 0.0f));
    paper->line_m += path_m;
    const leg_t step = {.kind = LEG_DRIVE,
        .purpose = "step",
        .heading_rad = heading_rad,
        .bounded = true,
        .distance_m =
            larger(direction * (paper->line_m - offset_m(paper, pose)), MIN_STEP_M),
        .stop_range_m = STEP_STOP_RANGE_M};
    paper->at = at;
    paper->main = step;
    turn_to(paper, heading_rad);
}

/* Return whether an obstacle ended a step before its full length. */
static bool is_short(const paper_t *paper)
{
    return leg_blocked(paper->ended.reason)
        && paper->main.distance_m - paper->ended.distance_m > SHORT_STEP_M;
}

/* Reverse far enough to turn after a contact or a cliff; return false if there is no need. */
static bool back_off(paper_t *paper, float heading_rad)
{
    const bool cliff = paper->ended.reason == END_CLIFF;
    if (!cliff && paper->ended.reason != END_BUMPER) {
        return false;
    }
    const leg_t back = {.kind = LEG_DRIVE,
        .purpose = "back-off",
        .heading_rad = heading_rad,
        .bounded = true,
        .distance_m = cliff ? -CLIFF_BACK_OFF_M : -BACK_OFF_M,
        .speed_m_s = cliff ? CLIFF_BACK_OFF_M_S : BACK_OFF_M_S};
    paper->leg = back;
    paper->part = PART_BACK_OFF;
    return true;
}

/* Begin the next part of the lane or side step in progress; return false if it is done. */
static bool continue_lane(paper_t *paper, const leg_result_t *result)
{
    const bool lane = paper->at == AT_LANE || paper->at == AT_OCCLUDED_LANE;
    switch (paper->part) {
    case PART_TURN:
        paper->part = PART_MAIN;
        paper->leg = paper->main;
        return true;
    case PART_MAIN:
        paper->ended = *result;
        if (back_off(paper, paper->main.heading_rad)) {
            return true;
        }
        break;
    case PART_BACK_OFF:
        break;
    case PART_REST:
        return false;
    }
    if (lane) {
        const leg_t rest = {.kind = LEG_REST, .purpose = "rest", .duration_s = REST_S};
        paper->part = PART_REST;
        paper->leg = rest;
        return true;
    }
    if (is_short(paper)) {
        paper->line_m = offset_m(paper, &paper->ended.pose);
    }
    return false;
}

/* Return why the sweep ends after a lane and a side step, or NULL. A lane shorter than W counts as
 * one place: a blocked step at both of its ends is no more evidence than a blocked step at one
 * end. */
static const char *stuck(paper_t *paper, const leg_result_t *lane, bool blocked)
{
    if (paper->lanes >= LANES_MAX) {
        return "2000 lanes driven, the limit";
    }
    if (!blocked) {
        paper->blocked_steps = 0;
        return NULL;
    }
    paper->blocked_steps++;
    if ((paper->blocked_steps > 1u && lane->distance_m >= paper->width_m)
        || paper->blocked_steps > BLOCKED_MAX) {
        return "side step blocked at both ends of the last lane";
    }
    return NULL;
}

/* ---- the three cases ------------------------------------------------------------------------ */

/* Record D, compare it with Prev-D, count T; return whether it is case 3. */
static bool compare(paper_t *paper, log_t *log)
{
    const float distance = paper->ended.distance_m;
    const float previous = paper->first_lane ? distance : paper->previous_lane_distance_m;
    const char *why = "D and Prev-D differ, by less than " PHI ": none of the cases";
    paper->first_lane = false;
    paper->lane_case = 0;
    if (distance + paper->diameter_m < previous) {
        paper->lane_case = 2;
        paper->turns = 0;
        why = "D + " PHI " < Prev-D: an obstacle, T starts again";
    } else if (distance - paper->diameter_m > previous) {
        paper->lane_case = 3;
        paper->length_m = paper->width_m * (float)paper->turns;
        why = "D - " PHI " > Prev-D: past an obstacle, its occluded Length = W" TIMES "T";
    } else if (absolute(distance - previous) <= EQUAL_TOLERANCE_M) {
        paper->lane_case = 1;
        why = "D = Prev-D: the lanes are equally long";
    }
    paper->lane_distance_m = distance;
    paper->previous_lane_distance_m = distance;
    decide(log, "lane", why, "");
    return paper->lane_case == 3;
}

static void step_on(paper_t *paper)
{
    begin_step(paper, AT_STEP, &paper->lane.pose, paper->width_m);
}

/* ---- recovery of the occluded region -------------------------------------------------------- */

static void end_recovery(paper_t *paper, log_t *log)
{
    paper->turns = 0; /* otherwise a second case 3 would count these lanes again */
    decide(log, "recovery-end", "occluded region swept as far as possible", "");
    step_on(paper);
}

static void begin_recovery(paper_t *paper, log_t *log)
{
    decide(log, "recovery-begin", "return to the occluded region", "");
    if (paper->length_m <= 0.0f) {
        end_recovery(paper, log);
        return;
    }
    paper->leave = paper->lane.pose;
    paper->leave_line_m = paper->line_m;
    paper->occluded_heading_rad = wrapped(paper->heading_rad + PI_F);
    begin_step(paper, AT_RECOVERY_BACK, &paper->leave, -paper->length_m);
}

/* Drive back to the place where case 3 occurred, as far as the path is free. */
static void begin_return(paper_t *paper, log_t *log)
{
    paper->blocked_steps = 0;
    if (distance_m(&paper->leave, &paper->occluded) < SHORT_STEP_M) {
        paper->line_m = paper->leave_line_m;
        end_recovery(paper, log);
        return;
    }
    const leg_t back = {.kind = LEG_GO_TO,
        .purpose = "return",
        .x_m = paper->leave.x_m,
        .y_m = paper->leave.y_m,
        .stop_range_m = STOP_RANGE_M};
    paper->at = AT_RETURN;
    paper->part = PART_MAIN;
    paper->leg = back;
}

/* Begin the next lane in the occluded region, or the return after the region is swept. */
static void sweep_occluded(paper_t *paper, log_t *log)
{
    if (offset_m(paper, &paper->occluded) < paper->until_m) {
        begin_lane(paper, AT_OCCLUDED_LANE, paper->occluded_heading_rad);
    } else {
        begin_return(paper, log);
    }
}

static void after_recovery_back(paper_t *paper, log_t *log)
{
    if (is_short(paper)) {
        log_blocked(log, &paper->main, paper->ended.reason);
    }
    paper->occluded = paper->ended.pose;
    paper->until_m = offset_m(paper, &paper->leave) - 0.5f * paper->width_m;
    paper->blocked_steps = 0;
    sweep_occluded(paper, log);
}

static void after_occluded_lane(paper_t *paper, log_t *log)
{
    paper->occluded_lane = paper->ended;
    decide(log, "recovery-lane", "lane in the occluded region ended: ", leg_end_name(paper->ended.reason));
    begin_step(paper, AT_OCCLUDED_STEP, &paper->occluded_lane.pose, paper->width_m);
}

static void after_occluded_step(paper_t *paper, log_t *log)
{
    const bool blocked = is_short(paper);
    paper->occluded = paper->ended.pose;
    if (blocked) {
        log_blocked(log, &paper->main, paper->ended.reason);
    }
    if (stuck(paper, &paper->occluded_lane, blocked) != NULL) {
        begin_return(paper, log);
        return;
    }
    paper->occluded_heading_rad = wrapped(paper->occluded_heading_rad + PI_F);
    sweep_occluded(paper, log);
}

/* Continue after the return leg. After a contact, reverse along the present heading. */
static void after_return(
    paper_t *paper, const leg_result_t *result, const pose_t *pose, log_t *log)
{
    if (paper->part == PART_MAIN) {
        paper->ended = *result;
        if (leg_blocked(result->reason)) {
            log_blocked(log, &paper->leg, result->reason);
        }
        if (back_off(paper, pose->heading_rad)) {
            return;
        }
    }
    paper->line_m = paper->leave_line_m;
    end_recovery(paper, log);
}

/* ---- the plan ------------------------------------------------------------------------------- */

static void after_lane(paper_t *paper, log_t *log)
{
    paper->lane = paper->ended;
    if (compare(paper, log)) {
        begin_recovery(paper, log);
    } else {
        step_on(paper);
    }
}

static void after_step(paper_t *paper, log_t *log)
{
    const bool blocked = is_short(paper);
    if (blocked) {
        log_blocked(log, &paper->main, paper->ended.reason);
    }
    paper->finish_reason = stuck(paper, &paper->lane, blocked);
    if (paper->finish_reason != NULL) {
        decide(log, "finish", paper->finish_reason, "");
        return;
    }
    if (!blocked) {
        paper->turns++; /* count only complete steps of W; otherwise W T would not be the length */
    }
    paper->heading_rad = wrapped(paper->heading_rad + PI_F);
    begin_lane(paper, AT_LANE, paper->heading_rad);
}

void paper_start(paper_t *paper, const model_t *model, const pose_t *pose, log_t *log)
{
    const paper_t nothing = {0};
    *paper = nothing;
    paper->diameter_m = model->diameter_m;
    paper->width_m = model->cleaning_width_m;
    paper->origin = *pose;
    paper->step_heading_rad = wrapped(pose->heading_rad + 0.5f * PI_F); /* first step to the left */
    paper->heading_rad = pose->heading_rad;
    paper->first_lane = true;
    decide(log, "start", "lanes along the start heading", "");
    begin_lane(paper, AT_LANE, paper->heading_rad);
}

bool paper_next(paper_t *paper, const leg_result_t *result, const pose_t *pose, log_t *log)
{
    if (paper->at == AT_RETURN) {
        after_return(paper, result, pose, log);
        return true;
    }
    if (continue_lane(paper, result)) {
        return true;
    }
    switch (paper->at) {
    case AT_LANE:
        after_lane(paper, log);
        break;
    case AT_STEP:
        after_step(paper, log);
        break;
    case AT_RECOVERY_BACK:
        after_recovery_back(paper, log);
        break;
    case AT_OCCLUDED_LANE:
        after_occluded_lane(paper, log);
        break;
    case AT_OCCLUDED_STEP:
        after_occluded_step(paper, log);
        break;
    case AT_RETURN:
        break;
    }
    return paper->finish_reason == NULL;
}
