/* The sweeper's wire in C99: structs hold raw wire integers.
 *
 * Made by `sweepctl generate c`; changes belong into the catalogue.
 * Protocol version 2, catalogue 0xE851B5E5, 35 messages.
 * SPDX-License-Identifier: MIT
 */

#ifndef SWEEPCTL_PROTOCOL_H
#define SWEEPCTL_PROTOCOL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Settings may stand in a file of your own: -DSP_CONFIG_FILE='"my_settings.h"'
 *   SP_MINIMAL             only what a driving device needs; SP_WITH_<MESSAGE> 0/1 chooses singly
 *   SP_WITH_CAN 0/1        frames for classic CAN
 *   SP_NO_FLOAT            no helpers in SI units
 *   SP_CRC_FULL_TABLE      1 KiB table instead of 64 B: 1.4 to 1.7 times as fast (on a PC)
 *   SP_CRC_UNIT            the STM32F4's CRC unit for whole words (see below)
 *   SP_CRC32(data, length) a function of your own instead of all that
 */
#ifdef SP_CONFIG_FILE
#include SP_CONFIG_FILE
#endif

#ifdef SP_MINIMAL
#define SP_WITH_REST 0
#else
#define SP_WITH_REST 1
#endif
#ifndef SP_WITH_CAN
#define SP_WITH_CAN SP_WITH_REST
#endif

#ifndef SP_WITH_VELOCITY_SETPOINT
#define SP_WITH_VELOCITY_SETPOINT 1
#endif
#ifndef SP_WITH_CLEAR_STOP
#define SP_WITH_CLEAR_STOP 1
#endif
#ifndef SP_WITH_SET_MODE
#define SP_WITH_SET_MODE 1
#endif
#ifndef SP_WITH_TIME_REQUEST
#define SP_WITH_TIME_REQUEST 1
#endif
#ifndef SP_WITH_PLANNER_COMMAND
#define SP_WITH_PLANNER_COMMAND SP_WITH_REST
#endif
#ifndef SP_WITH_WHEEL_DUTY
#define SP_WITH_WHEEL_DUTY SP_WITH_REST
#endif
#ifndef SP_WITH_SET_STREAM_RATE
#define SP_WITH_SET_STREAM_RATE SP_WITH_REST
#endif
#ifndef SP_WITH_REBOOT
#define SP_WITH_REBOOT SP_WITH_REST
#endif
#ifndef SP_WITH_SYNC
#define SP_WITH_SYNC SP_WITH_REST
#endif
#ifndef SP_WITH_STATUS
#define SP_WITH_STATUS 1
#endif
#ifndef SP_WITH_IMU
#define SP_WITH_IMU 1
#endif
#ifndef SP_WITH_ENCODERS
#define SP_WITH_ENCODERS 1
#endif
#ifndef SP_WITH_TIME_REPLY
#define SP_WITH_TIME_REPLY 1
#endif
#ifndef SP_WITH_IMU_INFO
#define SP_WITH_IMU_INFO 1
#endif
#ifndef SP_WITH_CHALLENGE
#define SP_WITH_CHALLENGE SP_WITH_REST
#endif
#ifndef SP_WITH_RANGE
#define SP_WITH_RANGE SP_WITH_REST
#endif
#ifndef SP_WITH_POWER
#define SP_WITH_POWER SP_WITH_REST
#endif
#ifndef SP_WITH_LINK_COUNTERS
#define SP_WITH_LINK_COUNTERS SP_WITH_REST
#endif
#ifndef SP_WITH_PLANNER_STATE
#define SP_WITH_PLANNER_STATE SP_WITH_REST
#endif
#ifndef SP_WITH_GET_PARAMETER
#define SP_WITH_GET_PARAMETER SP_WITH_REST
#endif
#ifndef SP_WITH_SET_PARAMETER
#define SP_WITH_SET_PARAMETER SP_WITH_REST
#endif
#ifndef SP_WITH_SAVE_PARAMETERS
#define SP_WITH_SAVE_PARAMETERS SP_WITH_REST
#endif
#ifndef SP_WITH_SET_KEY
#define SP_WITH_SET_KEY SP_WITH_REST
#endif
#ifndef SP_WITH_PARAMETER_VALUE
#define SP_WITH_PARAMETER_VALUE SP_WITH_REST
#endif
#ifndef SP_WITH_LOG_TEXT
#define SP_WITH_LOG_TEXT SP_WITH_REST
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ---- frames: 00 | COBS( header 8 B | payload | CRC-32 ) | 00 ------------------------------ */

#define SP_VERSION 2u
#define SP_NODE_ALL 0u /* for the messages that sp_to_all() names, and no others */
#define SP_NODE_MAX 15u
#define SP_FLAG_AUTHENTICATED 1u
#define SP_HEADER_SIZE 8u
#define SP_BODY_MIN 12u
#define SP_BODY_MAX 253u
#define SP_PAYLOAD_MAX 241u
#define SP_FRAME_MAX 256u /* both delimiters included */
/* Of a frame with SP_FLAG_AUTHENTICATED: counter and tag, behind its payload. On CAN they come in a
 * frame of their own type, at most so long after the message. */
#define SP_TRAILER_SIZE 12u
#define SP_CAN_TRAILER_SIZE 8u
#define SP_CAN_TAG_TYPE 15u
#define SP_CAN_TAG_US 10000u

/* Who sends: one for each port. */
typedef struct {
    uint8_t node;    /* the device's id, 1..15, whichever side sends */
    uint8_t flags;   /* SP_FLAG_* */
    uint8_t seq;     /* of the next frame */
    uint32_t frames; /* sent so far: what the sync message counts */
} sp_sender_t;

/* One intact frame. The payload stands in the parser until its next byte is fed. */
typedef struct {
    uint8_t version; /* compare with SP_VERSION: another version's frame is not to be decoded */
    uint8_t flags;
    uint8_t node;
    uint8_t type;
    uint8_t seq;
    uint8_t length; /* of the payload */
    uint32_t t_us;  /* sender's clock when the content was sampled */
    const uint8_t *payload;
} sp_frame_t;

typedef enum {
    SP_NOTHING = 0,    /* more bytes are needed */
    SP_FRAME = 1,      /* an intact frame */
    SP_BAD_COBS = 2,   /* bytes between two delimiters that are no frame: by their coding, */
    SP_BAD_LENGTH = 3, /* by their number, */
    SP_BAD_CRC = 4     /* by their check */
} sp_event_t;

/* Finds frames in a byte stream. All zero is a parser that has seen nothing. */
typedef struct {
    uint32_t frames;
    uint32_t damaged;
    uint8_t count; /* bytes since the delimiter; 255: too many */
    uint8_t left;  /* bytes left in the COBS group */
    uint8_t body[SP_BODY_MAX];
} sp_parser_t;

/* Take one byte: from an interrupt, if a CRC over at most 253 B at each frame's end is
 * short enough for it. */
sp_event_t sp_parser_byte(sp_parser_t *parser, uint8_t byte, sp_frame_t *frame);

/* Take a block until something is complete: gives the number of bytes taken and the event.
 *   while (n) { size_t k = sp_parser_block(&p, d, n, &f, &e); d += k; n -= k; if (e) ... } */
size_t sp_parser_block(
    sp_parser_t *parser, const uint8_t *data, size_t length, sp_frame_t *frame, sp_event_t *event);

/* Where a payload is encoded in a frame buffer of SP_FRAME_MAX bytes. */
static inline uint8_t *sp_payload(uint8_t *frame)
{
    return frame + 2u + SP_HEADER_SIZE;
}

/* Make the frame around a payload that stands at sp_payload(frame); gives its length, 0 where it
 * is too long. Its first byte is the leading zero: send it where the line was idle, else send
 * from frame + 1. */
size_t sp_seal(
    uint8_t *frame, sp_sender_t *sender, uint8_t type, uint32_t t_us, size_t payload_length);

/* CRC-32 of zlib; goes on from an earlier result, 0 at the start. */
uint32_t sp_crc32_update(uint32_t crc, const uint8_t *data, size_t length);
#ifdef SP_CRC_UNIT
/* The same by the STM32F4's unit, which must have its clock on and be used by nobody else
 * meanwhile. Define SP_CRC_UNIT_RESET(), SP_CRC_UNIT_WRITE(word) and SP_CRC_UNIT_READ() where
 * the registers are not those of the STM32F4. */
