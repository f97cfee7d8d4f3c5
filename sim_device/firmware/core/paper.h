/* The paper's algorithm, faithfully: U-shaped lanes and one slot of memory (section 3.2).
 *
 * Case 1, D = Prev-D: count the turn. Case 2, D + diameter < Prev-D: an obstacle; restart the
 * count. Case 3, D - diameter > Prev-D: the robot has passed the obstacle; its occluded region is
 * Length = W T long. Drive back by Length against the stepping direction, sweep up to the lane that
 * was left, and continue.
 *
 * This is a reference and must not be repaired: where the paper's algorithm fails, this must fail.
 * Choices that the paper leaves open follow the host's planner of the same name
 * (bridge/coverage/baselines/paper.py). */
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
    AT_OCCLUDED_LANE, /* sweeping that region in the same way */
    AT_OCCLUDED_STEP,
    AT_RETURN /* driving back to where the region was noticed */
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
    float line_m; /* intended line of the last lane, along the stepping direction from the first */
    float heading_rad;
    uint16_t lanes;
    uint8_t blocked_steps; /* number in a row */
    leg_result_t lane;     /* result of the last lane */
    bool first_lane;

    uint8_t turns;               /* T */
    float lane_distance_m;          /* D */
    float previous_lane_distance_m; /* Prev-D */
    float length_m;                 /* Length = W T of the last case 3 */
    uint8_t lane_case;              /* of the last lane; 0: none */

    pose_t leave; /* where case 3 fired */
    float leave_line_m;
    float occluded_heading_rad;
    pose_t occluded; /* present place of the sweep of the occluded region */
    float until_m;   /* offset at which that region ends */
    leg_result_t occluded_lane;

    const char *finish_reason; /* NULL: the plan continues */
} paper_t;

/* Begin at a pose; planner->leg is the first leg. */
void paper_start(paper_t *paper, const model_t *model, const pose_t *pose, log_t *log);

/* Set the leg after one with this result; return false if the plan has ended. */
bool paper_next(paper_t *paper, const leg_result_t *result, const pose_t *pose, log_t *log);

#endif
