#include "commands.h"

/* Maximum rate of a stream, tenths of a hertz, from the declaration of set_stream_rate. A rate
 * above the control rate means one message per control period. */
#define RATE_MAX 10000u
/* Minimum rate of the sync message, tenths of a hertz: 4 Hz. On CAN a receiver can extend a stamp
 * only within 0.5 s after a sync message. At 4 Hz this holds even if one sync message is lost. */
#define SYNC_RATE_MIN 40u

#define DONE (-1)

/* Each function executes one command; it returns DONE or SP_NACK_REASON_*. */

/* The payload of every command begins with its id. */
static uint16_t id_of(const sp_frame_t *frame)
{
    return (uint16_t)(frame->payload[0] | frame->payload[1] << 8);
}

static int clear_stop(firmware_t *firmware, const sp_frame_t *frame)
{
    sp_clear_stop_t clear;
    if (!sp_clear_stop_decode(&clear, frame->payload, frame->length)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    return control_clear(&firmware->control, clear.cause);
}

static int set_mode(firmware_t *firmware, const sp_frame_t *frame)
{
    static const uint8_t events[] = {
        [SP_MODE_IDLE] = EVENT_SET_IDLE,
        [SP_MODE_VELOCITY] = EVENT_SET_VELOCITY,
        [SP_MODE_BRINGUP] = EVENT_SET_BRINGUP,
        [SP_MODE_ONBOARD] = EVENT_SET_ONBOARD,
    };
    sp_set_mode_t set;
    if (!sp_set_mode_decode(&set, frame->payload, frame->length)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    if (set.mode >= sizeof events) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    return control_fire(&firmware->control, (event_t)events[set.mode], 0);
}

static int plan(firmware_t *firmware, const sp_frame_t *frame)
{
    sp_planner_command_t command;
    if (!sp_planner_command_decode(&command, frame->payload, frame->length)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    switch (command.action) {
    case SP_PLANNER_ACTION_START:
        return control_start_planner(&firmware->control, command.planner);
    case SP_PLANNER_ACTION_PAUSE:
        return control_fire(&firmware->control, EVENT_PAUSE, 0);
    case SP_PLANNER_ACTION_RESUME:
        return control_fire(&firmware->control, EVENT_RESUME, 0);
    case SP_PLANNER_ACTION_ABORT:
        return control_fire(&firmware->control, EVENT_ABORT, 0);
    default:
        return SP_NACK_REASON_BAD_VALUE;
    }
}

static int get_parameter(const sp_frame_t *frame)
{
    sp_get_parameter_t get;
    if (!sp_get_parameter_decode(&get, frame->payload, frame->length)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    return get.parameter < PARAMETERS ? DONE : SP_NACK_REASON_UNKNOWN_PARAMETER;
}

static int set_parameter(firmware_t *firmware, const sp_frame_t *frame)
{
    sp_set_parameter_t set;
    if (!sp_set_parameter_decode(&set, frame->payload, frame->length)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    const int reason = parameters_set(&firmware->parameters, set.parameter, set.kind, set.value);
    if (reason == DONE) {
        control_apply(&firmware->control, &firmware->parameters);
    }
    return reason;
}

static bool idle(const firmware_t *firmware)
{
    return modes_wire_mode(firmware->control.state) == SP_MODE_IDLE;
}

static int save_parameters(firmware_t *firmware)
{
    if (board_identity(firmware->board)->troubles & BOARD_TROUBLE_FLASH) {
        return SP_NACK_REASON_UNSUPPORTED;
    }
    /* While the robot drives, only the control loop may use the flash bus. */
    if (!idle(firmware)) {
        return SP_NACK_REASON_OTHER_MODE;
    }
    parameters_image(&firmware->parameters, firmware->saving);
    for (unsigned i = 0; i < KEY_WORDS; i++) {
        const stored_t word = {firmware->line.authentication.words[i], true};
        firmware->saving[PARAMETERS + i] = word;
    }
    flash_store_begin(&firmware->flash, firmware->board, firmware->saving);
    return DONE;
}

/* Save the key together with the stored parameters, not with the present parameters. The device
 * uses the key after it is stored. */
static int set_key(firmware_t *firmware, const sp_frame_t *frame)
{
    sp_set_key_t set;
    if (!sp_set_key_decode(&set, frame->payload, frame->length)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    if (!idle(firmware)) {
        return SP_NACK_REASON_OTHER_MODE;
    }
    /* A key is accepted only over a local link, because its user is beside the robot. */
    if (firmware->line.can
        || (board_identity(firmware->board)->troubles
               & (BOARD_TROUBLE_FLASH | BOARD_TROUBLE_REMOTE)) != 0) {
        return SP_NACK_REASON_UNSUPPORTED;
    }
    const uint32_t words[KEY_WORDS] = {set.key_0, set.key_1, set.key_2, set.key_3};
    parameters_stored(&firmware->parameters, firmware->saving);
    for (unsigned i = 0; i < KEY_WORDS; i++) {
        const stored_t word = {words[i], true};
        firmware->saving[PARAMETERS + i] = word;
    }
    flash_store_begin(&firmware->flash, firmware->board, firmware->saving);
    return DONE;
}

static int set_stream_rate(firmware_t *firmware, const sp_frame_t *frame)
{
    sp_set_stream_rate_t set;
    if (!sp_set_stream_rate_decode(&set, frame->payload, frame->length)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    const stream_t stream = schedule_stream(set.stream_type);
    if (stream == STREAMS || set.rate > RATE_MAX
        || (stream == STREAM_SYNC && set.rate < SYNC_RATE_MIN)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    schedule_set_rate(&firmware->schedule, stream, set.rate);
    return DONE;
}

static int reboot(firmware_t *firmware, const sp_frame_t *frame)
{
    sp_reboot_t wanted;
    if (!sp_reboot_decode(&wanted, frame->payload, frame->length)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    if (wanted.kind != SP_REBOOT_KIND_NORMAL && wanted.kind != SP_REBOOT_KIND_FACTORY_RESET) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    if (!idle(firmware) || flash_store_busy(&firmware->flash)) {
        return SP_NACK_REASON_OTHER_MODE;
    }
    if (wheels_moving(&firmware->control.wheels)) {
        return SP_NACK_REASON_FAULT;
    }
    firmware->reboot_wanted = true;
    firmware->factory_reset = wanted.kind == SP_REBOOT_KIND_FACTORY_RESET;
    return DONE;
}

/* The length of the payload has already been checked. */
static int execute(firmware_t *firmware, const sp_frame_t *frame)
{
    if (!firmware->negotiated) {
        return SP_NACK_REASON_NO_SESSION;
    }
    switch (frame->type) {
    case SP_TYPE_CLEAR_STOP:
        return clear_stop(firmware, frame);
    case SP_TYPE_SET_MODE:
        return set_mode(firmware, frame);
    case SP_TYPE_PLANNER_COMMAND:
        return plan(firmware, frame);
    case SP_TYPE_GET_PARAMETER:
        return get_parameter(frame);
    case SP_TYPE_SET_PARAMETER:
        return set_parameter(firmware, frame);
    case SP_TYPE_SAVE_PARAMETERS:
        return save_parameters(firmware);
    case SP_TYPE_SET_STREAM_RATE:
        return set_stream_rate(firmware, frame);
    case SP_TYPE_REBOOT:
        return reboot(firmware, frame);
    case SP_TYPE_SET_KEY:
        return set_key(firmware, frame);
    default:
        return SP_NACK_REASON_UNKNOWN_COMMAND;
    }
}

void commands_answer(firmware_t *firmware, const reply_t *reply, int64_t now_us)
{
    uint8_t *const payload = line_payload(&firmware->line);
    const bool with_value =
        reply->type == SP_TYPE_GET_PARAMETER || reply->type == SP_TYPE_SET_PARAMETER;
    if (reply->accepted) {
        const sp_ack_t ack = {reply->command_id, reply->type};
        line_send_after(&firmware->line, SP_TYPE_ACK,
            with_value ? SP_TYPE_PARAMETER_VALUE : SP_TYPE_ACK, (uint32_t)now_us,
            sp_ack_encode(&ack, payload, SP_PAYLOAD_MAX));
    } else {
        const sp_nack_t nack = {reply->command_id, reply->type, reply->reason};
        line_send(&firmware->line, SP_TYPE_NACK, (uint32_t)now_us,
            sp_nack_encode(&nack, payload, SP_PAYLOAD_MAX));
    }
}

/* Send a parameter's value, also for a repeated command, because the first value may have been
 * lost. */
static void send_value(firmware_t *firmware, uint8_t number, int64_t now_us)
{
    sp_parameter_value_t value;
    if (parameters_describe(&firmware->parameters, number, &value)) {
        line_send(&firmware->line, SP_TYPE_PARAMETER_VALUE, (uint32_t)now_us,
            sp_parameter_value_encode(&value, line_payload(&firmware->line), SP_PAYLOAD_MAX));
    }
}

void commands_use_key(firmware_t *firmware, const stored_t stored[FLASH_VALUES])
{
    uint32_t words[KEY_WORDS];
    for (unsigned i = 0; i < KEY_WORDS; i++) {
        words[i] = stored[PARAMETERS + i].value; /* 0 if unknown */
    }
    authentication_use(&firmware->line.authentication, words);
}

void commands_challenge(firmware_t *firmware, int64_t now_us)
{
    const sp_challenge_t challenge = {authentication_challenge(&firmware->line.authentication)};
    if (firmware->line.authentication.begun) {
        line_send(&firmware->line, SP_TYPE_CHALLENGE, (uint32_t)now_us,
            sp_challenge_encode(&challenge, line_payload(&firmware->line), SP_PAYLOAD_MAX));
    }
}

void commands_saved(firmware_t *firmware, bool saved)
{
    reply_t *const reply = &firmware->save_reply;
    const bool key = reply->type == SP_TYPE_SET_KEY;
    if (!saved) {
        reply->accepted = false;
        reply->reason = SP_NACK_REASON_NOT_SAVED;
        (void)command_log_add(&firmware->commands, reply);
        log_add(&firmware->control.log, SP_LOG_LEVEL_ERROR,
            key ? "key not stored: the flash does not read back what was written"
                : "parameters not saved: the flash does not read back what was written");
        commands_answer(firmware, reply, firmware->now_us);
        return;
    }
    parameters_saved(&firmware->parameters, firmware->saving);
    if (key) {
        commands_use_key(firmware, firmware->saving);
        authentication_open(&firmware->line.authentication,
            board_identity(firmware->board)->boot_id, firmware->session_id);
    }
    log_add(&firmware->control.log, SP_LOG_LEVEL_INFO, key ? "key stored" : "parameters saved");
    commands_answer(firmware, reply, firmware->now_us);
    if (key) {
        commands_challenge(firmware, firmware->now_us);
    }
}

void commands_reject(firmware_t *firmware, const sp_frame_t *frame, int64_t now_us)
{
    if (frame->type == SP_TYPE_VELOCITY_SETPOINT || frame->type == SP_TYPE_WHEEL_DUTY) {
        firmware->stale++;
        return;
    }
    const reply_t reply = {firmware->session_id, id_of(frame), frame->type, true, false,
        SP_NACK_REASON_NOT_AUTHENTICATED};
    commands_answer(firmware, &reply, now_us);
}

void commands_receive(firmware_t *firmware, const sp_frame_t *frame, int64_t now_us)
{
    const bool saves =
        frame->type == SP_TYPE_SAVE_PARAMETERS || frame->type == SP_TYPE_SET_KEY;
    if (saves && flash_store_busy(&firmware->flash)) {
        return; /* a repeated command during the save; the reply follows later */
    }
    const uint16_t id = id_of(frame);
    const reply_t *reply =
        command_log_find(&firmware->commands, firmware->session_id, id, frame->type);
    if (reply == NULL) {
        if (command_log_is_stale(&firmware->commands, firmware->session_id, id)) {
            return;
        }
        const int reason = execute(firmware, frame);
        const reply_t new_reply = {firmware->session_id, id, frame->type, true, reason == DONE,
            reason == DONE ? (uint8_t)0 : (uint8_t)reason};
        reply = command_log_add(&firmware->commands, &new_reply);
    }
    if (reply->accepted
        && (frame->type == SP_TYPE_GET_PARAMETER || frame->type == SP_TYPE_SET_PARAMETER)) {
        send_value(firmware, frame->payload[2], now_us);
    }
    if (saves && flash_store_busy(&firmware->flash)) {
        firmware->save_reply = *reply; /* sent after the save */
        return;
    }
    commands_answer(firmware, reply, now_us);
}