uint32_t sp_crc32_unit(const uint8_t *data, size_t length);
#endif

#ifndef SP_NO_FLOAT
static inline int32_t sp_round(float value, float low, float high)
{
    if (!(value > low)) { /* not a number: the least, too */
        return (int32_t)low;
    }
    if (value > high) {
        return (int32_t)high;
    }
    return (int32_t)(value < 0.0f ? value - 0.5f : value + 0.5f);
}
#endif

/* ---- values ------------------------------------------------------------------------------ */

/* What the device has. */
enum {
    SP_CAPABILITY_ENCODERS = 1,
    SP_CAPABILITY_IMU = 2,
    SP_CAPABILITY_ULTRASONIC = 4,
    SP_CAPABILITY_INFRARED = 8,
    SP_CAPABILITY_BUMPER = 16,
    SP_CAPABILITY_CLIFF = 32,
    SP_CAPABILITY_ONBOARD_PLANNER = 64,
    SP_CAPABILITY_AUTHENTICATION = 128
};

/* Contact and cliff bits of the range message. */
enum {
    SP_CONTACT_BUMPER_LEFT = 1,
    SP_CONTACT_BUMPER_RIGHT = 2,
    SP_CONTACT_CLIFF = 4
};

/* Conditions that the status message reports: faults, and what the device does about them. */
enum {
    SP_FAULT_IMU = 1,
    SP_FAULT_ENCODER_LEFT = 2,
    SP_FAULT_ENCODER_RIGHT = 4,
    SP_FAULT_ULTRASONIC = 8,
    SP_FAULT_INFRARED = 16,
    SP_FAULT_MOTOR_STALL = 32,
    SP_FAULT_BATTERY_LOW = 64,
    SP_FAULT_SETPOINT_EXPIRED = 128,
    SP_FAULT_LIFTED = 256,
    SP_FAULT_ENCODER_LEFT_REVERSED = 512,
    SP_FAULT_ENCODER_RIGHT_REVERSED = 1024,
    SP_FAULT_ENCODERS_SWAPPED = 2048,
    SP_FAULT_CLOCK = 4096,
    SP_FAULT_BUMPER = 8192,
    SP_FAULT_LIMITED = 16384,
    SP_FAULT_DRIVERS_OFF = 32768
};

/* Severity of a log text. */
enum {
    SP_LOG_LEVEL_DEBUG = 0,
    SP_LOG_LEVEL_INFO = 1,
    SP_LOG_LEVEL_WARNING = 2,
    SP_LOG_LEVEL_ERROR = 3
};

/* What moves the wheels. */
enum {
    SP_MODE_IDLE = 0,
    SP_MODE_VELOCITY = 1,
    SP_MODE_BRINGUP = 2,
    SP_MODE_ONBOARD = 3
};

/* Why a command was rejected. */
enum {
    SP_NACK_REASON_UNKNOWN_COMMAND = 0,
    SP_NACK_REASON_BAD_VALUE = 1,
    SP_NACK_REASON_NO_SESSION = 2,
    SP_NACK_REASON_STOP_LATCHED = 3,
    SP_NACK_REASON_OTHER_CAUSE = 4,
    SP_NACK_REASON_FAULT = 5,
    SP_NACK_REASON_UNSUPPORTED = 6,
    SP_NACK_REASON_READ_ONLY = 7,
    SP_NACK_REASON_UNKNOWN_PARAMETER = 8,
    SP_NACK_REASON_OTHER_MODE = 9,
    SP_NACK_REASON_NOT_AUTHENTICATED = 10,
    SP_NACK_REASON_NOT_SAVED = 11
};

/* Planners that a device may have. */
enum {
    SP_ONBOARD_PLANNER_PAPER = 0,
    SP_ONBOARD_PLANNER_RECOVERY = 1,
    SP_ONBOARD_PLANNER_U_SHAPE = 2,
    SP_ONBOARD_PLANNER_RANDOM = 3
};

/* What is true of a parameter's value now. */
enum {
    SP_PARAMETER_FLAG_STORED = 1,
    SP_PARAMETER_FLAG_CHANGED = 2,
    SP_PARAMETER_FLAG_READ_ONLY = 4,
    SP_PARAMETER_FLAG_NEEDS_REBOOT = 8
};

/* How a parameter's 32 bits are read. */
enum {
    SP_PARAMETER_KIND_U32 = 0,
    SP_PARAMETER_KIND_F32 = 2
};

/* What to do with the device's own planner. */
enum {
    SP_PLANNER_ACTION_START = 0,
    SP_PLANNER_ACTION_PAUSE = 1,
    SP_PLANNER_ACTION_RESUME = 2,
    SP_PLANNER_ACTION_ABORT = 3
};

/* What the device's own planner is doing. */
enum {
    SP_PLANNER_PHASE_IDLE = 0,
    SP_PLANNER_PHASE_LANE = 1,
    SP_PLANNER_PHASE_TURN = 2,
    SP_PLANNER_PHASE_STEP = 3,
    SP_PLANNER_PHASE_RECOVERY_BACK = 4,
    SP_PLANNER_PHASE_RECOVERY_LANE = 5,
    SP_PLANNER_PHASE_RECOVERY_RETURN = 6,
    SP_PLANNER_PHASE_PAUSED = 7,
    SP_PLANNER_PHASE_FINISHED = 8,
    SP_PLANNER_PHASE_ABORTED = 9
};

/* How to boot. */
enum {
    SP_REBOOT_KIND_NORMAL = 0,
    SP_REBOOT_KIND_FACTORY_RESET = 1
};

/* Why the device booted. */
enum {
    SP_RESET_CAUSE_POWER_ON = 0,
    SP_RESET_CAUSE_PIN = 1,
    SP_RESET_CAUSE_SOFTWARE = 2,
    SP_RESET_CAUSE_WATCHDOG = 3,
    SP_RESET_CAUSE_BROWN_OUT = 4,
    SP_RESET_CAUSE_CRASH = 5
};

/* Why a stop is latched, from the least grave cause to the gravest one. */
enum {
    SP_STOP_CAUSE_NONE = 0,
    SP_STOP_CAUSE_SESSION_END = 1,
    SP_STOP_CAUSE_LINK = 2,
    SP_STOP_CAUSE_SUPERVISE = 3,
    SP_STOP_CAUSE_OPERATOR = 4,
    SP_STOP_CAUSE_HARDWARE = 5
};

/* What a device has latched after a stop of a cause: the graver one. From the least grave to
 * the gravest: session_end, link, supervise, operator, hardware. */
static inline uint8_t sp_latched_cause(uint8_t held, uint8_t cause)
{
    if (cause == SP_STOP_CAUSE_NONE || cause > SP_STOP_CAUSE_HARDWARE) {
        cause = SP_STOP_CAUSE_OPERATOR; /* it has no name here */
    }
    return cause > held ? cause : held;
}

/* ---- messages ---------------------------------------------------------------------------- */

/* encode: the payload's length, or -1 where it does not fit.
 * decode: false where the length is not the message's.
 * frame: a whole frame in a buffer of SP_FRAME_MAX bytes; its length, 0 where it is too
 * long. */

/* stop_all (0x00, host): Every device stops and latches operator; the same bytes from
 * whoever sends it. */
#define SP_TYPE_STOP_ALL 0x00u
#define SP_STOP_ALL_SIZE 0u
typedef struct {
    uint8_t nothing; /* it says all by its type */
} sp_stop_all_t;
int sp_stop_all_encode(const sp_stop_all_t *message, uint8_t *payload, size_t capacity);
bool sp_stop_all_decode(sp_stop_all_t *message, const uint8_t *payload, size_t length);
/* Its node, number and stamp are 0: the same bytes whoever sends it. */
static inline size_t sp_stop_all_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_stop_all_t *message)
{
    sp_sender_t anybody = {0u, 0u, 0u, 0u};
    (void)t_us;
    (void)message;
    sender->frames++;
    return sp_seal(frame, &anybody, SP_TYPE_STOP_ALL, 0u, 0u);
}

