/* A complete device on top of the generated C: hellos until a handshake, streams, setpoints with
 * a time to live, commands that are executed once, and a stop that stays latched.
 *
 * Build it with sweepctl_protocol.c (`sweepctl generate c --out DIR`) and your own board.h
 * functions. Everything runs in one loop; nothing here is called from an interrupt.
 */
#include "board.h"
#include "sweepctl_protocol.h"

#define NODE 1u
#define TICK_US 10000u
#define TICKS_PER_SECOND 100u
#define HOST_SILENCE_US 1000000u
#define MAX_TIME_TO_LIVE_US 250000
#define REMEMBERED 16u
#define DRIFT 4000u /* 250 ppm: two crystals differ by less */

static const char NAME[] = "example device";

/* Reply to a command. A repeated command gets it again and is not executed again. */
typedef struct {
    uint32_t session_id;
    uint16_t command_id;
    uint8_t type;
    bool used;
    bool accepted;
    uint8_t reason;
} reply_t;

static struct {
    sp_parser_t parser;
    sp_sender_t sender;
    uint8_t frame[SP_FRAME_MAX];
    uint32_t boot_id;

    uint32_t session_id; /* 0: none */
    bool negotiated;
    uint32_t heard_us;

    uint8_t mode;
    uint8_t stop_cause;
    uint16_t faults;

    sp_velocity_setpoint_t setpoint;
    bool setpoint_live;
    bool counter_known;
    uint32_t until_us;
    uint16_t stale;

    bool delay_known;
    uint32_t min_delay_us; /* of the session's fastest frame: arrival minus host stamp */
    uint32_t delay_at_us;

    reply_t replies[REMEMBERED];
    uint8_t next_reply;
} device;

/* ---- sending -------------------------------------------------------------------------------- */

static void put(size_t length)
{
    /* On an idle line a zero is sent first, so that the rest of an interrupted frame does not
     * damage this one. */
    const size_t skip = board_line_idle() ? 0u : 1u;
    if (length != 0) {
        board_write(device.frame + skip, length - skip);
    }
}

