/* The paper's algorithm without changes: U-shaped lanes, and memory of one occluded region (section
 * 3.2).
 *
 * D is the length of the last lane, T the number of turns, W the cleaning width. Case 1, D =
 * Prev-D: count the turn. Case 2, D + diameter < Prev-D: an obstacle; restart the count. Case 3, D
 * - diameter > Prev-D: the robot has passed the obstacle; the occluded region behind it has the
 * length Length = W T. Drive back by Length against the stepping direction, sweep up to the
 * interrupted lane, and continue.
 *
 * This is a reference implementation: it must fail in every situation in which the paper's
 * algorithm fails. Details that the paper does not define are as in the host's planner of the same
 * name (bridge/coverage/baselines/paper.py). */
#ifndef PAPER_H
#define PAPER_H

#include <stdbool.h>
#include <stdint.h>

#include "leg.h"
#include "log.h"
#include "model.h"

/* Present part of the plan. */
typedef enum {
    AT_LANE,          /* sweeping a lane */
    AT_STEP,          /* stepping to the next lane by W */
    AT_RECOVERY_BACK, /* driving back by Length, past the region that an obstacle occluded */
    AT_OCCLUDED_LANE, /* sweeping the occluded region */
    AT_OCCLUDED_STEP,
    AT_RETURN /* driving back to the place where the region was detected */
} paper_at_t;

/* Parts of a lane or side step, in this order. */
typedef enum { PART_TURN, PART_MAIN, PART_BACK_OFF, PART_REST } paper_part_t;

typedef struct {
    float diameter_m;
    float width_m;

    paper_at_t at;
    paper_part_t part;
    leg_t leg;          /* in progress */
    leg_t main;         /* drive of the lane or side step in progress */
    leg_result_t ended; /* its result */

    pose_t origin;
    float step_heading_rad;
    float line_m; /* distance of the last lane's intended line from the first lane */
    float heading_rad;
    uint16_t lanes;
    uint8_t blocked_steps; /* number of consecutive blocked steps */
    leg_result_t lane;     /* result of the last lane */
    bool first_lane;

    uint16_t turns;                 /* T */
    float lane_distance_m;          /* D */
    float previous_lane_distance_m; /* Prev-D */
    float length_m;                 /* Length = W T of the last case 3 */
    uint8_t lane_case;              /* case of the last lane; 0: none */

    pose_t leave; /* place where case 3 occurred */
    float leave_line_m;
    float occluded_heading_rad;
    pose_t occluded; /* present place of the sweep of the occluded region */
    float until_m;   /* offset at which the occluded region ends */
    leg_result_t occluded_lane;

    const char *finish_reason; /* NULL: the plan continues */
} paper_t;

/* Begin at a pose; paper->leg is the first leg. */
void paper_start(paper_t *paper, const model_t *model, const pose_t *pose, log_t *log);

/* Set the next leg after a leg with this result; return false if the plan has ended. */
bool paper_next(paper_t *paper, const leg_result_t *result, const pose_t *pose, log_t *log);

#endif
