#include "streams.h"

#include "board.h"

#define NOTHING_NEAR 255u
#define INFRARED_MAX 254u
#define TIME_TO_LIVE_MS_MAX 250u

static uint8_t at_most_255(uint32_t value)
{
    return (uint8_t)(value < 255u ? value : 255u);
}

/* Convert tenths of a millimetre to steps of 1.25 mm, rounded. */
static uint8_t infrared(uint16_t range_dmm)
{
    if (!seen(range_dmm)) {
        return NOTHING_NEAR;
    }
    const uint32_t steps = (range_dmm * 2u + 12u) / 25u;
    return (uint8_t)(steps < INFRARED_MAX ? steps : INFRARED_MAX);
}

/* Return the time from the ultrasonic pulse to the stamp of the infrared ranges, rounded to
 * milliseconds; 0 if the pulse is newer. */
static uint8_t ultrasonic_age(const board_ranges_t *ranges)
{
    const uint32_t age_us = ranges->sampled_us - ranges->ultrasonic_us;
    return age_us > INT32_MAX ? 0u : at_most_255((age_us + 500u) / 1000u);
}

bool stream_sync(firmware_t *firmware, sp_sync_t *message, uint32_t *sampled_us)
{
    (void)sampled_us;
    message->frame_count = line_sent(&firmware->line) + 1u;
    return true;
}

bool stream_status(firmware_t *firmware, sp_status_t *message, uint32_t *sampled_us)
{
    const control_t *const control = &firmware->control;
    const uint32_t left_ms =
        watchdog_left_us(control_watchdog(control), firmware->now_us) / 1000u;
    (void)sampled_us;
    message->mode = modes_wire_mode(control->state);
    message->stop_cause = control->latch.cause;
    message->faults = control_faults(control);
    message->setpoint_remaining =
        (uint8_t)(left_ms < TIME_TO_LIVE_MS_MAX ? left_ms : TIME_TO_LIVE_MS_MAX);
    message->load = firmware->load_percent;
    return true;
}

/* Each IMU sample is sent once. If the IMU's clock is slower than our clock, some periods have no
 * new sample. */
bool stream_imu(firmware_t *firmware, sp_imu_t *message, uint32_t *sampled_us)
{
    const board_imu_t *const imu = &firmware->readings.imu;
    if (firmware->imu_sent && firmware->imu_sent_us == imu->sampled_us) {
        return false;
    }
    firmware->imu_sent = true;
    firmware->imu_sent_us = *sampled_us = imu->sampled_us;
    message->accel_x = imu->accel_x;
    message->accel_y = imu->accel_y;
    message->accel_z = imu->accel_z;
    message->temperature = imu->temperature;
    message->gyro_x = imu->gyro_x;
    message->gyro_y = imu->gyro_y;
    message->gyro_z = imu->gyro_z;
    return true;
}

bool stream_encoders(firmware_t *firmware, sp_encoders_t *message, uint32_t *sampled_us)
{
    const board_encoders_t *const counts = &firmware->readings.counts;
    *sampled_us = counts->sampled_us;
    message->left = counts->left;
    message->right = counts->right;
    return true;
}

bool stream_range(firmware_t *firmware, sp_range_t *message, uint32_t *sampled_us)
{
    const around_t *const around = readings_around(&firmware->readings);
    *sampled_us = around->ranges.sampled_us;
    message->ultrasonic = around->ranges.ultrasonic_mm;
    message->infrared_left = infrared(around->ranges.infrared_left_dmm);
    message->infrared_right = infrared(around->ranges.infrared_right_dmm);
    message->contacts = around->contacts;
    message->ultrasonic_age = ultrasonic_age(&around->ranges);
    return true;
}

bool stream_power(firmware_t *firmware, sp_power_t *message, uint32_t *sampled_us)
{
    const board_power_t *const power = &firmware->control.power;
    *sampled_us = power->sampled_us;
    message->battery = power->battery_mv;
    message->logic = at_most_255((power->logic_mv + 12u) / 25u);
    message->motor_left = at_most_255((power->motor_left_ma + 10u) / 20u);
    message->motor_right = at_most_255((power->motor_right_ma + 10u) / 20u);
    return true;
}

bool stream_link_counters(firmware_t *firmware, sp_link_counters_t *message, uint32_t *sampled_us)
{
    board_can_health_t can = {0};
    board_can_health(firmware->board, &can);
    (void)sampled_us;
    message->received = (uint16_t)firmware->line.intact;
    message->damaged = (uint16_t)line_damaged(&firmware->line);
    message->stale = firmware->stale;
    message->receive_dropped = (uint16_t)firmware->inbox.dropped;
    message->send_dropped = (uint16_t)firmware->line.dropped;
    message->can_send_errors = can.send_errors;
    message->can_receive_errors = can.receive_errors;
    message->can_bus_offs = can.offs;
    return true;
}

bool stream_planner_state(firmware_t *firmware, sp_planner_state_t *message, uint32_t *sampled_us)
{
    (void)sampled_us;
    control_planner_state(&firmware->control, message);
    return true;
}
