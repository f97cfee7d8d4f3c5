/* Executes legs, one after the other: the inputs are observations, the outputs velocities. */
#ifndef LEG_EXECUTOR_H
#define LEG_EXECUTOR_H

#include <stdbool.h>
#include <stdint.h>

#include "leg.h"
#include "model.h"
#include "range_ahead.h"

/* Observation: the readings of the robot's own sensors in one step. */
typedef struct {
    int64_t now_us;
    pose_t pose;
    float v_m_s;
    float yaw_rate_rad_s;
    uint16_t ultrasonic_mm; /* BOARD_NO_RANGE: no echo */
    uint8_t contacts;       /* SP_CONTACT_* */
} observation_t;

typedef struct {
    float v_m_s;
    float yaw_rate_rad_s;
} velocity_t;

/* Error of the previous step, for a derivative. */
typedef struct {
    bool known;
    float error;
} memory_t;

typedef struct {
    float cruise_m_s;
    float max_m_s;
    float turn_rate_rad_s;

    leg_t leg;
    leg_result_t result; /* reason END_NONE: in progress */
    leg_end_t stopping;  /* reason of the stop in progress */
    bool backward;
    float speed_m_s;
    float timeout_s;
    float elapsed_s;
    float stopped_s;
    int64_t last_us;
    pose_t origin;
    float cos_heading, sin_heading;
    float along_m;
    float mark; /* last progress, and its time */
    float mark_s;

    memory_t heading_error;
    memory_t distance_error;
    memory_t bearing_error;
    range_ahead_t ahead;
    velocity_t smooth; /* last output */
} leg_executor_t;

/* Start at rest, without a leg. */
void leg_executor_start(leg_executor_t *executor, const model_t *model);

/* Begin a leg at the observed pose. */
void leg_executor_begin(leg_executor_t *executor, const leg_t *leg, const observation_t *seen);

/* Return the present velocity; zero without a leg. The leg has ended when executor->result.reason is
 * set. A bumper or a cliff ends any forward leg at once, without a ramp. It does not end a turn in
 * place or a reverse leg, because these lead away from the obstacle. */
velocity_t leg_executor_step(leg_executor_t *executor, const observation_t *seen);

/* Record a stop by other code: the next step ramps up from rest. */
void leg_executor_halt(leg_executor_t *executor);

#endif
