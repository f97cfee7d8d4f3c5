#include "session.h"

#include <string.h>

#include "board.h"
#include "commands.h"

#define HOST_SILENCE_US 1000000
#define UNKNOWN_HELLO_PERIOD_US 100000

/* Capabilities of the core; the board adds its own. */
#define CAPABILITIES SP_CAPABILITY_ONBOARD_PLANNER

void session_imu_info(firmware_t *firmware, int64_t now_us)
{
    static const sp_imu_info_t info = {
        .accel = (uint32_t)(BOARD_IMU_PER_G * 10000.0f + 0.5f),
        .gyro = (uint32_t)(BOARD_IMU_PER_DEG_S * 10000.0f + 0.5f),
        .temperature = (uint32_t)(BOARD_IMU_PER_K * 10000.0f + 0.5f),
        .zero = (int16_t)(BOARD_IMU_ZERO_DEG_C * 100.0f + (BOARD_IMU_ZERO_DEG_C < 0.0f ? -0.5f : 0.5f)),
    };
    line_send(&firmware->line, SP_TYPE_IMU_INFO, (uint32_t)now_us,
        sp_imu_info_encode(&info, line_payload(&firmware->line), SP_PAYLOAD_MAX));
}

void session_hello(firmware_t *firmware, int64_t now_us)
{
    const board_identity_t *const identity = board_identity(firmware->board);
    sp_hello_t hello = {
        .catalogue_hash = sp_catalogue_hash(),
        .boot_id = identity->boot_id,
        .session_id = firmware->session_id,
        .reset_cause = identity->reset_cause,
        .capabilities = identity->capabilities | CAPABILITIES
            | (firmware->line.authentication.keyed ? SP_CAPABILITY_AUTHENTICATION : 0u),
        .version_major = FIRMWARE_VERSION_MAJOR,
        .version_minor = FIRMWARE_VERSION_MINOR,
        .version_patch = FIRMWARE_VERSION_PATCH,
        .name = identity->name,
        .name_length = (uint8_t)strlen(identity->name),
    };
    memcpy(hello.uid, identity->uid, sizeof hello.uid);
    line_send(&firmware->line, SP_TYPE_HELLO, (uint32_t)now_us,
        sp_hello_encode(&hello, line_payload(&firmware->line), SP_PAYLOAD_MAX));
    commands_challenge(firmware, now_us);
    if (firmware->negotiated) { /* sent before any IMU sample */
        session_imu_info(firmware, now_us);
    }
}

/* Send a hello (identity and boot id) to a host that uses an unknown session. */
static void answer_unknown_session(firmware_t *firmware, int64_t now_us)
{
    if (!firmware->unknown_hello || now_us - firmware->unknown_hello_us >= UNKNOWN_HELLO_PERIOD_US) {
        firmware->unknown_hello = true;
        firmware->unknown_hello_us = now_us;
        session_hello(firmware, now_us);
    }
}

/* Discard all requests of the session. */
static void forget_host(firmware_t *firmware)
{
    firmware->negotiated = false;
    control_forget_host(&firmware->control);
    freshness_reset(&firmware->freshness);
    schedule_reset(&firmware->schedule);
    payloads_reset(&firmware->payloads);
    line_forget_limits(&firmware->line);
}

static void report_troubles(firmware_t *firmware)
{
    const uint8_t troubles = board_identity(firmware->board)->troubles;
    if (troubles & BOARD_TROUBLE_CLOCK) {
        log_add(&firmware->control.log, SP_LOG_LEVEL_WARNING,
            "clock: no crystal; it runs from the chip's own oscillator, CAN is off");
    }
    if (troubles & BOARD_TROUBLE_FLASH) {
        log_add(&firmware->control.log, SP_LOG_LEVEL_WARNING,
            "flash: one bank only (option bit DB1M): parameters cannot be saved");
    }
}

static void log_crash(firmware_t *firmware)
{
    const board_crash_t *const crash = board_identity(firmware->board)->crash;
    if (crash == NULL) {
        return;
    }
    text_t *const line = log_begin(&firmware->control.log, SP_LOG_LEVEL_ERROR);
    text_add(line, "crash after ");
    text_add_number(line, crash->uptime_us / 1000u);
    text_add(line, " ms: pc 0x");
    text_add_hex(line, crash->pc);
    text_add(line, ", lr 0x");
    text_add_hex(line, crash->lr);
    text_add(line, ", cfsr 0x");
    text_add_hex(line, crash->cfsr);
}