/* stop (0x01, host): The owner's stop: latched with its cause, repeated until acknowledged. */
#define SP_TYPE_STOP 0x01u
#define SP_STOP_SIZE 3u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
    /* why; SP_STOP_CAUSE_*; 1..5 */
    uint8_t cause;
} sp_stop_t;
int sp_stop_encode(const sp_stop_t *message, uint8_t *payload, size_t capacity);
bool sp_stop_decode(sp_stop_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_stop_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_stop_t *message)
{
    const int length = sp_stop_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_STOP, t_us, (size_t)length);
}

#if SP_WITH_VELOCITY_SETPOINT
/* velocity_setpoint (0x02, host, 50 Hz): Body velocity to hold until the time to live runs
 * out. */
#define SP_TYPE_VELOCITY_SETPOINT 0x02u
#define SP_VELOCITY_SETPOINT_SIZE 6u
#define SP_VELOCITY_SETPOINT_HZ 50
typedef struct {
    /* forward speed; 1 step = 0.0001 m/s */
    int16_t v;
    /* counter-clockwise; 1 step = 0.0002 rad/s */
    int16_t yaw_rate;
    /* the device ramps to rest after it; 1 step = 0.001 s; 0..250 */
    uint8_t time_to_live;
    /* must advance; wraps; count */
    uint8_t counter;
} sp_velocity_setpoint_t;
int sp_velocity_setpoint_encode(const sp_velocity_setpoint_t *message, uint8_t *payload, size_t capacity);
bool sp_velocity_setpoint_decode(sp_velocity_setpoint_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_velocity_setpoint_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_velocity_setpoint_t *message)
{
    const int length = sp_velocity_setpoint_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_VELOCITY_SETPOINT, t_us, (size_t)length);
}
#ifndef SP_NO_FLOAT
static inline float sp_velocity_setpoint_v_m_s(const sp_velocity_setpoint_t *message)
{
    return (float)message->v * 0.0001f;
}
static inline int16_t sp_velocity_setpoint_v_from_m_s(float value)
{
    return (int16_t)sp_round(value / 0.0001f, -32768.0f, 32767.0f);
}
static inline float sp_velocity_setpoint_yaw_rate_rad_s(const sp_velocity_setpoint_t *message)
{
    return (float)message->yaw_rate * 0.0002f;
}
static inline int16_t sp_velocity_setpoint_yaw_rate_from_rad_s(float value)
{
    return (int16_t)sp_round(value / 0.0002f, -32768.0f, 32767.0f);
}
static inline float sp_velocity_setpoint_time_to_live_s(const sp_velocity_setpoint_t *message)
{
    return (float)message->time_to_live * 0.001f;
}
static inline uint8_t sp_velocity_setpoint_time_to_live_from_s(float value)
{
    return (uint8_t)sp_round(value / 0.001f, 0.0f, 250.0f);
}
#endif
#endif

/* host_hello (0x04, host): Opens a session; sent again with agreed set once the catalogues
 * are compared. */
#define SP_TYPE_HOST_HELLO 0x04u
#define SP_HOST_HELLO_SIZE 13u
typedef struct {
    /* of the host's whole catalogue; hash */
    uint32_t catalogue_hash;
    /* random, new for each session; id; 1..4294967295 */
    uint32_t session_id;
    /* of the device's hello; 0: not known yet; id */
    uint32_t boot_id;
    /* 1: streams and commands may start; 0..1 */
    uint8_t agreed;
    /* the host program and its version */
    const char *name; /* not ended by a zero; decoded: inside the payload */
    uint8_t name_length;
} sp_host_hello_t;
int sp_host_hello_encode(const sp_host_hello_t *message, uint8_t *payload, size_t capacity);
bool sp_host_hello_decode(sp_host_hello_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_host_hello_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_host_hello_t *message)
{
    const int length = sp_host_hello_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_HOST_HELLO, t_us, (size_t)length);
}

#if SP_WITH_CLEAR_STOP
/* clear_stop (0x05, host): Release the latch, if its cause is still the one named. */
#define SP_TYPE_CLEAR_STOP 0x05u
#define SP_CLEAR_STOP_SIZE 3u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
    /* the cause to clear; SP_STOP_CAUSE_*; 1..5 */
    uint8_t cause;
} sp_clear_stop_t;
int sp_clear_stop_encode(const sp_clear_stop_t *message, uint8_t *payload, size_t capacity);
bool sp_clear_stop_decode(sp_clear_stop_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_clear_stop_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_clear_stop_t *message)
{
    const int length = sp_clear_stop_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_CLEAR_STOP, t_us, (size_t)length);
}
#endif

#if SP_WITH_SET_MODE
/* set_mode (0x06, host): Choose what moves the wheels; refused while a stop is latched. */
#define SP_TYPE_SET_MODE 0x06u
#define SP_SET_MODE_SIZE 3u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
    /* the mode wanted; SP_MODE_*; 0..3 */
    uint8_t mode;
} sp_set_mode_t;
int sp_set_mode_encode(const sp_set_mode_t *message, uint8_t *payload, size_t capacity);
bool sp_set_mode_decode(sp_set_mode_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_set_mode_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_set_mode_t *message)
{
    const int length = sp_set_mode_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_SET_MODE, t_us, (size_t)length);
}
#endif

#if SP_WITH_TIME_REQUEST
/* time_request (0x07, host): Ask for the device's clock; also keeps the session alive. */
#define SP_TYPE_TIME_REQUEST 0x07u
#define SP_TIME_REQUEST_SIZE 1u
typedef struct {
    /* comes back in the reply; id */
    uint8_t ping;
} sp_time_request_t;
int sp_time_request_encode(const sp_time_request_t *message, uint8_t *payload, size_t capacity);
bool sp_time_request_decode(sp_time_request_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_time_request_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_time_request_t *message)
{
    const int length = sp_time_request_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_TIME_REQUEST, t_us, (size_t)length);
}
#endif

/* describe (0x08, host): Ask how the device declares one message. */
#define SP_TYPE_DESCRIBE 0x08u
#define SP_DESCRIBE_SIZE 2u
typedef struct {
    /* type asked about; id; 0..126 */
    uint8_t described_type;
    /* fields that the host knows of it; count */
    uint8_t field_count;
} sp_describe_t;
int sp_describe_encode(const sp_describe_t *message, uint8_t *payload, size_t capacity);
bool sp_describe_decode(sp_describe_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_describe_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_describe_t *message)
{
    const int length = sp_describe_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_DESCRIBE, t_us, (size_t)length);
}

#if SP_WITH_PLANNER_COMMAND
/* planner_command (0x09, host): Start, pause, resume or abort the device's own planner. */
#define SP_TYPE_PLANNER_COMMAND 0x09u
#define SP_PLANNER_COMMAND_SIZE 4u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
    /* what to do; SP_PLANNER_ACTION_*; 0..3 */
    uint8_t action;
    /* which, at start; SP_ONBOARD_PLANNER_*; 0..3 */
    uint8_t planner;
} sp_planner_command_t;
int sp_planner_command_encode(const sp_planner_command_t *message, uint8_t *payload, size_t capacity);
bool sp_planner_command_decode(sp_planner_command_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_planner_command_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_planner_command_t *message)
{
    const int length = sp_planner_command_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_PLANNER_COMMAND, t_us, (size_t)length);
}
#endif

#if SP_WITH_WHEEL_DUTY
/* wheel_duty (0x0A, host, 50 Hz): Motor duties, obeyed in bring-up mode only and capped
 * there. */
#define SP_TYPE_WHEEL_DUTY 0x0Au
#define SP_WHEEL_DUTY_SIZE 6u
#define SP_WHEEL_DUTY_HZ 50
typedef struct {
    /* forward positive; 1 step = 0.0001 duty; -10000..10000 */
    int16_t left;
    /* forward positive; 1 step = 0.0001 duty; -10000..10000 */
    int16_t right;
    /* the motors are off after it; 1 step = 0.001 s; 0..250 */
    uint8_t time_to_live;
    /* must advance; wraps; count */
    uint8_t counter;
} sp_wheel_duty_t;
int sp_wheel_duty_encode(const sp_wheel_duty_t *message, uint8_t *payload, size_t capacity);
bool sp_wheel_duty_decode(sp_wheel_duty_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_wheel_duty_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_wheel_duty_t *message)
{
    const int length = sp_wheel_duty_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_WHEEL_DUTY, t_us, (size_t)length);
}
#ifndef SP_NO_FLOAT
static inline float sp_wheel_duty_left_duty(const sp_wheel_duty_t *message)
{
    return (float)message->left * 0.0001f;
}
static inline int16_t sp_wheel_duty_left_from_duty(float value)
{
    return (int16_t)sp_round(value / 0.0001f, -10000.0f, 10000.0f);
}
static inline float sp_wheel_duty_right_duty(const sp_wheel_duty_t *message)
{
    return (float)message->right * 0.0001f;
}
static inline int16_t sp_wheel_duty_right_from_duty(float value)
{
    return (int16_t)sp_round(value / 0.0001f, -10000.0f, 10000.0f);
}
static inline float sp_wheel_duty_time_to_live_s(const sp_wheel_duty_t *message)
{
    return (float)message->time_to_live * 0.001f;
}
static inline uint8_t sp_wheel_duty_time_to_live_from_s(float value)
{
    return (uint8_t)sp_round(value / 0.001f, 0.0f, 250.0f);
}
#endif
#endif

