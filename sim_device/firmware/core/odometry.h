/* Where the robot is: heading from the gyro less its bias, which is measured at rest; position from
 * the wheels along that heading (eq. 5 of the paper). Until the robot has rested long enough the
 * wheels turn the heading too (eq. 4). Nothing corrects it: the host's filter knows more. */
#ifndef ODOMETRY_H
#define ODOMETRY_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"
#include "model.h"
#include "pose.h"

typedef struct {
    float left_metres_per_count;
    float right_metres_per_count;
    float wheel_base_m;
    float first_bias_rad_s; /* the calibrated one, until it is measured */

    pose_t pose;
    float v_m_s;
    float yaw_rate_rad_s;
    float mark_rad; /* heading at the last encoder sample */

    float bias_rad_s;
    uint16_t rest_samples; /* up to what is enough */
    uint8_t batches;       /* that the bias is the mean of, up to a bound: it may drift */
    uint8_t batch_samples;
    float batch_sum;
    bool batch_ripe; /* there is one before the running one, which was not yet taken */
    float ripe_rad_s;

    bool sampled; /* the gyro */
    uint32_t sampled_us;
    bool counted; /* the encoders */
    board_encoders_t counts;
    bool turned; /* the wheels, ever */
    int64_t turned_us;
} odometry_t;

/* At rest at the origin, heading along x. */
void odometry_start(odometry_t *odometry, const model_t *model);

/* Take a sample of the gyro: once a control period. */
void odometry_imu(odometry_t *odometry, const board_imu_t *imu, int64_t now_us);

/* Take both wheels' counts: every other control period. */
void odometry_encoders(odometry_t *odometry, board_encoders_t counts, int64_t now_us);

#endif
