/* The paper's algorithm, faithfully: U-shaped lanes and one slot of memory (section 3.2).
 *
 * Case 1, D = Prev-D: count the turn. Case 2, D + diameter < Prev-D: an obstacle, count anew.
 * Case 3, D - diameter > Prev-D: stepped past it; its shadow is Length = W T long. Drive back by
 * Length against the stepping direction, sweep up to the lane that was left, and go on.
 *
 * It is a reference and not to be repaired: where it fails, this must fail. What the paper leaves
 * open is chosen as the host's own planner of that name chooses it (bridge/coverage/baselines/paper.py). */
#ifndef PAPER_H
#define PAPER_H

#include <stdbool.h>
#include <stdint.h>

#include "leg.h"
#include "log.h"
#include "model.h"

/* What the plan is at. */
typedef enum {
    AT_LANE,          /* sweeping lane after lane ... */
    AT_STEP,          /* ... and stepping to the next one by W */
    AT_RECOVERY_BACK, /* driving back by Length, past the shadow that an obstacle left */
    AT_SHADOW_LANE,   /* sweeping the shadow likewise */
    AT_SHADOW_STEP,
    AT_RETURN /* back to where the shadow was noticed */
} paper_at_t;

/* Lane and side step are made of these, one after the other. */
typedef enum { PART_TURN, PART_MAIN, PART_BACK_OFF, PART_REST } paper_part_t;

typedef struct {
    float diameter_m;
    float width_m;

    paper_at_t at;
    paper_part_t part;
    leg_t leg;          /* under way */
    leg_t main;         /* drive of the lane or side step under way */
    leg_result_t ended; /* how it ended */

    pose_t origin;
    float step_heading_rad;
    float line_m; /* of the last lane, along the stepping direction from the first */
    float heading_rad;
    uint16_t lanes;
    uint8_t blocked_steps; /* in a row */
    leg_result_t lane;     /* the last one */
    bool first_lane;

    uint8_t turns;               /* T */
    float lane_distance_m;          /* D */
    float previous_lane_distance_m; /* Prev-D */
    float length_m;                 /* Length = W T of the last case 3 */
    uint8_t lane_case;              /* of the last lane; 0: none */

    pose_t leave; /* where case 3 fired */
    float leave_line_m;
    float shadow_heading_rad;
    pose_t shadow;   /* where the sweep of the shadow stands */
    float until_m;   /* offset at which the shadow ends */
    leg_result_t shadow_lane;

    const char *finish_reason; /* NULL: it goes on */
} paper_t;

/* Begin at a pose; planner->leg is the first leg. */
void paper_start(paper_t *paper, const model_t *model, const pose_t *pose, log_t *log);

/* The leg after the one that ended so; false where the plan has ended. */
bool paper_next(paper_t *paper, const leg_result_t *result, const pose_t *pose, log_t *log);

#endif