/* describe_enum (0x0C, host): Ask how the device numbers one enumeration. */
#define SP_TYPE_DESCRIBE_ENUM 0x0Cu
#define SP_DESCRIBE_ENUM_SIZE 5u
typedef struct {
    /* of its name and kind: its chain's start; hash */
    uint32_t enumeration;
    /* members that the host knows of it; count */
    uint8_t member_count;
} sp_describe_enum_t;
int sp_describe_enum_encode(const sp_describe_enum_t *message, uint8_t *payload, size_t capacity);
bool sp_describe_enum_decode(sp_describe_enum_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_describe_enum_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_describe_enum_t *message)
{
    const int length = sp_describe_enum_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_DESCRIBE_ENUM, t_us, (size_t)length);
}

#if SP_WITH_SET_STREAM_RATE
/* set_stream_rate (0x0D, host): Change how often a stream is sent, until the session ends. */
#define SP_TYPE_SET_STREAM_RATE 0x0Du
#define SP_SET_STREAM_RATE_SIZE 5u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
    /* type of the stream; id; 0..126 */
    uint8_t stream_type;
    /* 0: off; 1 step = 0.1 Hz; 0..10000 */
    uint16_t rate;
} sp_set_stream_rate_t;
int sp_set_stream_rate_encode(const sp_set_stream_rate_t *message, uint8_t *payload, size_t capacity);
bool sp_set_stream_rate_decode(sp_set_stream_rate_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_set_stream_rate_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_set_stream_rate_t *message)
{
    const int length = sp_set_stream_rate_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_SET_STREAM_RATE, t_us, (size_t)length);
}
#ifndef SP_NO_FLOAT
static inline float sp_set_stream_rate_rate_hz(const sp_set_stream_rate_t *message)
{
    return (float)message->rate * 0.1f;
}
static inline uint16_t sp_set_stream_rate_rate_from_hz(float value)
{
    return (uint16_t)sp_round(value / 0.1f, 0.0f, 10000.0f);
}
#endif
#endif

#if SP_WITH_REBOOT
/* reboot (0x0E, host): Boot anew; acknowledged before it happens, refused while the robot
 * moves. */
#define SP_TYPE_REBOOT 0x0Eu
#define SP_REBOOT_SIZE 3u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
    /* how; SP_REBOOT_KIND_*; 0..1 */
    uint8_t kind;
} sp_reboot_t;
int sp_reboot_encode(const sp_reboot_t *message, uint8_t *payload, size_t capacity);
bool sp_reboot_decode(sp_reboot_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_reboot_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_reboot_t *message)
{
    const int length = sp_reboot_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_REBOOT, t_us, (size_t)length);
}
#endif

#if SP_WITH_SYNC
/* sync (0x10, device, 10 Hz): Count of all frames sent, to find losses that the 8-bit
 * sequence cannot. */
#define SP_TYPE_SYNC 0x10u
#define SP_SYNC_SIZE 4u
#define SP_SYNC_HZ 10
typedef struct {
    /* frames sent since boot, this one included; count */
    uint32_t frame_count;
} sp_sync_t;
int sp_sync_encode(const sp_sync_t *message, uint8_t *payload, size_t capacity);
bool sp_sync_decode(sp_sync_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_sync_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_sync_t *message)
{
    const int length = sp_sync_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_SYNC, t_us, (size_t)length);
}
#endif

#if SP_WITH_STATUS
/* status (0x11, device, 10 Hz): What the device is doing and why it is not. */
#define SP_TYPE_STATUS 0x11u
#define SP_STATUS_SIZE 6u
#define SP_STATUS_HZ 10
typedef struct {
    /* what moves the wheels; SP_MODE_*; 0..3 */
    uint8_t mode;
    /* 0: no stop latched; SP_STOP_CAUSE_*; 0..5 */
    uint8_t stop_cause;
    /* conditions that hold now; SP_FAULT_* */
    uint16_t faults;
    /* time to live left of the setpoint; 1 step = 0.001 s; 0..250 */
    uint8_t setpoint_left;
    /* busy share of the control loop; percent; 0..100 */
    uint8_t load;
} sp_status_t;
int sp_status_encode(const sp_status_t *message, uint8_t *payload, size_t capacity);
bool sp_status_decode(sp_status_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_status_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_status_t *message)
{
    const int length = sp_status_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_STATUS, t_us, (size_t)length);
}
#ifndef SP_NO_FLOAT
static inline float sp_status_setpoint_left_s(const sp_status_t *message)
{
    return (float)message->setpoint_left * 0.001f;
}
static inline uint8_t sp_status_setpoint_left_from_s(float value)
{
    return (uint8_t)sp_round(value / 0.001f, 0.0f, 250.0f);
}
#endif
#endif

#if SP_WITH_IMU
/* imu (0x13, device, 100 Hz): MPU6050 registers as read: +-2 g, +-250 deg/s, in the chip's
 * order. */
#define SP_TYPE_IMU 0x13u
#define SP_IMU_SIZE 14u
#define SP_IMU_HZ 100
typedef struct {
    /* forward; 1 step = 0.000598550415 m/s2 */
    int16_t accel_x;
    /* left; 1 step = 0.000598550415 m/s2 */
    int16_t accel_y;
    /* up; +1 g at rest; 1 step = 0.000598550415 m/s2 */
    int16_t accel_z;
    /* of the chip; 1 step = 0.00294117647 degC; 0 = 36.53 degC */
    int16_t temperature;
    /* roll rate; 1 step = 0.00763358779 deg/s */
    int16_t gyro_x;
    /* pitch rate; 1 step = 0.00763358779 deg/s */
    int16_t gyro_y;
    /* yaw rate; 1 step = 0.00763358779 deg/s */
    int16_t gyro_z;
} sp_imu_t;
int sp_imu_encode(const sp_imu_t *message, uint8_t *payload, size_t capacity);
bool sp_imu_decode(sp_imu_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_imu_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_imu_t *message)
{
    const int length = sp_imu_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_IMU, t_us, (size_t)length);
}
#ifndef SP_NO_FLOAT
static inline float sp_imu_accel_x_m_s2(const sp_imu_t *message)
{
    return (float)message->accel_x * 0.000598550415f;
}
static inline int16_t sp_imu_accel_x_from_m_s2(float value)
{
    return (int16_t)sp_round(value / 0.000598550415f, -32768.0f, 32767.0f);
}
static inline float sp_imu_accel_y_m_s2(const sp_imu_t *message)
{
    return (float)message->accel_y * 0.000598550415f;
}
static inline int16_t sp_imu_accel_y_from_m_s2(float value)
{
    return (int16_t)sp_round(value / 0.000598550415f, -32768.0f, 32767.0f);
}
static inline float sp_imu_accel_z_m_s2(const sp_imu_t *message)
{
    return (float)message->accel_z * 0.000598550415f;
}
static inline int16_t sp_imu_accel_z_from_m_s2(float value)
{
    return (int16_t)sp_round(value / 0.000598550415f, -32768.0f, 32767.0f);
}
static inline float sp_imu_temperature_deg_c(const sp_imu_t *message)
{
    return (float)message->temperature * 0.00294117647f + 36.53f;
}
static inline int16_t sp_imu_temperature_from_deg_c(float value)
{
    return (int16_t)sp_round((value - 36.53f) / 0.00294117647f, -32768.0f, 32767.0f);
}
static inline float sp_imu_gyro_x_rad_s(const sp_imu_t *message)
{
    return (float)message->gyro_x * 0.000133231241f;
}
static inline int16_t sp_imu_gyro_x_from_rad_s(float value)
{
    return (int16_t)sp_round(value / 0.000133231241f, -32768.0f, 32767.0f);
}
static inline float sp_imu_gyro_y_rad_s(const sp_imu_t *message)
{
    return (float)message->gyro_y * 0.000133231241f;
}
static inline int16_t sp_imu_gyro_y_from_rad_s(float value)
{
    return (int16_t)sp_round(value / 0.000133231241f, -32768.0f, 32767.0f);
}
static inline float sp_imu_gyro_z_rad_s(const sp_imu_t *message)
{
    return (float)message->gyro_z * 0.000133231241f;
}
static inline int16_t sp_imu_gyro_z_from_rad_s(float value)
{
    return (int16_t)sp_round(value / 0.000133231241f, -32768.0f, 32767.0f);
}
#endif
#endif