/* Process a host's hello; return whether it opens or continues a session. */
static bool greet(firmware_t *firmware, const sp_host_hello_t *hello, const sp_frame_t *frame,
    int64_t now_us)
{
    if (hello->session_id == 0) {
        return false; /* 0 means "no session"; a lost link would not be detected */
    }
    if (hello->session_id != firmware->session_id
        && hello->boot_id != board_identity(firmware->board)->boot_id) {
        session_hello(firmware, now_us); /* the host does not know this boot yet: only reply */
        return false;
    }
    if (hello->session_id != firmware->session_id) {
        if (firmware->session_id != 0) {
            /* Another host, or a new session of the same host, must first clear the stop. */
            control_stop(&firmware->control, SP_STOP_CAUSE_LINK, EVENT_NEW_SESSION);
        }
        firmware->session_id = hello->session_id;
        line_new_host(&firmware->line, frame, (uint32_t)now_us);
        authentication_open(&firmware->line.authentication,
            board_identity(firmware->board)->boot_id, hello->session_id);
        forget_host(firmware);
    }
    if (hello->negotiated && !firmware->negotiated) {
        firmware->negotiated = true;
        firmware->received_us = now_us;
        text_t *const line = log_begin(&firmware->control.log, SP_LOG_LEVEL_INFO);
        text_add(line, "session with ");
        text_add_foreign(line, hello->name, hello->name_length);
        report_troubles(firmware);
        log_crash(firmware);
    }
    session_hello(firmware, now_us);
    return true;
}

static void reply_time(firmware_t *firmware, const sp_time_request_t *request, int64_t arrived_us)
{
    if (firmware->session_id == 0) {
        answer_unknown_session(firmware, arrived_us);
        return;
    }
    const sp_time_reply_t reply = {request->ping, (uint32_t)arrived_us};
    line_send(&firmware->line, SP_TYPE_TIME_REPLY, line_departure_us(&firmware->line),
        sp_time_reply_encode(&reply, line_payload(&firmware->line), SP_PAYLOAD_MAX));
}

static void describe(firmware_t *firmware, const sp_describe_t *question, int64_t now_us)
{
    sp_describe_reply_t reply;
    sp_describe(question, &reply);
    line_send(&firmware->line, SP_TYPE_DESCRIBE_REPLY, (uint32_t)now_us,
        sp_describe_reply_encode(&reply, line_payload(&firmware->line), SP_PAYLOAD_MAX));
    payloads_described(&firmware->payloads, question);
    if (sp_direction(question->described_type) == SP_FROM_HOST) {
        line_limit(&firmware->line, question->described_type,
            payloads_known(&firmware->payloads, question->described_type));
    }
}

static void describe_enum(
    firmware_t *firmware, const sp_describe_enum_t *question, int64_t now_us)
{
    sp_describe_enum_reply_t reply;
    sp_describe_enum(question, &reply);
    line_send(&firmware->line, SP_TYPE_DESCRIBE_ENUM_REPLY, (uint32_t)now_us,
        sp_describe_enum_reply_encode(&reply, line_payload(&firmware->line), SP_PAYLOAD_MAX));
}

/* Execute a stop, before any check of session or repetition. */
static void stop(firmware_t *firmware, const sp_stop_t *wanted, int64_t now_us)
{
    const sp_ack_t ack = {wanted->command_id, SP_TYPE_STOP};
    control_stop(&firmware->control, wanted->cause, EVENT_STOP);
    line_send(&firmware->line, SP_TYPE_ACK, (uint32_t)now_us,
        sp_ack_encode(&ack, line_payload(&firmware->line), SP_PAYLOAD_MAX));
}

static void setpoint(
    firmware_t *firmware, const sp_velocity_setpoint_t *wanted, int64_t extra, int64_t arrived_us)
{
    if (firmware->session_id == 0) {
        answer_unknown_session(firmware, arrived_us);
    } else if (firmware->negotiated && firmware->control.state == STATE_VELOCITY
        && !control_velocity(&firmware->control, wanted, extra, arrived_us)) {
        firmware->stale++;
    }
}

static void duty(
    firmware_t *firmware, const sp_wheel_duty_t *wanted, int64_t extra, int64_t arrived_us)
{
    if (firmware->negotiated && firmware->control.state == STATE_BRINGUP
        && !control_wheel_duty(&firmware->control, wanted, extra, arrived_us)) {
        firmware->stale++;
    }
}

