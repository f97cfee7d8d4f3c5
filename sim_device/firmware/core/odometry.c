#include "odometry.h"

#define GYRO_RAD_S (PI_F / 180.0f / BOARD_IMU_PER_DEG_S)
/* Maximum gap between two samples that is integrated, us. In a longer gap the rate is unknown. */
#define IMU_GAP_US 100000u
/* Number of samples at rest before the gyro is used. */
#define FIRST_BIAS_SAMPLES 25u
/* Number of samples at rest in one mean. A mean is used only when the next mean is complete. The
 * reason is that the newest samples may already belong to a motion, which the encoder counts show
 * up to 20 ms later. */
#define BATCH 5u
#define BATCHES_MAX 20u
/* Maximum first bias, rad/s; greater than the data sheet's limit of +-20 deg/s. A larger sample
 * means that the robot moves. */
#define LARGEST_BIAS_RAD_S 0.4f
/* Maximum difference between rate and bias at rest, rad/s: 3 deg/s. It detects a robot that a
 * person turns while the wheels stand. */
#define RATE_VETO_RAD_S 0.05f
/* Time after the last encoder count until the robot counts as at rest, us. Motion in the gearbox
 * play has then ended. */
#define REST_US 300000
/* Weight of the newest interval in the smoothed speed. It is less than 1, because one count in 20
 * ms is already 6.5 mm/s. */
#define SPEED_SHARE 0.5f
#define STANDS_M_S 1e-3f

void odometry_start(odometry_t *odometry, const model_t *model)
{
    const odometry_t nothing = {0};
    *odometry = nothing;
    odometry->left_metres_per_count =
        model->metres_per_count * 2.0f / (1.0f + model->wheel_ratio);
    odometry->right_metres_per_count = odometry->left_metres_per_count * model->wheel_ratio;
    odometry->first_bias_rad_s = odometry->bias_rad_s = model->gyro_bias_rad_s;
    odometry->wheel_base_m = model->wheel_base_m;
}

static bool trusted(const odometry_t *odometry)
{
    return odometry->rest_samples >= FIRST_BIAS_SAMPLES;
}

static bool at_rest(const odometry_t *odometry, float rate_rad_s, int64_t now_us)
{
    if (odometry->turned && now_us - odometry->turned_us < REST_US) {
        return false;
    }
    return trusted(odometry) ? absolute(rate_rad_s - odometry->bias_rad_s) < RATE_VETO_RAD_S
                             : absolute(rate_rad_s) < LARGEST_BIAS_RAD_S;
}

static void forget_batches(odometry_t *odometry)
{
    odometry->batch_sum = 0.0f;
    odometry->batch_samples = 0;
    odometry->batch_ripe = false;
}

static void learn_bias(odometry_t *odometry, float rate_rad_s)
{
    if (odometry->rest_samples < FIRST_BIAS_SAMPLES) {
        odometry->rest_samples++;
    }
    odometry->batch_sum += rate_rad_s;
    odometry->batch_samples++;
    if (odometry->batch_samples < BATCH) {
        return;
    }
    if (odometry->batch_ripe) {
        if (odometry->batches < BATCHES_MAX) {
            odometry->batches++;
        }
        odometry->bias_rad_s +=
            (odometry->ripe_rad_s - odometry->bias_rad_s) / (float)odometry->batches;
    }
    odometry->ripe_rad_s = odometry->batch_sum / (float)BATCH;
    odometry->batch_ripe = true;
    odometry->batch_sum = 0.0f;
    odometry->batch_samples = 0;
}

void odometry_imu(odometry_t *odometry, const board_imu_t *imu, int64_t now_us)
{
    const uint32_t since_us = imu->sampled_us - odometry->sampled_us;
    const float rate_rad_s = (float)imu->gyro_z * GYRO_RAD_S;
    const bool first = !odometry->sampled;
    if (!first && since_us == 0) {
        return; /* no new sample */
    }
    odometry->sampled = true;
    odometry->sampled_us = imu->sampled_us;
    if (at_rest(odometry, rate_rad_s, now_us)) {
        odometry->yaw_rate_rad_s = 0.0f;
        learn_bias(odometry, rate_rad_s);
        return;
    }
    forget_batches(odometry);
    if (!trusted(odometry)) {
        /* The rest was too short: its few samples may belong to the next motion. */
        odometry->rest_samples = 0;
        odometry->batches = 0;
        odometry->bias_rad_s = odometry->first_bias_rad_s;
        return;
    }
    odometry->yaw_rate_rad_s = rate_rad_s - odometry->bias_rad_s;
    if (!first && since_us <= IMU_GAP_US) {
        const float turned_rad = odometry->yaw_rate_rad_s * (float)since_us * 1e-6f;
        odometry->pose.heading_rad = wrapped(odometry->pose.heading_rad + turned_rad);
    }
}

/* Move the pose by the travel of both wheels. */
static void roll(odometry_t *odometry, float left_m, float right_m, float dt_s)
{
    const float travel_m = 0.5f * (left_m + right_m);
    const float turned_rad = (right_m - left_m) / odometry->wheel_base_m;
    if (dt_s > 0.0f) {
        odometry->v_m_s += SPEED_SHARE * (travel_m / dt_s - odometry->v_m_s);
        if (travel_m == 0.0f && turned_rad == 0.0f && absolute(odometry->v_m_s) < STANDS_M_S) {
            odometry->v_m_s = 0.0f;
        }
    }
    if (!trusted(odometry)) {
        odometry->pose.heading_rad = wrapped(odometry->mark_rad + turned_rad);
        if (dt_s > 0.0f) {
            odometry->yaw_rate_rad_s = turned_rad / dt_s;
        }
    }
    const float rotation_rad = wrapped(odometry->pose.heading_rad - odometry->mark_rad);
    const float half_rad = 0.5f * rotation_rad;
    const float chord_m = travel_m * (1.0f - half_rad * half_rad / 6.0f); /* roughly sin(x)/x */
    odometry->pose.x_m += chord_m * cosf(odometry->mark_rad + half_rad);
    odometry->pose.y_m += chord_m * sinf(odometry->mark_rad + half_rad);
    odometry->mark_rad = odometry->pose.heading_rad;
}

void odometry_encoders(odometry_t *odometry, board_encoders_t counts, int64_t now_us)
{
    if (odometry->counted) {
        const uint32_t since_us = counts.sampled_us - odometry->counts.sampled_us;
        const int16_t left = wrapped16((uint16_t)(counts.left - odometry->counts.left));
        const int16_t right = wrapped16((uint16_t)(counts.right - odometry->counts.right));
        if (left != 0 || right != 0) {
            odometry->turned = true;
            odometry->turned_us = now_us;
        }
        roll(odometry, (float)left * odometry->left_metres_per_count,
            (float)right * odometry->right_metres_per_count, (float)since_us * 1e-6f);
    }
    odometry->counted = true;
    odometry->counts = counts;
}