#if SP_WITH_ENCODERS
/* encoders (0x16, device, 50 Hz): Absolute wheel counts after x4; they wrap at 16 bits. */
#define SP_TYPE_ENCODERS 0x16u
#define SP_ENCODERS_SIZE 4u
#define SP_ENCODERS_HZ 50
typedef struct {
    /* left wheel, rising forward; count */
    uint16_t left;
    /* right wheel, rising forward; count */
    uint16_t right;
} sp_encoders_t;
int sp_encoders_encode(const sp_encoders_t *message, uint8_t *payload, size_t capacity);
bool sp_encoders_decode(sp_encoders_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_encoders_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_encoders_t *message)
{
    const int length = sp_encoders_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_ENCODERS, t_us, (size_t)length);
}
#endif

#if SP_WITH_TIME_REPLY
/* time_reply (0x18, device): Answer to a time request; the header's stamp is the moment of
 * sending. */
#define SP_TYPE_TIME_REPLY 0x18u
#define SP_TIME_REPLY_SIZE 5u
typedef struct {
    /* of the request; id */
    uint8_t ping;
    /* device clock when the request arrived; us */
    uint32_t received_us;
} sp_time_reply_t;
int sp_time_reply_encode(const sp_time_reply_t *message, uint8_t *payload, size_t capacity);
bool sp_time_reply_decode(sp_time_reply_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_time_reply_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_time_reply_t *message)
{
    const int length = sp_time_reply_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_TIME_REPLY, t_us, (size_t)length);
}
#endif

/* ack (0x19, device): The command was carried out (repeated as it was for a repeated
 * command). */
#define SP_TYPE_ACK 0x19u
#define SP_ACK_SIZE 3u
typedef struct {
    /* of the command; id */
    uint16_t command_id;
    /* type of the command; id; 0..126 */
    uint8_t command_type;
} sp_ack_t;
int sp_ack_encode(const sp_ack_t *message, uint8_t *payload, size_t capacity);
bool sp_ack_decode(sp_ack_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_ack_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_ack_t *message)
{
    const int length = sp_ack_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_ACK, t_us, (size_t)length);
}

/* nack (0x1A, device): The command was refused, and nothing was done. */
#define SP_TYPE_NACK 0x1Au
#define SP_NACK_SIZE 4u
typedef struct {
    /* of the command; id */
    uint16_t command_id;
    /* type of the command; id; 0..126 */
    uint8_t command_type;
    /* why; SP_NACK_REASON_*; 0..11 */
    uint8_t reason;
} sp_nack_t;
int sp_nack_encode(const sp_nack_t *message, uint8_t *payload, size_t capacity);
bool sp_nack_decode(sp_nack_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_nack_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_nack_t *message)
{
    const int length = sp_nack_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_NACK, t_us, (size_t)length);
}

/* hello (0x1B, device): Who the device is; sent at 1 Hz until a host has agreed, and as
 * answer to its hello. */
#define SP_TYPE_HELLO 0x1Bu
#define SP_HELLO_SIZE 30u
typedef struct {
    /* of the device's whole catalogue; hash */
    uint32_t catalogue_hash;
    /* the chip's 96-bit unique id */
    uint8_t uid[12];
    /* random, new at each boot; id */
    uint32_t boot_id;
    /* the session it belongs to; 0: none; id */
    uint32_t session_id;
    /* why it booted; SP_RESET_CAUSE_*; 0..5 */
    uint8_t reset_cause;
    /* what it has; SP_CAPABILITY_* */
    uint16_t capabilities;
    /* firmware version; count */
    uint8_t version_major;
    /* firmware version; count */
    uint8_t version_minor;
    /* firmware version; count */
    uint8_t version_patch;
    /* the firmware's name */
    const char *name; /* not ended by a zero; decoded: inside the payload */
    uint8_t name_length;
} sp_hello_t;
int sp_hello_encode(const sp_hello_t *message, uint8_t *payload, size_t capacity);
bool sp_hello_decode(sp_hello_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_hello_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_hello_t *message)
{
    const int length = sp_hello_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_HELLO, t_us, (size_t)length);
}

/* describe_reply (0x1C, device): How the device declares one message. */
#define SP_TYPE_DESCRIBE_REPLY 0x1Cu
#define SP_DESCRIBE_REPLY_SIZE 7u
typedef struct {
    /* type asked about; id; 0..126 */
    uint8_t described_type;
    /* fields it has; 255: no such message; count */
    uint8_t field_count;
    /* bytes of its fixed part; count */
    uint8_t payload_length;
    /* after min(asked, own) fields; hash */
    uint32_t chain;
} sp_describe_reply_t;
int sp_describe_reply_encode(const sp_describe_reply_t *message, uint8_t *payload, size_t capacity);
bool sp_describe_reply_decode(sp_describe_reply_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_describe_reply_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_describe_reply_t *message)
{
    const int length = sp_describe_reply_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_DESCRIBE_REPLY, t_us, (size_t)length);
}

#if SP_WITH_IMU_INFO
/* imu_info (0x1D, device): What the counts of the IMU message are worth; sent after hello,
 * and then at 1 Hz. */
#define SP_TYPE_IMU_INFO 0x1Du
#define SP_IMU_INFO_SIZE 14u
typedef struct {
    /* of an accelerometer axis; 1 step = 0.0001 count/g; 1..4294967295 */
    uint32_t accel;
    /* of a gyroscope axis; 1 step = 0.0001 count/(deg/s); 1..4294967295 */
    uint32_t gyro;
    /* of the thermometer; 1 step = 0.0001 count/K; 1..4294967295 */
    uint32_t temperature;
    /* temperature at a count of 0; 1 step = 0.01 degC */
    int16_t zero;
} sp_imu_info_t;
int sp_imu_info_encode(const sp_imu_info_t *message, uint8_t *payload, size_t capacity);
bool sp_imu_info_decode(sp_imu_info_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_imu_info_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_imu_info_t *message)
{
    const int length = sp_imu_info_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_IMU_INFO, t_us, (size_t)length);
}
#ifndef SP_NO_FLOAT
static inline float sp_imu_info_accel_per_g(const sp_imu_info_t *message)
{
    return (float)message->accel * 0.0001f;
}
static inline uint32_t sp_imu_info_accel_from_per_g(float value)
{
    return (uint32_t)sp_round(value / 0.0001f, 1.0f, 4.2949673e+09f);
}
static inline float sp_imu_info_gyro_per_deg_s(const sp_imu_info_t *message)
{
    return (float)message->gyro * 0.0001f;
}
static inline uint32_t sp_imu_info_gyro_from_per_deg_s(float value)
{
    return (uint32_t)sp_round(value / 0.0001f, 1.0f, 4.2949673e+09f);
}
static inline float sp_imu_info_temperature_per_k(const sp_imu_info_t *message)
{
    return (float)message->temperature * 0.0001f;
}
static inline uint32_t sp_imu_info_temperature_from_per_k(float value)
{
    return (uint32_t)sp_round(value / 0.0001f, 1.0f, 4.2949673e+09f);
}
static inline float sp_imu_info_zero_deg_c(const sp_imu_info_t *message)
{
    return (float)message->zero * 0.01f;
}
static inline int16_t sp_imu_info_zero_from_deg_c(float value)
{
    return (int16_t)sp_round(value / 0.01f, -32768.0f, 32767.0f);
}
#endif
#endif

