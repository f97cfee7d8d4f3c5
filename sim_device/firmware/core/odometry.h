/* Dead reckoning. The heading comes from the gyro minus its bias, which is measured at rest; the
 * position from the wheels along that heading (eq. 5 of the paper). Until the first bias is known,
 * the wheels give the heading too (eq. 4). Nothing corrects this estimate; the host's filter does
 * better. */
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
    float first_bias_rad_s; /* the calibrated one until one is measured */

    pose_t pose;
    float v_m_s;
    float yaw_rate_rad_s;
    float mark_rad; /* heading at the last encoder sample */

    float bias_rad_s;
    uint16_t rest_samples; /* counted up to the required number */
    uint8_t batches;       /* means in the bias, up to a bound because it may drift */
    uint8_t batch_samples;
    float batch_sum;
    bool batch_ripe; /* a complete mean waits to be used */
    float ripe_rad_s;

    bool sampled; /* the gyro has a sample */
    uint32_t sampled_us;
    bool counted; /* the encoders have a sample */
    board_encoders_t counts;
    bool turned; /* the wheels have ever turned */
    int64_t turned_us;
} odometry_t;

/* At rest at the origin, heading along x. */
void odometry_start(odometry_t *odometry, const model_t *model);

/* Take a sample of the gyro: once a control period. */
void odometry_imu(odometry_t *odometry, const board_imu_t *imu, int64_t now_us);

/* Take both wheels' counts: every other control period. */
void odometry_encoders(odometry_t *odometry, board_encoders_t counts, int64_t now_us);

#endif