/* Encode a message into the frame buffer and send it. */
#define SEND(name, t_us, message) \
    put(sp_##name##_frame(device.frame, &device.sender, (t_us), (message)))

/* Send the scale of the IMU's counts: an MPU6050 at +-2 g and +-250 deg/s. */
static void send_imu_info(uint32_t now_us)
{
    const sp_imu_info_t info = {
        .accel = 163840000u, .gyro = 1310000u, .temperature = 3400000u, .zero = 3653};
    SEND(imu_info, now_us, &info);
}

static void send_hello(uint32_t now_us)
{
    sp_hello_t hello = {
        .catalogue_hash = sp_catalogue_hash(),
        .boot_id = device.boot_id,
        .session_id = device.session_id,
        .reset_cause = SP_RESET_CAUSE_POWER_ON,
        .capabilities = SP_CAPABILITY_ENCODERS | SP_CAPABILITY_IMU,
        .version_major = 1,
        .name = NAME,
        .name_length = sizeof NAME - 1,
    };
    board_uid(hello.uid);
    SEND(hello, now_us, &hello);
    if (device.negotiated) {
        send_imu_info(now_us);
    }
}

static void send_status(uint32_t now_us)
{
    const uint32_t left_us = device.setpoint_live ? device.until_us - now_us : 0u;
    const sp_status_t status = {device.mode, device.stop_cause, device.faults,
        (uint8_t)(left_us / 1000u), 0};
    SEND(status, now_us, &status);
}

/* ---- safety --------------------------------------------------------------------------------- */

static void release_motion(void)
{
    device.setpoint_live = false;
    board_drive(0.0f, 0.0f);
}

/* A graver cause replaces a lesser one. */
static void latch(uint8_t cause)
{
    device.stop_cause = sp_latched_cause(device.stop_cause, cause);
    device.mode = SP_MODE_IDLE;
    release_motion();
}

static void link_lost(void)
{
    if (device.stop_cause == SP_STOP_CAUSE_NONE) {
        latch(SP_STOP_CAUSE_LINK);
    }
    device.mode = SP_MODE_IDLE;
    release_motion();
    device.negotiated = false;
    device.delay_known = false;
    device.counter_known = false;
}

/* Return the frame's delay beyond the session's fastest frame. */
static int32_t extra_delay_us(uint32_t host_us, uint32_t now_us)
{
    const uint32_t delay_us = now_us - host_us;
    if (!device.delay_known) {
        device.delay_known = true;
        device.min_delay_us = delay_us;
        device.delay_at_us = now_us;
        return 0;
    }
    const uint32_t aged_by = (now_us - device.delay_at_us) / DRIFT;
    device.min_delay_us += aged_by;
    device.delay_at_us += aged_by * DRIFT;
    if (delay_us - device.min_delay_us >= 0x80000000u) { /* faster than all before */
        device.min_delay_us = delay_us;
    }
    const uint32_t extra_us = delay_us - device.min_delay_us;
    return extra_us < 0x7FFFFFFFu ? (int32_t)extra_us : 0x7FFFFFFF;
}

static void take_setpoint(const sp_velocity_setpoint_t *setpoint, int32_t extra_us, uint32_t now_us)
{
    const uint8_t advance = (uint8_t)(setpoint->counter - device.setpoint.counter);
    int32_t live_us = setpoint->time_to_live * 1000;
    if (live_us > MAX_TIME_TO_LIVE_US) {
        live_us = MAX_TIME_TO_LIVE_US;
    }
    if (device.mode != SP_MODE_VELOCITY || !device.negotiated) {
        return;
    }
    if ((device.counter_known && (advance == 0 || advance >= 128)) || live_us <= extra_us) {
        device.stale++;
        return;
    }
    device.setpoint = *setpoint;
    device.counter_known = true;
    device.setpoint_live = true;
    device.until_us = now_us + (uint32_t)(live_us - extra_us);
    device.faults &= (uint16_t)~SP_FAULT_SETPOINT_EXPIRED;
    board_drive(sp_velocity_setpoint_v_m_s(setpoint), sp_velocity_setpoint_yaw_rate_rad_s(setpoint));
}

/* ---- commands ------------------------------------------------------------------------------- */

static bool reject(uint8_t why, uint8_t *reason)
{
    *reason = why;
    return false;
}

static bool carry_out(const sp_frame_t *frame, uint8_t *reason)
{
    sp_clear_stop_t clear;
    sp_set_mode_t set;
    if (!device.negotiated) {
        return reject(SP_NACK_REASON_NO_SESSION, reason);
    }
    if (frame->type == SP_TYPE_CLEAR_STOP) {
        if (!sp_clear_stop_decode(&clear, frame->payload, frame->length)) {
            return reject(SP_NACK_REASON_BAD_VALUE, reason);
        }
        if (device.stop_cause != SP_STOP_CAUSE_NONE && device.stop_cause != clear.cause) {
            return reject(SP_NACK_REASON_OTHER_CAUSE, reason);
        }
        device.stop_cause = SP_STOP_CAUSE_NONE;
        return true;
    }
    if (frame->type == SP_TYPE_SET_MODE) {
        if (!sp_set_mode_decode(&set, frame->payload, frame->length)
            || (set.mode != SP_MODE_IDLE && set.mode != SP_MODE_VELOCITY)) {
            return reject(SP_NACK_REASON_BAD_VALUE, reason);
        }
        if (set.mode != SP_MODE_IDLE && device.stop_cause != SP_STOP_CAUSE_NONE) {
            return reject(SP_NACK_REASON_STOP_LATCHED, reason);
        }
        device.mode = set.mode;
        release_motion();
        return true;
    }
    return reject(SP_NACK_REASON_UNSUPPORTED, reason);
}

static void answer(const reply_t *reply, uint32_t now_us)
{
    if (reply->accepted) {
        const sp_ack_t ack = {reply->command_id, reply->type};
        SEND(ack, now_us, &ack);
    } else {
        const sp_nack_t nack = {reply->command_id, reply->type, reply->reason};
        SEND(nack, now_us, &nack);
    }
}

static void command(const sp_frame_t *frame, uint32_t now_us)
{
    if (frame->length < 2) {
        return;
    }
    /* Every command begins with its id. */
    const uint16_t id = (uint16_t)(frame->payload[0] | frame->payload[1] << 8);
    for (uint8_t i = 0; i < REMEMBERED; i++) {
        const reply_t *const known = &device.replies[i];
        if (known->used && known->session_id == device.session_id && known->command_id == id
            && known->type == frame->type) {
            answer(known, now_us);
            return;
        }
    }
    reply_t *const reply = &device.replies[device.next_reply];
    device.next_reply = (uint8_t)((device.next_reply + 1u) % REMEMBERED);
    reply->used = true;
    reply->session_id = device.session_id;
    reply->command_id = id;
    reply->type = frame->type;
    reply->accepted = carry_out(frame, &reply->reason);
    answer(reply, now_us);
}

/* ---- receiving ------------------------------------------------------------------------------ */

/* Return whether the hello belongs to the session. */
static bool greet(const sp_host_hello_t *hello, uint32_t now_us)
{
    if (hello->session_id == 0) {
        return false;
    }
    if (hello->session_id != device.session_id && hello->boot_id != device.boot_id) {
        send_hello(now_us); /* a first hello, or one for another boot: only an answer */
        return false;
    }
    if (hello->session_id != device.session_id) {
        if (device.session_id != 0) {
            link_lost(); /* another host or a new session: it must clear the stop first */
        }
        device.session_id = hello->session_id;
        device.negotiated = false;
    }
    device.negotiated = device.negotiated || (hello->negotiated & 1u);
    send_hello(now_us);
    return true;
}

static void handle(const sp_frame_t *frame, uint32_t now_us)
{
    const bool for_us =
        frame->node == NODE || (frame->node == SP_NODE_ALL && sp_to_all(frame->type));
    if (frame->version != SP_VERSION || !for_us
        || sp_direction(frame->type) != SP_FROM_HOST) {
        return;
    }
    if (frame->type == SP_TYPE_STOP_ALL) { /* from any sender: it keeps no session alive */
        latch(SP_STOP_CAUSE_OPERATOR);
        send_status(now_us);
        return;
    }
    if (frame->type == SP_TYPE_HOST_HELLO) {
        sp_host_hello_t hello;
        if (!sp_host_hello_decode(&hello, frame->payload, frame->length)
            || !greet(&hello, now_us)) {
            return;
        }
    }
    device.heard_us = now_us;
    if (frame->type == SP_TYPE_STOP) { /* before any check of session or repetition */
        sp_stop_t stop;
        if (sp_stop_decode(&stop, frame->payload, frame->length)) {
            const sp_ack_t ack = {stop.command_id, SP_TYPE_STOP};
            latch(stop.cause);
            SEND(ack, now_us, &ack);
        }
        return; /* from any sender: its delay is not the session's */
    }
    const int32_t extra_us = extra_delay_us(frame->t_us, now_us);
    switch (frame->type) {
    case SP_TYPE_HOST_HELLO:
        break;
    case SP_TYPE_VELOCITY_SETPOINT: {
        sp_velocity_setpoint_t setpoint;
        if (sp_velocity_setpoint_decode(&setpoint, frame->payload, frame->length)) {
            take_setpoint(&setpoint, extra_us, now_us);
        }
        break;
    }
    case SP_TYPE_TIME_REQUEST: {
        sp_time_request_t request;
        if (sp_time_request_decode(&request, frame->payload, frame->length)) {
            const sp_time_reply_t reply = {request.ping, now_us};
            SEND(time_reply, board_time_us(), &reply);
        }
        break;
    }
    case SP_TYPE_DESCRIBE: {
        sp_describe_t question;
        if (sp_describe_decode(&question, frame->payload, frame->length)) {
            sp_describe_reply_t reply;
            sp_describe(&question, &reply);
            SEND(describe_reply, now_us, &reply);
        }
        break;
    }
    case SP_TYPE_DESCRIBE_ENUM: {
        sp_describe_enum_t question;
        if (sp_describe_enum_decode(&question, frame->payload, frame->length)) {
            sp_describe_enum_reply_t reply;
            sp_describe_enum(&question, &reply);
            SEND(describe_enum_reply, now_us, &reply);
        }
        break;
    }
#if SP_WITH_WHEEL_DUTY
    case SP_TYPE_WHEEL_DUTY: /* a stream without an answer; there is no bring-up mode here */
        break;
#endif
    default:
        command(frame, now_us);
        break;
    }
}

/* ---- the loop ------------------------------------------------------------------------------- */

static void stream(uint32_t tick, uint32_t now_us)
{
    sp_imu_t imu;
    int16_t raw[7];
    board_imu(raw);
    imu.accel_x = raw[0];
    imu.accel_y = raw[1];
    imu.accel_z = raw[2];
    imu.temperature = raw[3];
    imu.gyro_x = raw[4];
    imu.gyro_y = raw[5];
    imu.gyro_z = raw[6];
    SEND(imu, now_us, &imu);
    if (tick % TICKS_PER_SECOND == 0) {
        send_imu_info(now_us);
    }
    if (tick % (TICKS_PER_SECOND / SP_ENCODERS_HZ) == 0) {
        sp_encoders_t encoders;
        board_encoders(&encoders.left, &encoders.right);
        SEND(encoders, now_us, &encoders);
    }
    if (tick % (TICKS_PER_SECOND / SP_STATUS_HZ) == 0) {
        send_status(now_us);
    }
#if SP_WITH_SYNC
    if (tick % (TICKS_PER_SECOND / SP_SYNC_HZ) == 0) {
        const sp_sync_t sync = {device.sender.frames + 1u};
        SEND(sync, now_us, &sync);
    }
#endif
#if SP_WITH_LINK_COUNTERS
    if (tick % (TICKS_PER_SECOND / SP_LINK_COUNTERS_HZ) == 0) {
        const sp_link_counters_t counters = {(uint16_t)device.parser.frames,
            (uint16_t)device.parser.damaged, device.stale, 0, 0, 0, 0, 0};
        SEND(link_counters, now_us, &counters);
    }
#endif
}

static void control(uint32_t tick, uint32_t now_us)
{
    if (device.session_id != 0 && now_us - device.heard_us > HOST_SILENCE_US) {
        link_lost();
        device.session_id = 0;
    }
    if (device.setpoint_live && now_us - device.until_us < 0x80000000u) {
        device.faults |= SP_FAULT_SETPOINT_EXPIRED;
        release_motion(); /* no latch: new setpoints move the robot again */
    }
    if (device.negotiated) {
        stream(tick, now_us);
    } else if (tick % TICKS_PER_SECOND == 0) {
        send_hello(now_us);
    }
}

int main(void)
{
    uint8_t bytes[64];
    uint32_t tick = 0;
    uint32_t due_us = board_time_us();
    device.sender.node = NODE;
    device.boot_id = board_random();
    device.stop_cause = SP_STOP_CAUSE_SESSION_END; /* it moves only after a clear */
    while (board_wait()) {
        size_t length;
        while ((length = board_read(bytes, sizeof bytes)) != 0) {
            for (size_t at = 0; at < length;) {
                sp_frame_t frame;
                sp_event_t event;
                at += sp_parser_block(&device.parser, bytes + at, length - at, &frame, &event);
                if (event == SP_FRAME) {
                    handle(&frame, board_time_us());
                }
            }
        }
        while (board_time_us() - due_us < 0x80000000u) {
            control(tick, board_time_us());
            tick++;
            due_us += TICK_US;
        }
    }
    return 0;
}