/* describe_enum_reply (0x1E, device): How the device numbers one enumeration. */
#define SP_TYPE_DESCRIBE_ENUM_REPLY 0x1Eu
#define SP_DESCRIBE_ENUM_REPLY_SIZE 9u
typedef struct {
    /* enumeration asked about; hash */
    uint32_t enumeration;
    /* members it has; 255: no such enumeration; count */
    uint8_t member_count;
    /* after min(asked, own) members; hash */
    uint32_t chain;
} sp_describe_enum_reply_t;
int sp_describe_enum_reply_encode(const sp_describe_enum_reply_t *message, uint8_t *payload, size_t capacity);
bool sp_describe_enum_reply_decode(sp_describe_enum_reply_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_describe_enum_reply_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_describe_enum_reply_t *message)
{
    const int length = sp_describe_enum_reply_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_DESCRIBE_ENUM_REPLY, t_us, (size_t)length);
}

#if SP_WITH_CHALLENGE
/* challenge (0x1F, device): A key is set: from which count this session's authenticated
 * frames go on; with each hello. */
#define SP_TYPE_CHALLENGE 0x1Fu
#define SP_CHALLENGE_SIZE 4u
typedef struct {
    /* random, new for each session; count */
    uint32_t counter;
} sp_challenge_t;
int sp_challenge_encode(const sp_challenge_t *message, uint8_t *payload, size_t capacity);
bool sp_challenge_decode(sp_challenge_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_challenge_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_challenge_t *message)
{
    const int length = sp_challenge_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_CHALLENGE, t_us, (size_t)length);
}
#endif

#if SP_WITH_RANGE
/* range (0x20, device, 20 Hz): Distances and contacts around the robot. */
#define SP_TYPE_RANGE 0x20u
#define SP_RANGE_SIZE 5u
#define SP_RANGE_HZ 20
#define SP_RANGE_ULTRASONIC_NONE 65535u
#define SP_RANGE_INFRARED_LEFT_NONE 255u
#define SP_RANGE_INFRARED_RIGHT_NONE 255u
typedef struct {
    /* front; 65535: no echo; 1 step = 0.001 m; 0..4000; 65535: none */
    uint16_t ultrasonic;
    /* 255: nothing near; 1 step = 0.00125 m; 0..254; 255: none */
    uint8_t infrared_left;
    /* 255: nothing near; 1 step = 0.00125 m; 0..254; 255: none */
    uint8_t infrared_right;
    /* bumper halves and cliff; SP_CONTACT_*; 0..7 */
    uint8_t contacts;
} sp_range_t;
int sp_range_encode(const sp_range_t *message, uint8_t *payload, size_t capacity);
bool sp_range_decode(sp_range_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_range_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_range_t *message)
{
    const int length = sp_range_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_RANGE, t_us, (size_t)length);
}
#ifndef SP_NO_FLOAT
static inline float sp_range_ultrasonic_m(const sp_range_t *message)
{
    return (float)message->ultrasonic * 0.001f;
}
static inline uint16_t sp_range_ultrasonic_from_m(float value)
{
    return (uint16_t)sp_round(value / 0.001f, 0.0f, 4000.0f);
}
static inline float sp_range_infrared_left_m(const sp_range_t *message)
{
    return (float)message->infrared_left * 0.00125f;
}
static inline uint8_t sp_range_infrared_left_from_m(float value)
{
    return (uint8_t)sp_round(value / 0.00125f, 0.0f, 254.0f);
}
static inline float sp_range_infrared_right_m(const sp_range_t *message)
{
    return (float)message->infrared_right * 0.00125f;
}
static inline uint8_t sp_range_infrared_right_from_m(float value)
{
    return (uint8_t)sp_round(value / 0.00125f, 0.0f, 254.0f);
}
#endif
#endif

#if SP_WITH_POWER
/* power (0x24, device, 5 Hz): Supply rails and motor currents. */
#define SP_TYPE_POWER 0x24u
#define SP_POWER_SIZE 5u
#define SP_POWER_HZ 5
typedef struct {
    /* 16 V rail; 1 step = 0.001 V */
    uint16_t battery;
    /* 5 V rail; 1 step = 0.025 V */
    uint8_t logic;
    /* magnitude; 1 step = 0.02 A */
    uint8_t motor_left;
    /* magnitude; 1 step = 0.02 A */
    uint8_t motor_right;
} sp_power_t;
int sp_power_encode(const sp_power_t *message, uint8_t *payload, size_t capacity);
bool sp_power_decode(sp_power_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_power_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_power_t *message)
{
    const int length = sp_power_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_POWER, t_us, (size_t)length);
}
#ifndef SP_NO_FLOAT
static inline float sp_power_battery_v(const sp_power_t *message)
{
    return (float)message->battery * 0.001f;
}
static inline uint16_t sp_power_battery_from_v(float value)
{
    return (uint16_t)sp_round(value / 0.001f, 0.0f, 65535.0f);
}
static inline float sp_power_logic_v(const sp_power_t *message)
{
    return (float)message->logic * 0.025f;
}
static inline uint8_t sp_power_logic_from_v(float value)
{
    return (uint8_t)sp_round(value / 0.025f, 0.0f, 255.0f);
}
static inline float sp_power_motor_left_a(const sp_power_t *message)
{
    return (float)message->motor_left * 0.02f;
}
static inline uint8_t sp_power_motor_left_from_a(float value)
{
    return (uint8_t)sp_round(value / 0.02f, 0.0f, 255.0f);
}
static inline float sp_power_motor_right_a(const sp_power_t *message)
{
    return (float)message->motor_right * 0.02f;
}
static inline uint8_t sp_power_motor_right_from_a(float value)
{
    return (uint8_t)sp_round(value / 0.02f, 0.0f, 255.0f);
}
#endif
#endif

#if SP_WITH_LINK_COUNTERS
/* link_counters (0x28, device, 1 Hz): What the device received and dropped since boot; each
 * wraps. */
#define SP_TYPE_LINK_COUNTERS 0x28u
#define SP_LINK_COUNTERS_SIZE 14u
#define SP_LINK_COUNTERS_HZ 1
typedef struct {
    /* intact frames; count */
    uint16_t received;
    /* frames with a bad check or form; count */
    uint16_t damaged;
    /* setpoints refused as old or repeated; count */
    uint16_t stale;
    /* lost for want of room as they came; count */
    uint16_t receive_dropped;
    /* messages that were not sent for want of room; count */
    uint16_t send_dropped;
    /* error counter of its CAN controller (TEC); count */
    uint8_t can_send_errors;
    /* error counter of its CAN controller (REC); count */
    uint8_t can_receive_errors;
    /* times that its CAN controller left the bus; count */
    uint16_t can_bus_offs;
} sp_link_counters_t;
int sp_link_counters_encode(const sp_link_counters_t *message, uint8_t *payload, size_t capacity);
bool sp_link_counters_decode(sp_link_counters_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_link_counters_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_link_counters_t *message)
{
    const int length = sp_link_counters_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_LINK_COUNTERS, t_us, (size_t)length);
}
#endif

#if SP_WITH_PLANNER_STATE
/* planner_state (0x2C, device, 5 Hz): The device's own planner: the paper's variables and
 * where it drives to. */
