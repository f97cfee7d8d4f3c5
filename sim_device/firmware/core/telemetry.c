#include "telemetry.h"

#include "board.h"

#define NOTHING_NEAR 255u
#define INFRARED_MAX 254u
#define TIME_TO_LIVE_MS_MAX 250u

typedef struct {
    int length; /* of the payload; -1: nothing to send */
    uint32_t t_us;
} encoded_t;

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

/* Milliseconds to the nearest from the ultrasonic pulse to the stamp of the infrared ranges; a pulse
 * after it is no older than they are. */
static uint8_t ultrasonic_age(const board_ranges_t *ranges)
{
    const uint32_t age_us = ranges->sampled_us - ranges->ultrasonic_us;
    return age_us > INT32_MAX ? 0u : at_most_255((age_us + 500u) / 1000u);
}

static encoded_t range(firmware_t *firmware, uint8_t *payload)
{
    const around_t *const around = readings_around(&firmware->readings);
    const sp_range_t message = {around->ranges.ultrasonic_mm,
        infrared(around->ranges.infrared_left_dmm), infrared(around->ranges.infrared_right_dmm),
        around->contacts, ultrasonic_age(&around->ranges)};
    const encoded_t encoded = {
        sp_range_encode(&message, payload, SP_PAYLOAD_MAX), around->ranges.sampled_us};
    return encoded;
}

static encoded_t power(const firmware_t *firmware, uint8_t *payload)
{
    const board_power_t *const power = &firmware->control.power;
    const sp_power_t message = {power->battery_mv, at_most_255((power->logic_mv + 12u) / 25u),
        at_most_255((power->motor_left_ma + 10u) / 20u),
        at_most_255((power->motor_right_ma + 10u) / 20u)};
    const encoded_t encoded = {
        sp_power_encode(&message, payload, SP_PAYLOAD_MAX), power->sampled_us};
    return encoded;
}

/* Each sample is sent once. If the chip's clock is slower than ours, some periods have none. */
static encoded_t imu(firmware_t *firmware, uint8_t *payload)
{
    const board_imu_t *const imu = &firmware->readings.imu;
    const bool told = firmware->imu_told && firmware->imu_told_us == imu->sampled_us;
    firmware->imu_told = true;
    firmware->imu_told_us = imu->sampled_us;
    const sp_imu_t message = {imu->accel_x, imu->accel_y, imu->accel_z, imu->temperature,
        imu->gyro_x, imu->gyro_y, imu->gyro_z};
    const encoded_t encoded = {
        told ? -1 : sp_imu_encode(&message, payload, SP_PAYLOAD_MAX), imu->sampled_us};
    return encoded;
}

static encoded_t encoders(const firmware_t *firmware, uint8_t *payload)
{
    const readings_t *const readings = &firmware->readings;
    const sp_encoders_t message = {readings->counts.left, readings->counts.right};
    const encoded_t encoded = {
        sp_encoders_encode(&message, payload, SP_PAYLOAD_MAX), readings->counts.sampled_us};
    return encoded;
}

static int status(const firmware_t *firmware, uint8_t *payload)
{
    const control_t *const control = &firmware->control;
    const uint32_t left_ms =
        watchdog_left_us(control_watchdog(control), firmware->now_us) / 1000u;
    const sp_status_t message = {modes_wire_mode(control->state), control->latch.cause,
        control_faults(control),
        (uint8_t)(left_ms < TIME_TO_LIVE_MS_MAX ? left_ms : TIME_TO_LIVE_MS_MAX),
        firmware->load_percent};
    return sp_status_encode(&message, payload, SP_PAYLOAD_MAX);
}

static int link_counters(const firmware_t *firmware, uint8_t *payload)
{
    board_can_health_t can = {0};
    board_can_health(firmware->board, &can);
    const sp_link_counters_t message = {(uint16_t)firmware->line.intact,
        (uint16_t)line_damaged(&firmware->line), firmware->stale,
        (uint16_t)firmware->inbox.dropped, (uint16_t)firmware->line.dropped, can.send_errors,
        can.receive_errors, can.offs};
    return sp_link_counters_encode(&message, payload, SP_PAYLOAD_MAX);
}

static int planner_state(const firmware_t *firmware, uint8_t *payload)
{
    sp_planner_state_t message;
    control_planner_state(&firmware->control, &message);
    return sp_planner_state_encode(&message, payload, SP_PAYLOAD_MAX);
}

void telemetry_send(firmware_t *firmware, stream_t stream)
{
    static const uint8_t types[STREAMS] = {SP_TYPE_SYNC, SP_TYPE_STATUS, SP_TYPE_IMU,
        SP_TYPE_ENCODERS, SP_TYPE_RANGE, SP_TYPE_POWER, SP_TYPE_LINK_COUNTERS,
        SP_TYPE_PLANNER_STATE};
    uint8_t *const payload = line_payload(&firmware->line);
    const sp_sync_t sync = {line_sent(&firmware->line) + 1u};
    encoded_t encoded = {-1, (uint32_t)firmware->now_us};
    switch (stream) {
    case STREAM_SYNC:
        encoded.length = sp_sync_encode(&sync, payload, SP_PAYLOAD_MAX);
        break;
    case STREAM_STATUS:
        encoded.length = status(firmware, payload);
        break;
    case STREAM_IMU:
        encoded = imu(firmware, payload);
        break;
    case STREAM_ENCODERS:
        encoded = encoders(firmware, payload);
        break;
    case STREAM_RANGE:
        encoded = range(firmware, payload);
        break;
    case STREAM_POWER:
        encoded = power(firmware, payload);
        break;
    case STREAM_LINK_COUNTERS:
        encoded.length = link_counters(firmware, payload);
        break;
    case STREAM_PLANNER_STATE:
        encoded.length = planner_state(firmware, payload);
        break;
    case STREAMS:
        return;
    }
    line_stream(&firmware->line, types[stream], encoded.t_us, encoded.length);
}

void telemetry_measure_load(firmware_t *firmware)
{
    const uint32_t busy_us = board_busy_us(firmware->board);
    const uint32_t window_us = (uint32_t)(firmware->now_us - firmware->load_at_us);
    if (window_us != 0) {
        const uint32_t percent =
            ((busy_us - firmware->load_busy_us) * 100u + window_us / 2u) / window_us;
        firmware->load_percent = (uint8_t)(percent < 100u ? percent : 100u);
    }
    firmware->load_busy_us = busy_us;
    firmware->load_at_us = firmware->now_us;
}
