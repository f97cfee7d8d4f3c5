/* Dead reckoning. The heading is the integral of the gyro rate minus its bias, which is measured at
 * rest. The position is computed from the wheels along this heading (eq. 5 of the paper). Until the
 * first bias is known, the heading is also computed from the wheels (eq. 4). No other measurement
 * updates this estimate; the host's filter is more accurate. */
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
    float first_bias_rad_s; /* the calibrated bias until a bias is measured */

    pose_t pose;
    float v_m_s;
    float yaw_rate_rad_s;
    float mark_rad; /* heading at the last encoder sample */

    float bias_rad_s;
    uint16_t rest_samples; /* number of samples at rest, up to the required number */
    uint8_t batches;       /* number of batch means in the bias; limited, so that the bias follows drift */
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

/* Start at rest at the origin, with the heading along x. */
void odometry_start(odometry_t *odometry, const model_t *model);

/* Process a sample of the gyro; called once per control period. */
void odometry_imu(odometry_t *odometry, const board_imu_t *imu, int64_t now_us);

/* Process both wheels' counts; called every second control period. */
void odometry_encoders(odometry_t *odometry, board_encoders_t counts, int64_t now_us);

#endif