#define SP_TYPE_PLANNER_STATE 0x2Cu
#define SP_PLANNER_STATE_SIZE 12u
#define SP_PLANNER_STATE_HZ 5
typedef struct {
    /* what it is doing; SP_PLANNER_PHASE_*; 0..9 */
    uint8_t phase;
    /* T of the paper; count */
    uint8_t turn_count;
    /* in the frame of its start; 1 step = 0.001 m */
    int16_t target_x;
    /* in the frame of its start; 1 step = 0.001 m */
    int16_t target_y;
    /* D of the paper; 1 step = 0.001 m */
    uint16_t lane_distance;
    /* Prev-D of the paper; 1 step = 0.001 m */
    uint16_t previous_lane_distance;
    /* Length of the paper; 1 step = 0.02 m */
    uint8_t length;
    /* case of the last lane; 0: none; count; 0..3 */
    uint8_t lane_case;
} sp_planner_state_t;
int sp_planner_state_encode(const sp_planner_state_t *message, uint8_t *payload, size_t capacity);
bool sp_planner_state_decode(sp_planner_state_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_planner_state_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_planner_state_t *message)
{
    const int length = sp_planner_state_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_PLANNER_STATE, t_us, (size_t)length);
}
#ifndef SP_NO_FLOAT
static inline float sp_planner_state_target_x_m(const sp_planner_state_t *message)
{
    return (float)message->target_x * 0.001f;
}
static inline int16_t sp_planner_state_target_x_from_m(float value)
{
    return (int16_t)sp_round(value / 0.001f, -32768.0f, 32767.0f);
}
static inline float sp_planner_state_target_y_m(const sp_planner_state_t *message)
{
    return (float)message->target_y * 0.001f;
}
static inline int16_t sp_planner_state_target_y_from_m(float value)
{
    return (int16_t)sp_round(value / 0.001f, -32768.0f, 32767.0f);
}
static inline float sp_planner_state_lane_distance_m(const sp_planner_state_t *message)
{
    return (float)message->lane_distance * 0.001f;
}
static inline uint16_t sp_planner_state_lane_distance_from_m(float value)
{
    return (uint16_t)sp_round(value / 0.001f, 0.0f, 65535.0f);
}
static inline float sp_planner_state_previous_lane_distance_m(const sp_planner_state_t *message)
{
    return (float)message->previous_lane_distance * 0.001f;
}
static inline uint16_t sp_planner_state_previous_lane_distance_from_m(float value)
{
    return (uint16_t)sp_round(value / 0.001f, 0.0f, 65535.0f);
}
static inline float sp_planner_state_length_m(const sp_planner_state_t *message)
{
    return (float)message->length * 0.02f;
}
static inline uint8_t sp_planner_state_length_from_m(float value)
{
    return (uint8_t)sp_round(value / 0.02f, 0.0f, 255.0f);
}
#endif
#endif

#if SP_WITH_GET_PARAMETER
/* get_parameter (0x70, host): Ask for one parameter; the value comes before the
 * acknowledgement. */
#define SP_TYPE_GET_PARAMETER 0x70u
#define SP_GET_PARAMETER_SIZE 3u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
    /* number of the parameter, from 0 without gaps; id */
    uint8_t parameter;
} sp_get_parameter_t;
int sp_get_parameter_encode(const sp_get_parameter_t *message, uint8_t *payload, size_t capacity);
bool sp_get_parameter_decode(sp_get_parameter_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_get_parameter_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_get_parameter_t *message)
{
    const int length = sp_get_parameter_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_GET_PARAMETER, t_us, (size_t)length);
}
#endif

#if SP_WITH_SET_PARAMETER
/* set_parameter (0x71, host): Change one parameter until the next boot; save makes it stay. */
#define SP_TYPE_SET_PARAMETER 0x71u
#define SP_SET_PARAMETER_SIZE 8u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
    /* number of the parameter; id */
    uint8_t parameter;
    /* must be the parameter's own; SP_PARAMETER_KIND_*; 0..2 */
    uint8_t kind;
    /* 32 bits, read as the kind says */
    uint32_t value;
} sp_set_parameter_t;
int sp_set_parameter_encode(const sp_set_parameter_t *message, uint8_t *payload, size_t capacity);
bool sp_set_parameter_decode(sp_set_parameter_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_set_parameter_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_set_parameter_t *message)
{
    const int length = sp_set_parameter_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_SET_PARAMETER, t_us, (size_t)length);
}
#endif

#if SP_WITH_SAVE_PARAMETERS
/* save_parameters (0x72, host): Store every parameter's present value. */
#define SP_TYPE_SAVE_PARAMETERS 0x72u
#define SP_SAVE_PARAMETERS_SIZE 2u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
} sp_save_parameters_t;
int sp_save_parameters_encode(const sp_save_parameters_t *message, uint8_t *payload, size_t capacity);
bool sp_save_parameters_decode(sp_save_parameters_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_save_parameters_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_save_parameters_t *message)
{
    const int length = sp_save_parameters_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_SAVE_PARAMETERS, t_us, (size_t)length);
}
#endif

#if SP_WITH_SET_KEY
/* set_key (0x73, host): Set the key that motion is authenticated with; over a local UART
 * only, never told again. */
#define SP_TYPE_SET_KEY 0x73u
#define SP_SET_KEY_SIZE 18u
typedef struct {
    /* chosen by the host, counts up; names the command in its reply; id */
    uint16_t command_id;
    /* bytes 0 to 3 of the key; all words 0: no key */
    uint32_t key_0;
    /* bytes 4 to 7 */
    uint32_t key_1;
    /* bytes 8 to 11 */
    uint32_t key_2;
    /* bytes 12 to 15 */
    uint32_t key_3;
} sp_set_key_t;
int sp_set_key_encode(const sp_set_key_t *message, uint8_t *payload, size_t capacity);
bool sp_set_key_decode(sp_set_key_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_set_key_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_set_key_t *message)
{
    const int length = sp_set_key_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_SET_KEY, t_us, (size_t)length);
}
#endif

#if SP_WITH_PARAMETER_VALUE
/* parameter_value (0x78, device): A parameter with all that is to be known of it; sent as
 * get and set are carried out. */
#define SP_TYPE_PARAMETER_VALUE 0x78u
#define SP_PARAMETER_VALUE_SIZE 20u
typedef struct {
    /* number of the parameter; id */
    uint8_t parameter;
    /* parameters that the device has; count */
    uint8_t parameter_count;
    /* how its 32 bits are read; SP_PARAMETER_KIND_*; 0..2 */
    uint8_t kind;
    /* what is true of it; SP_PARAMETER_FLAG_* */
    uint8_t flags;
    /* present value */
    uint32_t value;
    /* after a factory reset */
    uint32_t default_;
    /* least value */
    uint32_t low;
    /* greatest value */
    uint32_t high;
    /* name, a blank, unit: "wheel_diameter m" */
    const char *name; /* not ended by a zero; decoded: inside the payload */
    uint8_t name_length;
} sp_parameter_value_t;
int sp_parameter_value_encode(const sp_parameter_value_t *message, uint8_t *payload, size_t capacity);
bool sp_parameter_value_decode(sp_parameter_value_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_parameter_value_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_parameter_value_t *message)
{
    const int length = sp_parameter_value_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_PARAMETER_VALUE, t_us, (size_t)length);
}
#endif

#if SP_WITH_LOG_TEXT
/* log_text (0x79, device): A line for people; at most 10 a second. */
#define SP_TYPE_LOG_TEXT 0x79u
#define SP_LOG_TEXT_SIZE 1u
typedef struct {
    /* severity; SP_LOG_LEVEL_*; 0..3 */
    uint8_t level;
    /* UTF-8 */
    const char *line; /* not ended by a zero; decoded: inside the payload */
    uint8_t line_length;
} sp_log_text_t;
int sp_log_text_encode(const sp_log_text_t *message, uint8_t *payload, size_t capacity);
bool sp_log_text_decode(sp_log_text_t *message, const uint8_t *payload, size_t length);
static inline size_t sp_log_text_frame(
    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_log_text_t *message)
{
    const int length = sp_log_text_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);
    return length < 0 ? 0u : sp_seal(frame, sender, SP_TYPE_LOG_TEXT, t_us, (size_t)length);
}
#endif

/* Whether a message may be addressed to SP_NODE_ALL. A device passes over every other
 * message for that node, as it does over those for another node. */
static inline bool sp_to_all(uint8_t type)
{
    switch (type) {
    case SP_TYPE_STOP_ALL:
    case SP_TYPE_HOST_HELLO:
#if SP_WITH_TIME_REQUEST
    case SP_TYPE_TIME_REQUEST:
#endif
        return true;
    default:
        return false;
    }
}

/* Whether a device that has a key takes a message only with its tag. */
static inline bool sp_needs_tag(uint8_t type)
{
    switch (type) {
#if SP_WITH_VELOCITY_SETPOINT
    case SP_TYPE_VELOCITY_SETPOINT:
#endif
#if SP_WITH_CLEAR_STOP
    case SP_TYPE_CLEAR_STOP:
#endif
#if SP_WITH_SET_MODE
    case SP_TYPE_SET_MODE:
#endif
#if SP_WITH_PLANNER_COMMAND
    case SP_TYPE_PLANNER_COMMAND:
#endif
#if SP_WITH_WHEEL_DUTY
    case SP_TYPE_WHEEL_DUTY:
#endif
#if SP_WITH_SET_STREAM_RATE
    case SP_TYPE_SET_STREAM_RATE:
#endif
#if SP_WITH_REBOOT
    case SP_TYPE_REBOOT:
#endif
#if SP_WITH_GET_PARAMETER
    case SP_TYPE_GET_PARAMETER:
#endif
#if SP_WITH_SET_PARAMETER
    case SP_TYPE_SET_PARAMETER:
#endif
#if SP_WITH_SAVE_PARAMETERS
    case SP_TYPE_SAVE_PARAMETERS:
#endif
#if SP_WITH_SET_KEY
    case SP_TYPE_SET_KEY:
#endif
        return true;
    default:
        return false;
    }
}

