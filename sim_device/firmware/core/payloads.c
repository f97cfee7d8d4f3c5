#include "payloads.h"

#include <string.h>

#define FIELDS_MAX 5u

/* The host's messages with the bytes of each field, a text left out. It is the catalogue's, and a
 * message that grows does not compile here until its new field is added. */
static const struct {
    uint8_t type;
    uint8_t size;
    uint8_t fields;
    uint8_t bytes[FIELDS_MAX];
    bool open_end; /* a bootstrap message: never changed, and what is longer is taken too */
} table[HOST_MESSAGES] = {
    {SP_TYPE_STOP, SP_STOP_SIZE, 2, {2, 1}, true},
    {SP_TYPE_VELOCITY_SETPOINT, SP_VELOCITY_SETPOINT_SIZE, 4, {2, 2, 1, 1}, false},
    {SP_TYPE_WHEEL_DUTY, SP_WHEEL_DUTY_SIZE, 4, {2, 2, 1, 1}, false},
    {SP_TYPE_HOST_HELLO, SP_HOST_HELLO_SIZE, 4, {4, 4, 1}, true},
    {SP_TYPE_CLEAR_STOP, SP_CLEAR_STOP_SIZE, 2, {2, 1}, false},
    {SP_TYPE_SET_MODE, SP_SET_MODE_SIZE, 2, {2, 1}, false},
    {SP_TYPE_TIME_REQUEST, SP_TIME_REQUEST_SIZE, 1, {1}, false},
    {SP_TYPE_DESCRIBE, SP_DESCRIBE_SIZE, 2, {1, 1}, true},
    {SP_TYPE_PLANNER_COMMAND, SP_PLANNER_COMMAND_SIZE, 3, {2, 1, 1}, false},
    {SP_TYPE_GET_PARAMETER, SP_GET_PARAMETER_SIZE, 2, {2, 1}, false},
    {SP_TYPE_SET_PARAMETER, SP_SET_PARAMETER_SIZE, 4, {2, 1, 1, 4}, false},
    {SP_TYPE_SAVE_PARAMETERS, SP_SAVE_PARAMETERS_SIZE, 1, {2}, false},
    {SP_TYPE_SET_STREAM_RATE, SP_SET_STREAM_RATE_SIZE, 3, {2, 1, 2}, false},
    {SP_TYPE_REBOOT, SP_REBOOT_SIZE, 2, {2, 1}, false},
    {SP_TYPE_SET_KEY, SP_SET_KEY_SIZE, 5, {2, 4, 4, 4, 4}, false},
};

#define HOLDS(name, condition) typedef char name[(condition) ? 1 : -1]
HOLDS(stop_is_so, SP_STOP_SIZE == 3u);
HOLDS(velocity_setpoint_is_so, SP_VELOCITY_SETPOINT_SIZE == 6u);
HOLDS(wheel_duty_is_so, SP_WHEEL_DUTY_SIZE == 6u);
HOLDS(host_hello_is_so, SP_HOST_HELLO_SIZE == 9u);
HOLDS(clear_stop_is_so, SP_CLEAR_STOP_SIZE == 3u);
HOLDS(set_mode_is_so, SP_SET_MODE_SIZE == 3u);
HOLDS(time_request_is_so, SP_TIME_REQUEST_SIZE == 1u);
HOLDS(describe_is_so, SP_DESCRIBE_SIZE == 2u);
HOLDS(planner_command_is_so, SP_PLANNER_COMMAND_SIZE == 4u);
HOLDS(get_parameter_is_so, SP_GET_PARAMETER_SIZE == 3u);
HOLDS(set_parameter_is_so, SP_SET_PARAMETER_SIZE == 8u);
HOLDS(save_parameters_is_so, SP_SAVE_PARAMETERS_SIZE == 2u);
HOLDS(set_stream_rate_is_so, SP_SET_STREAM_RATE_SIZE == 5u);
HOLDS(reboot_is_so, SP_REBOOT_SIZE == 3u);
HOLDS(set_key_is_so, SP_SET_KEY_SIZE == 18u);

/* Place of a type in the table; HOST_MESSAGES: it is none of the host's. */
static unsigned place_of(uint8_t type)
{
    unsigned i = 0;
    while (i < HOST_MESSAGES && table[i].type != type) {
        i++;
    }
    return i;
}

void payloads_reset(payloads_t *payloads)
{
    memset(payloads->known_fields, 0, sizeof payloads->known_fields);
}

void payloads_described(payloads_t *payloads, const sp_describe_t *question)
{
    const unsigned i = place_of(question->described_type);
    /* What never changes is not shortened: without its fields nobody could agree again. */
    if (i < HOST_MESSAGES && !table[i].open_end) {
        const bool fewer = question->field_count < table[i].fields;
        payloads->known_fields[i] = fewer ? (uint8_t)(question->field_count + 1u) : 0u;
    }
}

/* The same by the message's place in the table. */
static uint8_t known_bytes(const payloads_t *payloads, unsigned i)
{
    uint8_t known = 0;
    if (payloads->known_fields[i] == 0) {
        return table[i].size;
    }
    for (uint8_t k = 0; k + 1u < payloads->known_fields[i] && k < FIELDS_MAX; k++) {
        known = (uint8_t)(known + table[i].bytes[k]);
    }
    return known;
}

uint8_t payloads_known(const payloads_t *payloads, uint8_t type)
{
    const unsigned i = place_of(type);
    return i == HOST_MESSAGES ? 0u : known_bytes(payloads, i);
}

bool payloads_fit(payloads_t *payloads, sp_frame_t *frame)
{
    const unsigned i = place_of(frame->type);
    if (i == HOST_MESSAGES) {
        return false;
    }
    const uint8_t whole = table[i].size;
    const bool all_known = payloads->known_fields[i] == 0;
    if (frame->length == whole) {
        return true;
    }
    if (all_known) {
        return frame->length > whole && table[i].open_end;
    }
    const uint8_t known = known_bytes(payloads, i);
    if (frame->length < known) {
        return false;
    }
    memset(payloads->padded, 0, sizeof payloads->padded);
    memcpy(payloads->padded, frame->payload, known); /* fields of a newer host are passed over */
    frame->payload = payloads->padded;
    frame->length = whole;
    return true;
}