static bool for_us(const firmware_t *firmware, const sp_frame_t *frame)
{
    return frame->node == board_identity(firmware->board)->node
        || (frame->node == SP_NODE_ALL && sp_to_all(frame->type));
}

void session_receive(firmware_t *firmware, sp_frame_t *frame, int64_t arrived_us)
{
    if (!payloads_fit(&firmware->payloads, frame)) {
        firmware->line.rejected++;
        return;
    }
    if (!for_us(firmware, frame)) {
        return;
    }
    const bool keyed = firmware->line.authentication.keyed;
    const bool tagged = (frame->flags & SP_FLAG_AUTHENTICATED) != 0;
    if (keyed && !tagged && sp_needs_tag(frame->type)) {
        commands_reject(firmware, frame, arrived_us); /* it does not keep the session alive */
        return;
    }
    const uint8_t *const payload = frame->payload;
    const size_t length = frame->length;
    union {
        sp_host_hello_t hello;
        sp_stop_t stop;
        sp_velocity_setpoint_t setpoint;
        sp_wheel_duty_t duty;
        sp_time_request_t time;
        sp_describe_t describe;
        sp_describe_enum_t describe_enum;
    } message;
    if (frame->type == SP_TYPE_STOP_ALL) {
        /* Accepted from any sender, so it does not keep the session alive. */
        control_stop(&firmware->control, SP_STOP_CAUSE_OPERATOR, EVENT_STOP);
        firmware->status_wanted = true;
        return;
    }
    if (frame->type == SP_TYPE_HOST_HELLO) {
        /* The first frame of a new session initialises the clock of the new host. */
        if (!sp_host_hello_decode(&message.hello, payload, length)
            || !greet(firmware, &message.hello, frame, arrived_us)) {
            return;
        }
    }
    if (tagged || !keyed || firmware->control.latch.cause != SP_STOP_CAUSE_NONE) {
        /* If a key is set and no stop is latched, only signed frames keep the session alive. */
        firmware->received_us = arrived_us;
    }
    if (frame->type == SP_TYPE_STOP) {
        /* A stop is accepted from any sender, so its delay does not change the freshness of
         * setpoints. */
        if (sp_stop_decode(&message.stop, payload, length)) {
            stop(firmware, &message.stop, arrived_us);
        }
        return;
    }
    /* With a key, frames without a tag do not change the freshness: an attacker could forge their
     * stamps, and a forged stamp could make a delayed setpoint look fresh. Messages without a tag
     * have no time to live. */
    const int64_t extra =
        keyed && !tagged ? 0 : freshness_extra(&firmware->freshness, frame->t_us, arrived_us);
    switch (frame->type) {
    case SP_TYPE_HOST_HELLO:
        break;
    case SP_TYPE_VELOCITY_SETPOINT:
        if (sp_velocity_setpoint_decode(&message.setpoint, payload, length)) {
            setpoint(firmware, &message.setpoint, extra, arrived_us);
        }
        break;
    case SP_TYPE_WHEEL_DUTY:
        if (sp_wheel_duty_decode(&message.duty, payload, length)) {
            duty(firmware, &message.duty, extra, arrived_us);
        }
        break;
    case SP_TYPE_TIME_REQUEST:
        if (sp_time_request_decode(&message.time, payload, length)) {
            reply_time(firmware, &message.time, arrived_us);
        }
        break;
    case SP_TYPE_DESCRIBE:
        if (sp_describe_decode(&message.describe, payload, length)) {
            describe(firmware, &message.describe, arrived_us);
        }
        break;
    case SP_TYPE_DESCRIBE_ENUM:
        if (sp_describe_enum_decode(&message.describe_enum, payload, length)) {
            describe_enum(firmware, &message.describe_enum, arrived_us);
        }
        break;
    default:
        commands_receive(firmware, frame, arrived_us);
        break;
    }
}

void session_tick(firmware_t *firmware)
{
    if (firmware->session_id != 0 && firmware->now_us - firmware->received_us > HOST_SILENCE_US) {
        /* The host is lost: make the robot safe, and send hellos until a host answers. */
        control_stop(&firmware->control, SP_STOP_CAUSE_LINK, EVENT_SILENCE);
        firmware->session_id = 0;
        authentication_close(&firmware->line.authentication);
        forget_host(firmware);
    }
}