/* Whether a host that has a key signs a message. */
static inline bool sp_may_have_tag(uint8_t type)
{
    switch (type) {
#if SP_WITH_VELOCITY_SETPOINT
    case SP_TYPE_VELOCITY_SETPOINT:
#endif
#if SP_WITH_CLEAR_STOP
    case SP_TYPE_CLEAR_STOP:
#endif
#if SP_WITH_SET_MODE
    case SP_TYPE_SET_MODE:
#endif
#if SP_WITH_TIME_REQUEST
    case SP_TYPE_TIME_REQUEST:
#endif
#if SP_WITH_PLANNER_COMMAND
    case SP_TYPE_PLANNER_COMMAND:
#endif
#if SP_WITH_WHEEL_DUTY
    case SP_TYPE_WHEEL_DUTY:
#endif
#if SP_WITH_SET_STREAM_RATE
    case SP_TYPE_SET_STREAM_RATE:
#endif
#if SP_WITH_REBOOT
    case SP_TYPE_REBOOT:
#endif
#if SP_WITH_GET_PARAMETER
    case SP_TYPE_GET_PARAMETER:
#endif
#if SP_WITH_SET_PARAMETER
    case SP_TYPE_SET_PARAMETER:
#endif
#if SP_WITH_SAVE_PARAMETERS
    case SP_TYPE_SAVE_PARAMETERS:
#endif
#if SP_WITH_SET_KEY
    case SP_TYPE_SET_KEY:
#endif
        return true;
    default:
        return false;
    }
}

/* ---- agreement ---------------------------------------------------------------------------- */

#define SP_MAKERS_FIRST 0x50u /* types of makers' own messages */
#define SP_MAKERS_LAST 0x5Fu
#define SP_CATALOGUE_HASH 0xE851B5E5u /* of everything; sp_catalogue_hash() is what to send */
#define SP_UNKNOWN_COUNT 255u /* a count in a reply: no such message or enumeration here */

typedef enum { SP_UNKNOWN = 0, SP_FROM_HOST = 1, SP_FROM_DEVICE = 2 } sp_direction_t;

/* Who sends messages of a type, as far as this program was built with it. */
sp_direction_t sp_direction(uint8_t type);

/* Hash of all messages that this program was built with: for its hello. */
uint32_t sp_catalogue_hash(void);

/* Answer a host's question about a message, or about an enumeration. */
void sp_describe(const sp_describe_t *question, sp_describe_reply_t *answer);
void sp_describe_enum(const sp_describe_enum_t *question, sp_describe_enum_reply_t *answer);

/* Whether a host's message may end before its last fields, and how long its first `fields` are, a
 * text left out; 255: all of them. 0 of a type that is unknown. */
bool sp_is_bootstrap(uint8_t type);
uint8_t sp_prefix_size(uint8_t type, uint8_t fields);
uint8_t sp_field_count(uint8_t type);

#if SP_WITH_CAN
/* ---- classic CAN: id = type << 4 | node, 11 bits, at most 8 B ----------------------------- */

#ifndef SP_CAN_OPEN
#define SP_CAN_OPEN 2 /* transfers that are put together at the same time */
#endif
#ifndef SP_CAN_RECENT
#define SP_CAN_RECENT 4 /* frames of different ids that are known again when they are doubled */
#endif
#define SP_CAN_CONTENT_MAX 246u

typedef struct {
    uint16_t id;
    uint8_t length;
    uint8_t data[8];
} sp_can_frame_t;

/* A device that sends. All zero but for the node is one that has sent nothing. */
typedef struct {
    uint8_t node;
    uint8_t flags;         /* SP_FLAG_*, of what is not periodic */
    uint8_t slow_sent;     /* bits: parts with a slow pace that were sent */
    uint32_t frames;       /* sent so far; it is put into every sync message */
    uint32_t slow_us[1];   /* when they were */
    uint8_t transfer[35]; /* next transfer of each message */
} sp_can_sender_t;

/* A message on its way out. Its payload must stay until the last frame is fetched. */
typedef struct {
    const uint8_t *payload;
    uint32_t t_us;
    uint8_t type;
    uint8_t length;
    uint8_t native;
    uint8_t tail;
    uint8_t toggle;
    uint8_t head_length;
    uint16_t total; /* bytes of content, its CRC included */
    uint16_t position;
    uint8_t head[5];
    uint8_t crc[4];
} sp_can_message_t;

/* A transfer of which segments are still to come. */
typedef struct {
    uint32_t began_us;
    uint32_t order;
    uint16_t id;
    uint16_t length; /* 0: free */
    uint8_t transfer;
    uint8_t toggle;
    uint8_t data[SP_CAN_CONTENT_MAX + 4u];
} sp_can_transfer_t;

#define SP_CAN_HOST_PARTS 1 /* frames of a host's periodic message, at most */

#if SP_CAN_HOST_PARTS > 1
/* A periodic message of which parts are still to come. */
typedef struct {
    uint32_t t_us;
    uint8_t type;
    uint8_t node;
    uint8_t came; /* bits: the parts that are here */
    uint8_t part_length[SP_CAN_HOST_PARTS];
    uint8_t parts[SP_CAN_HOST_PARTS][6];
    uint8_t payload[SP_CAN_HOST_PARTS * 6u];
} sp_can_joined_t;
#endif

/* A device that listens to its host. All zero is one that has heard nothing. */
typedef struct {
    uint32_t frames;   /* messages that were complete */
    uint32_t damaged;  /* transfers whose CRC did not hold */
    uint32_t doubled;  /* frames that came twice */
    uint32_t stale;    /* messages with a stamp too old to be understood */
    uint32_t given_up; /* transfers that lost a segment */
    uint32_t wire_us;  /* newest stamp of the host */
    uint32_t ahead_us; /* host's clock less ours, by the quickest frame */
    uint32_t at_us;
    uint32_t order;
    bool stamped;
    uint8_t next_recent;
    uint8_t single[7]; /* content of a single frame */
    const uint8_t *content; /* of the message just received, which its tag covers; NULL: periodic */
    size_t content_length;
#if SP_CAN_HOST_PARTS > 1
    uint32_t incomplete; /* messages of which a part did not come */
    sp_can_joined_t joined;
    uint8_t unshared[35]; /* last bytes of each message that the host does not know */
#endif
    struct {
        uint32_t at_us;
        sp_can_frame_t frame;
        bool used;
    } recent[SP_CAN_RECENT];
    sp_can_transfer_t open[SP_CAN_OPEN];
} sp_can_receiver_t;

/* Begin to send a message whose payload has been encoded; false where its length is wrong or its
 * type unknown. Then fetch its frames until there is no more. */
bool sp_can_begin(sp_can_sender_t *sender, sp_can_message_t *message, uint8_t type, uint32_t t_us,
    const uint8_t *payload, size_t length);
bool sp_can_next(sp_can_sender_t *sender, sp_can_message_t *message, sp_can_frame_t *frame);

/* Who sends frames of a type, which is a message's or that of one of its parts. */
sp_direction_t sp_can_direction(uint8_t can_type);

#if SP_CAN_HOST_PARTS > 1
/* The host knows so many bytes of a message's payload: it sends no parts beyond them. */
void sp_can_limit(sp_can_receiver_t *receiver, uint8_t type, size_t length);
#endif

/* Take a data frame with an 11-bit identifier that came at now_us. SP_FRAME: a message is
 * complete, its payload stands in the receiver until the next frame is taken. */
sp_event_t sp_can_receive(
    sp_can_receiver_t *receiver, const sp_can_frame_t *in, uint32_t now_us, sp_frame_t *frame);
#endif

#ifdef __cplusplus
}
#endif

#endif
