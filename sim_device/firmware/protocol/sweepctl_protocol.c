/* The sweeper's wire in C99.
 *
 * Made by `sweepctl generate c`; changes belong into the catalogue.
 * Protocol version 2, catalogue 0x4CE121F8, 35 messages.
 * SPDX-License-Identifier: MIT
 */

#include "sweepctl_protocol.h"

static void sp_copy(uint8_t *target, const uint8_t *source, size_t length)
{
    for (size_t i = 0; i < length; i++) {
        target[i] = source[i];
    }
}

static inline void sp_put_u16(uint8_t *p, uint16_t value)
{
    p[0] = (uint8_t)value;
    p[1] = (uint8_t)(value >> 8);
}

static inline void sp_put_u32(uint8_t *p, uint32_t value)
{
    p[0] = (uint8_t)value;
    p[1] = (uint8_t)(value >> 8);
    p[2] = (uint8_t)(value >> 16);
    p[3] = (uint8_t)(value >> 24);
}

static inline uint16_t sp_get_u16(const uint8_t *p)
{
    return (uint16_t)(p[0] | p[1] << 8);
}

static inline int16_t sp_get_i16(const uint8_t *p)
{
    return (int16_t)((int32_t)(sp_get_u16(p) ^ 0x8000u) - 0x8000);
}

static inline uint32_t sp_get_u32(const uint8_t *p)
{
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

/* ---- CRC-32: reflected 0x04C11DB7, ones in, complemented out ------------------------------ */

#ifdef SP_CRC_FULL_TABLE
static const uint32_t sp_crc_table[256] = {
    0x00000000u, 0x77073096u, 0xEE0E612Cu, 0x990951BAu, 0x076DC419u, 0x706AF48Fu,
    0xE963A535u, 0x9E6495A3u, 0x0EDB8832u, 0x79DCB8A4u, 0xE0D5E91Eu, 0x97D2D988u,
    0x09B64C2Bu, 0x7EB17CBDu, 0xE7B82D07u, 0x90BF1D91u, 0x1DB71064u, 0x6AB020F2u,
    0xF3B97148u, 0x84BE41DEu, 0x1ADAD47Du, 0x6DDDE4EBu, 0xF4D4B551u, 0x83D385C7u,
    0x136C9856u, 0x646BA8C0u, 0xFD62F97Au, 0x8A65C9ECu, 0x14015C4Fu, 0x63066CD9u,
    0xFA0F3D63u, 0x8D080DF5u, 0x3B6E20C8u, 0x4C69105Eu, 0xD56041E4u, 0xA2677172u,
    0x3C03E4D1u, 0x4B04D447u, 0xD20D85FDu, 0xA50AB56Bu, 0x35B5A8FAu, 0x42B2986Cu,
    0xDBBBC9D6u, 0xACBCF940u, 0x32D86CE3u, 0x45DF5C75u, 0xDCD60DCFu, 0xABD13D59u,
    0x26D930ACu, 0x51DE003Au, 0xC8D75180u, 0xBFD06116u, 0x21B4F4B5u, 0x56B3C423u,
    0xCFBA9599u, 0xB8BDA50Fu, 0x2802B89Eu, 0x5F058808u, 0xC60CD9B2u, 0xB10BE924u,
    0x2F6F7C87u, 0x58684C11u, 0xC1611DABu, 0xB6662D3Du, 0x76DC4190u, 0x01DB7106u,
    0x98D220BCu, 0xEFD5102Au, 0x71B18589u, 0x06B6B51Fu, 0x9FBFE4A5u, 0xE8B8D433u,
    0x7807C9A2u, 0x0F00F934u, 0x9609A88Eu, 0xE10E9818u, 0x7F6A0DBBu, 0x086D3D2Du,
    0x91646C97u, 0xE6635C01u, 0x6B6B51F4u, 0x1C6C6162u, 0x856530D8u, 0xF262004Eu,
    0x6C0695EDu, 0x1B01A57Bu, 0x8208F4C1u, 0xF50FC457u, 0x65B0D9C6u, 0x12B7E950u,
    0x8BBEB8EAu, 0xFCB9887Cu, 0x62DD1DDFu, 0x15DA2D49u, 0x8CD37CF3u, 0xFBD44C65u,
    0x4DB26158u, 0x3AB551CEu, 0xA3BC0074u, 0xD4BB30E2u, 0x4ADFA541u, 0x3DD895D7u,
    0xA4D1C46Du, 0xD3D6F4FBu, 0x4369E96Au, 0x346ED9FCu, 0xAD678846u, 0xDA60B8D0u,
    0x44042D73u, 0x33031DE5u, 0xAA0A4C5Fu, 0xDD0D7CC9u, 0x5005713Cu, 0x270241AAu,
    0xBE0B1010u, 0xC90C2086u, 0x5768B525u, 0x206F85B3u, 0xB966D409u, 0xCE61E49Fu,
    0x5EDEF90Eu, 0x29D9C998u, 0xB0D09822u, 0xC7D7A8B4u, 0x59B33D17u, 0x2EB40D81u,
    0xB7BD5C3Bu, 0xC0BA6CADu, 0xEDB88320u, 0x9ABFB3B6u, 0x03B6E20Cu, 0x74B1D29Au,
    0xEAD54739u, 0x9DD277AFu, 0x04DB2615u, 0x73DC1683u, 0xE3630B12u, 0x94643B84u,
    0x0D6D6A3Eu, 0x7A6A5AA8u, 0xE40ECF0Bu, 0x9309FF9Du, 0x0A00AE27u, 0x7D079EB1u,
    0xF00F9344u, 0x8708A3D2u, 0x1E01F268u, 0x6906C2FEu, 0xF762575Du, 0x806567CBu,
    0x196C3671u, 0x6E6B06E7u, 0xFED41B76u, 0x89D32BE0u, 0x10DA7A5Au, 0x67DD4ACCu,
    0xF9B9DF6Fu, 0x8EBEEFF9u, 0x17B7BE43u, 0x60B08ED5u, 0xD6D6A3E8u, 0xA1D1937Eu,
    0x38D8C2C4u, 0x4FDFF252u, 0xD1BB67F1u, 0xA6BC5767u, 0x3FB506DDu, 0x48B2364Bu,
    0xD80D2BDAu, 0xAF0A1B4Cu, 0x36034AF6u, 0x41047A60u, 0xDF60EFC3u, 0xA867DF55u,
    0x316E8EEFu, 0x4669BE79u, 0xCB61B38Cu, 0xBC66831Au, 0x256FD2A0u, 0x5268E236u,
    0xCC0C7795u, 0xBB0B4703u, 0x220216B9u, 0x5505262Fu, 0xC5BA3BBEu, 0xB2BD0B28u,
    0x2BB45A92u, 0x5CB36A04u, 0xC2D7FFA7u, 0xB5D0CF31u, 0x2CD99E8Bu, 0x5BDEAE1Du,
    0x9B64C2B0u, 0xEC63F226u, 0x756AA39Cu, 0x026D930Au, 0x9C0906A9u, 0xEB0E363Fu,
    0x72076785u, 0x05005713u, 0x95BF4A82u, 0xE2B87A14u, 0x7BB12BAEu, 0x0CB61B38u,
    0x92D28E9Bu, 0xE5D5BE0Du, 0x7CDCEFB7u, 0x0BDBDF21u, 0x86D3D2D4u, 0xF1D4E242u,
    0x68DDB3F8u, 0x1FDA836Eu, 0x81BE16CDu, 0xF6B9265Bu, 0x6FB077E1u, 0x18B74777u,
    0x88085AE6u, 0xFF0F6A70u, 0x66063BCAu, 0x11010B5Cu, 0x8F659EFFu, 0xF862AE69u,
    0x616BFFD3u, 0x166CCF45u, 0xA00AE278u, 0xD70DD2EEu, 0x4E048354u, 0x3903B3C2u,
    0xA7672661u, 0xD06016F7u, 0x4969474Du, 0x3E6E77DBu, 0xAED16A4Au, 0xD9D65ADCu,
    0x40DF0B66u, 0x37D83BF0u, 0xA9BCAE53u, 0xDEBB9EC5u, 0x47B2CF7Fu, 0x30B5FFE9u,
    0xBDBDF21Cu, 0xCABAC28Au, 0x53B39330u, 0x24B4A3A6u, 0xBAD03605u, 0xCDD70693u,
    0x54DE5729u, 0x23D967BFu, 0xB3667A2Eu, 0xC4614AB8u, 0x5D681B02u, 0x2A6F2B94u,
    0xB40BBE37u, 0xC30C8EA1u, 0x5A05DF1Bu, 0x2D02EF8Du,
};
#else
static const uint32_t sp_crc_table[16] = {
    0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u,
    0x4DB26158u, 0x5005713Cu, 0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu,
    0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
};
#endif

uint32_t sp_crc32_update(uint32_t crc, const uint8_t *data, size_t length)
{
    crc = ~crc;
    for (size_t i = 0; i < length; i++) {
#ifdef SP_CRC_FULL_TABLE
        crc = crc >> 8 ^ sp_crc_table[(crc ^ data[i]) & 0xFFu];
#else
        crc ^= data[i];
        crc = crc >> 4 ^ sp_crc_table[crc & 0xFu];
        crc = crc >> 4 ^ sp_crc_table[crc & 0xFu];
#endif
    }
    return ~crc;
}

#ifdef SP_CRC_UNIT
#ifndef SP_CRC_UNIT_RESET /* RM0090, section 4.4: data register, control register */
#define SP_CRC_UNIT_RESET() (*(volatile uint32_t *)0x40023008u = 1u)
#define SP_CRC_UNIT_WRITE(word) (*(volatile uint32_t *)0x40023000u = (word))
#define SP_CRC_UNIT_READ() (*(volatile uint32_t *)0x40023000u)
#endif

static uint32_t sp_reverse_bits(uint32_t word)
{
#if defined(__ARM_ARCH) && __ARM_ARCH >= 7
    uint32_t reversed;
    __asm__("rbit %0, %1" : "=r"(reversed) : "r"(word));
    return reversed;
#else
    word = (word >> 1 & 0x55555555u) | (word & 0x55555555u) << 1;
    word = (word >> 2 & 0x33333333u) | (word & 0x33333333u) << 2;
    word = (word >> 4 & 0x0F0F0F0Fu) | (word & 0x0F0F0F0Fu) << 4;
    word = (word >> 8 & 0x00FF00FFu) | (word & 0x00FF00FFu) << 8;
    return word >> 16 | word << 16;
#endif
}

uint32_t sp_crc32_unit(const uint8_t *data, size_t length)
{
    /* The unit shifts the highest bit first: words go in and come out mirrored. */
    const size_t whole = length & ~(size_t)3u;
    SP_CRC_UNIT_RESET();
    for (size_t i = 0; i < whole; i += 4u) {
        SP_CRC_UNIT_WRITE(sp_reverse_bits(sp_get_u32(data + i)));
    }
    return sp_crc32_update(~sp_reverse_bits(SP_CRC_UNIT_READ()), data + whole, length - whole);
}
#endif

#ifndef SP_CRC32
#ifdef SP_CRC_UNIT
#define SP_CRC32(data, length) sp_crc32_unit((data), (length))
#else
#define SP_CRC32(data, length) sp_crc32_update(0u, (data), (length))
#endif
#endif

/* ---- frames ------------------------------------------------------------------------------- */

size_t sp_seal(
    uint8_t *frame, sp_sender_t *sender, uint8_t type, uint32_t t_us, size_t payload_length)
{
    uint8_t *const body = frame + 2;
    if (payload_length > SP_PAYLOAD_MAX) {
        return 0;
    }
    body[0] = (uint8_t)(SP_VERSION << 4 | (sender->flags & 0x0Fu));
    body[1] = sender->node;
    body[2] = type;
    body[3] = sender->seq++;
    sender->frames++;
    sp_put_u32(body + 4, t_us);
    const size_t content = SP_HEADER_SIZE + payload_length;
    sp_put_u32(body + content, SP_CRC32(body, content));
    /* COBS in place: each zero, and the byte before the first, gives the way to the next. A body
     * of at most 253 B needs no other code bytes. */
    uint8_t *const end = body + content + 4;
    uint8_t *code = frame + 1;
    for (uint8_t *p = body; p < end; p++) {
        if (*p == 0) {
            *code = (uint8_t)(p - code);
            code = p;
        }
    }
    *code = (uint8_t)(end - code);
    *end = 0;
    frame[0] = 0;
    return (size_t)(end - frame) + 1;
}

/* At a delimiter: what were the bytes before it? */
static sp_event_t sp_judge(const sp_parser_t *parser, sp_frame_t *frame)
{
    const uint8_t *const body = parser->body;
    const uint8_t length = (uint8_t)(parser->count - 1u);
    if (parser->count > SP_BODY_MAX + 1u) {
        return SP_BAD_LENGTH;
    }
    if (parser->left != 0) {
        return SP_BAD_COBS;
    }
    if (length < SP_BODY_MIN) {
        return SP_BAD_LENGTH;
    }
    const uint8_t content = (uint8_t)(length - 4u);
    if (SP_CRC32(body, content) != sp_get_u32(body + content)) {
        return SP_BAD_CRC;
    }
    frame->version = body[0] >> 4;
    frame->flags = body[0] & 0x0Fu;
    frame->node = body[1];
    frame->type = body[2];
    frame->seq = body[3];
    frame->t_us = sp_get_u32(body + 4);
    frame->payload = body + SP_HEADER_SIZE;
    frame->length = (uint8_t)(content - SP_HEADER_SIZE);
    return SP_FRAME;
}

sp_event_t sp_parser_byte(sp_parser_t *parser, uint8_t byte, sp_frame_t *frame)
{
    const uint8_t count = parser->count;
    if (byte == 0) {
        sp_event_t event = SP_NOTHING; /* a lone zero is no error */
        if (count != 0) {
            event = sp_judge(parser, frame);
            if (event == SP_FRAME) {
                parser->frames++;
            } else {
                parser->damaged++;
            }
        }
        parser->count = 0;
        parser->left = 0;
        return event;
    }
    if (count > SP_BODY_MAX) { /* full: only count that it was too much */
        parser->count = SP_BODY_MAX + 2u;
        return SP_NOTHING;
    }
    if (parser->left == 0) {
        parser->left = (uint8_t)(byte - 1u);
        byte = 0; /* what the code byte stands for; the first one for nothing */
    } else {
        parser->left--;
    }
    if (count != 0) {
        parser->body[count - 1u] = byte;
    }
    parser->count = (uint8_t)(count + 1u);
    return SP_NOTHING;
}

size_t sp_parser_block(
    sp_parser_t *parser, const uint8_t *data, size_t length, sp_frame_t *frame, sp_event_t *event)
{
    size_t taken = 0;
    *event = SP_NOTHING;
    while (taken < length && *event == SP_NOTHING) {
        *event = sp_parser_byte(parser, data[taken], frame);
        taken++;
    }
    return taken;
}

/* ---- messages ---------------------------------------------------------------------------- */

int sp_stop_all_encode(const sp_stop_all_t *message, uint8_t *payload, size_t capacity)
{
    (void)message;
    (void)payload;
    (void)capacity;
    return 0;
}

bool sp_stop_all_decode(sp_stop_all_t *message, const uint8_t *payload, size_t length)
{
    (void)payload;
    (void)length;
    message->nothing = 0;
    return true;
}

int sp_stop_encode(const sp_stop_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_STOP_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->cause;
    return (int)SP_STOP_SIZE;
}

bool sp_stop_decode(sp_stop_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_STOP_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->cause = payload[2];
    return true;
}

#if SP_WITH_VELOCITY_SETPOINT
int sp_velocity_setpoint_encode(const sp_velocity_setpoint_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_VELOCITY_SETPOINT_SIZE) {
        return -1;
    }
    sp_put_u16(payload, (uint16_t)message->v);
    sp_put_u16(payload + 2, (uint16_t)message->yaw_rate);
    payload[4] = message->time_to_live;
    payload[5] = message->counter;
    return (int)SP_VELOCITY_SETPOINT_SIZE;
}

bool sp_velocity_setpoint_decode(sp_velocity_setpoint_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_VELOCITY_SETPOINT_SIZE) {
        return false;
    }
    message->v = sp_get_i16(payload);
    message->yaw_rate = sp_get_i16(payload + 2);
    message->time_to_live = payload[4];
    message->counter = payload[5];
    return true;
}
#endif

int sp_host_hello_encode(const sp_host_hello_t *message, uint8_t *payload, size_t capacity)
{
    const size_t length = SP_HOST_HELLO_SIZE + (size_t)message->name_length;
    if (capacity < length || SP_PAYLOAD_MAX < length) {
        return -1;
    }
    sp_put_u32(payload, message->catalogue_hash);
    sp_put_u32(payload + 4, message->session_id);
    sp_put_u32(payload + 8, message->boot_id);
    payload[12] = message->negotiated;
    sp_copy(payload + 13, (const uint8_t *)message->name, message->name_length);
    return (int)length;
}

bool sp_host_hello_decode(sp_host_hello_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_HOST_HELLO_SIZE || SP_PAYLOAD_MAX < length) {
        return false;
    }
    message->catalogue_hash = sp_get_u32(payload);
    message->session_id = sp_get_u32(payload + 4);
    message->boot_id = sp_get_u32(payload + 8);
    message->negotiated = payload[12];
    message->name = (const char *)(payload + 13);
    message->name_length = (uint8_t)(length - SP_HOST_HELLO_SIZE);
    return true;
}

#if SP_WITH_CLEAR_STOP
int sp_clear_stop_encode(const sp_clear_stop_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_CLEAR_STOP_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->cause;
    return (int)SP_CLEAR_STOP_SIZE;
}

bool sp_clear_stop_decode(sp_clear_stop_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_CLEAR_STOP_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->cause = payload[2];
    return true;
}
#endif

#if SP_WITH_SET_MODE
int sp_set_mode_encode(const sp_set_mode_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_SET_MODE_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->mode;
    return (int)SP_SET_MODE_SIZE;
}

bool sp_set_mode_decode(sp_set_mode_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_SET_MODE_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->mode = payload[2];
    return true;
}
#endif

#if SP_WITH_TIME_REQUEST
int sp_time_request_encode(const sp_time_request_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_TIME_REQUEST_SIZE) {
        return -1;
    }
    payload[0] = message->ping;
    return (int)SP_TIME_REQUEST_SIZE;
}

bool sp_time_request_decode(sp_time_request_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_TIME_REQUEST_SIZE) {
        return false;
    }
    message->ping = payload[0];
    return true;
}
#endif

int sp_describe_encode(const sp_describe_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_DESCRIBE_SIZE) {
        return -1;
    }
    payload[0] = message->described_type;
    payload[1] = message->field_count;
    return (int)SP_DESCRIBE_SIZE;
}

bool sp_describe_decode(sp_describe_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_DESCRIBE_SIZE) {
        return false;
    }
    message->described_type = payload[0];
    message->field_count = payload[1];
    return true;
}

#if SP_WITH_PLANNER_COMMAND
int sp_planner_command_encode(const sp_planner_command_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_PLANNER_COMMAND_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->action;
    payload[3] = message->planner;
    return (int)SP_PLANNER_COMMAND_SIZE;
}

bool sp_planner_command_decode(sp_planner_command_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_PLANNER_COMMAND_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->action = payload[2];
    message->planner = payload[3];
    return true;
}
#endif

#if SP_WITH_WHEEL_DUTY
int sp_wheel_duty_encode(const sp_wheel_duty_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_WHEEL_DUTY_SIZE) {
        return -1;
    }
    sp_put_u16(payload, (uint16_t)message->left);
    sp_put_u16(payload + 2, (uint16_t)message->right);
    payload[4] = message->time_to_live;
    payload[5] = message->counter;
    return (int)SP_WHEEL_DUTY_SIZE;
}

bool sp_wheel_duty_decode(sp_wheel_duty_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_WHEEL_DUTY_SIZE) {
        return false;
    }
    message->left = sp_get_i16(payload);
    message->right = sp_get_i16(payload + 2);
    message->time_to_live = payload[4];
    message->counter = payload[5];
    return true;
}
#endif

int sp_describe_enum_encode(const sp_describe_enum_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_DESCRIBE_ENUM_SIZE) {
        return -1;
    }
    sp_put_u32(payload, message->enumeration);
    payload[4] = message->member_count;
    return (int)SP_DESCRIBE_ENUM_SIZE;
}

bool sp_describe_enum_decode(sp_describe_enum_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_DESCRIBE_ENUM_SIZE) {
        return false;
    }
    message->enumeration = sp_get_u32(payload);
    message->member_count = payload[4];
    return true;
}

#if SP_WITH_SET_STREAM_RATE
int sp_set_stream_rate_encode(const sp_set_stream_rate_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_SET_STREAM_RATE_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->stream_type;
    sp_put_u16(payload + 3, message->rate);
    return (int)SP_SET_STREAM_RATE_SIZE;
}

bool sp_set_stream_rate_decode(sp_set_stream_rate_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_SET_STREAM_RATE_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->stream_type = payload[2];
    message->rate = sp_get_u16(payload + 3);
    return true;
}
#endif

#if SP_WITH_REBOOT
int sp_reboot_encode(const sp_reboot_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_REBOOT_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->kind;
    return (int)SP_REBOOT_SIZE;
}

bool sp_reboot_decode(sp_reboot_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_REBOOT_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->kind = payload[2];
    return true;
}
#endif

#if SP_WITH_SYNC
int sp_sync_encode(const sp_sync_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_SYNC_SIZE) {
        return -1;
    }
    sp_put_u32(payload, message->frame_count);
    return (int)SP_SYNC_SIZE;
}

bool sp_sync_decode(sp_sync_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_SYNC_SIZE) {
        return false;
    }
    message->frame_count = sp_get_u32(payload);
    return true;
}
#endif

#if SP_WITH_STATUS
int sp_status_encode(const sp_status_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_STATUS_SIZE) {
        return -1;
    }
    payload[0] = message->mode;
    payload[1] = message->stop_cause;
    sp_put_u16(payload + 2, message->faults);
    payload[4] = message->setpoint_remaining;
    payload[5] = message->load;
    return (int)SP_STATUS_SIZE;
}

bool sp_status_decode(sp_status_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_STATUS_SIZE) {
        return false;
    }
    message->mode = payload[0];
    message->stop_cause = payload[1];
    message->faults = sp_get_u16(payload + 2);
    message->setpoint_remaining = payload[4];
    message->load = payload[5];
    return true;
}
#endif

#if SP_WITH_IMU
int sp_imu_encode(const sp_imu_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_IMU_SIZE) {
        return -1;
    }
    sp_put_u16(payload, (uint16_t)message->accel_x);
    sp_put_u16(payload + 2, (uint16_t)message->accel_y);
    sp_put_u16(payload + 4, (uint16_t)message->accel_z);
    sp_put_u16(payload + 6, (uint16_t)message->temperature);
    sp_put_u16(payload + 8, (uint16_t)message->gyro_x);
    sp_put_u16(payload + 10, (uint16_t)message->gyro_y);
    sp_put_u16(payload + 12, (uint16_t)message->gyro_z);
    return (int)SP_IMU_SIZE;
}

bool sp_imu_decode(sp_imu_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_IMU_SIZE) {
        return false;
    }
    message->accel_x = sp_get_i16(payload);
    message->accel_y = sp_get_i16(payload + 2);
    message->accel_z = sp_get_i16(payload + 4);
    message->temperature = sp_get_i16(payload + 6);
    message->gyro_x = sp_get_i16(payload + 8);
    message->gyro_y = sp_get_i16(payload + 10);
    message->gyro_z = sp_get_i16(payload + 12);
    return true;
}
#endif

#if SP_WITH_ENCODERS
int sp_encoders_encode(const sp_encoders_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_ENCODERS_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->left);
    sp_put_u16(payload + 2, message->right);
    return (int)SP_ENCODERS_SIZE;
}

bool sp_encoders_decode(sp_encoders_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_ENCODERS_SIZE) {
        return false;
    }
    message->left = sp_get_u16(payload);
    message->right = sp_get_u16(payload + 2);
    return true;
}
#endif

#if SP_WITH_TIME_REPLY
int sp_time_reply_encode(const sp_time_reply_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_TIME_REPLY_SIZE) {
        return -1;
    }
    payload[0] = message->ping;
    sp_put_u32(payload + 1, message->received_us);
    return (int)SP_TIME_REPLY_SIZE;
}

bool sp_time_reply_decode(sp_time_reply_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_TIME_REPLY_SIZE) {
        return false;
    }
    message->ping = payload[0];
    message->received_us = sp_get_u32(payload + 1);
    return true;
}
#endif

int sp_ack_encode(const sp_ack_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_ACK_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->command_type;
    return (int)SP_ACK_SIZE;
}

bool sp_ack_decode(sp_ack_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_ACK_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->command_type = payload[2];
    return true;
}

int sp_nack_encode(const sp_nack_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_NACK_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->command_type;
    payload[3] = message->reason;
    return (int)SP_NACK_SIZE;
}

bool sp_nack_decode(sp_nack_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_NACK_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->command_type = payload[2];
    message->reason = payload[3];
    return true;
}

int sp_hello_encode(const sp_hello_t *message, uint8_t *payload, size_t capacity)
{
    const size_t length = SP_HELLO_SIZE + (size_t)message->name_length;
    if (capacity < length || SP_PAYLOAD_MAX < length) {
        return -1;
    }
    sp_put_u32(payload, message->catalogue_hash);
    sp_copy(payload + 4, message->uid, 12u);
    sp_put_u32(payload + 16, message->boot_id);
    sp_put_u32(payload + 20, message->session_id);
    payload[24] = message->reset_cause;
    sp_put_u16(payload + 25, message->capabilities);
    payload[27] = message->version_major;
    payload[28] = message->version_minor;
    payload[29] = message->version_patch;
    sp_copy(payload + 30, (const uint8_t *)message->name, message->name_length);
    return (int)length;
}

bool sp_hello_decode(sp_hello_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_HELLO_SIZE || SP_PAYLOAD_MAX < length) {
        return false;
    }
    message->catalogue_hash = sp_get_u32(payload);
    sp_copy(message->uid, payload + 4, 12u);
    message->boot_id = sp_get_u32(payload + 16);
    message->session_id = sp_get_u32(payload + 20);
    message->reset_cause = payload[24];
    message->capabilities = sp_get_u16(payload + 25);
    message->version_major = payload[27];
    message->version_minor = payload[28];
    message->version_patch = payload[29];
    message->name = (const char *)(payload + 30);
    message->name_length = (uint8_t)(length - SP_HELLO_SIZE);
    return true;
}

int sp_describe_reply_encode(const sp_describe_reply_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_DESCRIBE_REPLY_SIZE) {
        return -1;
    }
    payload[0] = message->described_type;
    payload[1] = message->field_count;
    payload[2] = message->payload_length;
    sp_put_u32(payload + 3, message->chain);
    return (int)SP_DESCRIBE_REPLY_SIZE;
}

bool sp_describe_reply_decode(sp_describe_reply_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_DESCRIBE_REPLY_SIZE) {
        return false;
    }
    message->described_type = payload[0];
    message->field_count = payload[1];
    message->payload_length = payload[2];
    message->chain = sp_get_u32(payload + 3);
    return true;
}

#if SP_WITH_IMU_INFO
int sp_imu_info_encode(const sp_imu_info_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_IMU_INFO_SIZE) {
        return -1;
    }
    sp_put_u32(payload, message->accel);
    sp_put_u32(payload + 4, message->gyro);
    sp_put_u32(payload + 8, message->temperature);
    sp_put_u16(payload + 12, (uint16_t)message->zero);
    return (int)SP_IMU_INFO_SIZE;
}

bool sp_imu_info_decode(sp_imu_info_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_IMU_INFO_SIZE) {
        return false;
    }
    message->accel = sp_get_u32(payload);
    message->gyro = sp_get_u32(payload + 4);
    message->temperature = sp_get_u32(payload + 8);
    message->zero = sp_get_i16(payload + 12);
    return true;
}
#endif

int sp_describe_enum_reply_encode(const sp_describe_enum_reply_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_DESCRIBE_ENUM_REPLY_SIZE) {
        return -1;
    }
    sp_put_u32(payload, message->enumeration);
    payload[4] = message->member_count;
    sp_put_u32(payload + 5, message->chain);
    return (int)SP_DESCRIBE_ENUM_REPLY_SIZE;
}

bool sp_describe_enum_reply_decode(sp_describe_enum_reply_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_DESCRIBE_ENUM_REPLY_SIZE) {
        return false;
    }
    message->enumeration = sp_get_u32(payload);
    message->member_count = payload[4];
    message->chain = sp_get_u32(payload + 5);
    return true;
}

#if SP_WITH_CHALLENGE
int sp_challenge_encode(const sp_challenge_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_CHALLENGE_SIZE) {
        return -1;
    }
    sp_put_u32(payload, message->counter);
    return (int)SP_CHALLENGE_SIZE;
}

bool sp_challenge_decode(sp_challenge_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_CHALLENGE_SIZE) {
        return false;
    }
    message->counter = sp_get_u32(payload);
    return true;
}
#endif

#if SP_WITH_RANGE
int sp_range_encode(const sp_range_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_RANGE_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->ultrasonic);
    payload[2] = message->infrared_left;
    payload[3] = message->infrared_right;
    payload[4] = message->contacts;
    return (int)SP_RANGE_SIZE;
}

bool sp_range_decode(sp_range_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_RANGE_SIZE) {
        return false;
    }
    message->ultrasonic = sp_get_u16(payload);
    message->infrared_left = payload[2];
    message->infrared_right = payload[3];
    message->contacts = payload[4];
    return true;
}
#endif

#if SP_WITH_POWER
int sp_power_encode(const sp_power_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_POWER_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->battery);
    payload[2] = message->logic;
    payload[3] = message->motor_left;
    payload[4] = message->motor_right;
    return (int)SP_POWER_SIZE;
}

bool sp_power_decode(sp_power_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_POWER_SIZE) {
        return false;
    }
    message->battery = sp_get_u16(payload);
    message->logic = payload[2];
    message->motor_left = payload[3];
    message->motor_right = payload[4];
    return true;
}
#endif

#if SP_WITH_LINK_COUNTERS
int sp_link_counters_encode(const sp_link_counters_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_LINK_COUNTERS_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->received);
    sp_put_u16(payload + 2, message->damaged);
    sp_put_u16(payload + 4, message->stale);
    sp_put_u16(payload + 6, message->receive_dropped);
    sp_put_u16(payload + 8, message->send_dropped);
    payload[10] = message->can_send_errors;
    payload[11] = message->can_receive_errors;
    sp_put_u16(payload + 12, message->can_bus_offs);
    return (int)SP_LINK_COUNTERS_SIZE;
}

bool sp_link_counters_decode(sp_link_counters_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_LINK_COUNTERS_SIZE) {
        return false;
    }
    message->received = sp_get_u16(payload);
    message->damaged = sp_get_u16(payload + 2);
    message->stale = sp_get_u16(payload + 4);
    message->receive_dropped = sp_get_u16(payload + 6);
    message->send_dropped = sp_get_u16(payload + 8);
    message->can_send_errors = payload[10];
    message->can_receive_errors = payload[11];
    message->can_bus_offs = sp_get_u16(payload + 12);
    return true;
}
#endif

#if SP_WITH_PLANNER_STATE
int sp_planner_state_encode(const sp_planner_state_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_PLANNER_STATE_SIZE) {
        return -1;
    }
    payload[0] = message->phase;
    payload[1] = message->turn_count;
    sp_put_u16(payload + 2, (uint16_t)message->target_x);
    sp_put_u16(payload + 4, (uint16_t)message->target_y);
    sp_put_u16(payload + 6, message->lane_distance);
    sp_put_u16(payload + 8, message->previous_lane_distance);
    payload[10] = message->length;
    payload[11] = message->lane_case;
    return (int)SP_PLANNER_STATE_SIZE;
}

bool sp_planner_state_decode(sp_planner_state_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_PLANNER_STATE_SIZE) {
        return false;
    }
    message->phase = payload[0];
    message->turn_count = payload[1];
    message->target_x = sp_get_i16(payload + 2);
    message->target_y = sp_get_i16(payload + 4);
    message->lane_distance = sp_get_u16(payload + 6);
    message->previous_lane_distance = sp_get_u16(payload + 8);
    message->length = payload[10];
    message->lane_case = payload[11];
    return true;
}
#endif

#if SP_WITH_GET_PARAMETER
int sp_get_parameter_encode(const sp_get_parameter_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_GET_PARAMETER_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->parameter;
    return (int)SP_GET_PARAMETER_SIZE;
}

bool sp_get_parameter_decode(sp_get_parameter_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_GET_PARAMETER_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->parameter = payload[2];
    return true;
}
#endif

#if SP_WITH_SET_PARAMETER
int sp_set_parameter_encode(const sp_set_parameter_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_SET_PARAMETER_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    payload[2] = message->parameter;
    payload[3] = message->kind;
    sp_put_u32(payload + 4, message->value);
    return (int)SP_SET_PARAMETER_SIZE;
}

bool sp_set_parameter_decode(sp_set_parameter_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_SET_PARAMETER_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->parameter = payload[2];
    message->kind = payload[3];
    message->value = sp_get_u32(payload + 4);
    return true;
}
#endif

#if SP_WITH_SAVE_PARAMETERS
int sp_save_parameters_encode(const sp_save_parameters_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_SAVE_PARAMETERS_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    return (int)SP_SAVE_PARAMETERS_SIZE;
}

bool sp_save_parameters_decode(sp_save_parameters_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_SAVE_PARAMETERS_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    return true;
}
#endif

#if SP_WITH_SET_KEY
int sp_set_key_encode(const sp_set_key_t *message, uint8_t *payload, size_t capacity)
{
    if (capacity < SP_SET_KEY_SIZE) {
        return -1;
    }
    sp_put_u16(payload, message->command_id);
    sp_put_u32(payload + 2, message->key_0);
    sp_put_u32(payload + 6, message->key_1);
    sp_put_u32(payload + 10, message->key_2);
    sp_put_u32(payload + 14, message->key_3);
    return (int)SP_SET_KEY_SIZE;
}

bool sp_set_key_decode(sp_set_key_t *message, const uint8_t *payload, size_t length)
{
    if (length != SP_SET_KEY_SIZE) {
        return false;
    }
    message->command_id = sp_get_u16(payload);
    message->key_0 = sp_get_u32(payload + 2);
    message->key_1 = sp_get_u32(payload + 6);
    message->key_2 = sp_get_u32(payload + 10);
    message->key_3 = sp_get_u32(payload + 14);
    return true;
}
#endif

#if SP_WITH_PARAMETER_VALUE
int sp_parameter_value_encode(const sp_parameter_value_t *message, uint8_t *payload, size_t capacity)
{
    const size_t length = SP_PARAMETER_VALUE_SIZE + (size_t)message->name_length;
    if (capacity < length || SP_PAYLOAD_MAX < length) {
        return -1;
    }
    payload[0] = message->parameter;
    payload[1] = message->parameter_count;
    payload[2] = message->kind;
    payload[3] = message->flags;
    sp_put_u32(payload + 4, message->value);
    sp_put_u32(payload + 8, message->default_);
    sp_put_u32(payload + 12, message->low);
    sp_put_u32(payload + 16, message->high);
    sp_copy(payload + 20, (const uint8_t *)message->name, message->name_length);
    return (int)length;
}

bool sp_parameter_value_decode(sp_parameter_value_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_PARAMETER_VALUE_SIZE || SP_PAYLOAD_MAX < length) {
        return false;
    }
    message->parameter = payload[0];
    message->parameter_count = payload[1];
    message->kind = payload[2];
    message->flags = payload[3];
    message->value = sp_get_u32(payload + 4);
    message->default_ = sp_get_u32(payload + 8);
    message->low = sp_get_u32(payload + 12);
    message->high = sp_get_u32(payload + 16);
    message->name = (const char *)(payload + 20);
    message->name_length = (uint8_t)(length - SP_PARAMETER_VALUE_SIZE);
    return true;
}
#endif

#if SP_WITH_LOG_TEXT
int sp_log_text_encode(const sp_log_text_t *message, uint8_t *payload, size_t capacity)
{
    const size_t length = SP_LOG_TEXT_SIZE + (size_t)message->line_length;
    if (capacity < length || SP_PAYLOAD_MAX < length) {
        return -1;
    }
    payload[0] = message->level;
    sp_copy(payload + 1, (const uint8_t *)message->line, message->line_length);
    return (int)length;
}

bool sp_log_text_decode(sp_log_text_t *message, const uint8_t *payload, size_t length)
{
    if (length < SP_LOG_TEXT_SIZE || SP_PAYLOAD_MAX < length) {
        return false;
    }
    message->level = payload[0];
    message->line = (const char *)(payload + 1);
    message->line_length = (uint8_t)(length - SP_LOG_TEXT_SIZE);
    return true;
}
#endif

/* ---- comparison --------------------------------------------------------------------------- */

#define SP_DEVICE_BIT 0x80u

/* Type, number of fields, size of the fixed part; by rising type. */
static const uint8_t sp_messages[][3] = {
    {SP_TYPE_STOP_ALL, 0u, SP_STOP_ALL_SIZE},
    {SP_TYPE_STOP, 2u, SP_STOP_SIZE},
#if SP_WITH_VELOCITY_SETPOINT
    {SP_TYPE_VELOCITY_SETPOINT, 4u, SP_VELOCITY_SETPOINT_SIZE},
#endif
    {SP_TYPE_HOST_HELLO, 5u, SP_HOST_HELLO_SIZE},
#if SP_WITH_CLEAR_STOP
    {SP_TYPE_CLEAR_STOP, 2u, SP_CLEAR_STOP_SIZE},
#endif
#if SP_WITH_SET_MODE
    {SP_TYPE_SET_MODE, 2u, SP_SET_MODE_SIZE},
#endif
#if SP_WITH_TIME_REQUEST
    {SP_TYPE_TIME_REQUEST, 1u, SP_TIME_REQUEST_SIZE},
#endif
    {SP_TYPE_DESCRIBE, 2u, SP_DESCRIBE_SIZE},
#if SP_WITH_PLANNER_COMMAND
    {SP_TYPE_PLANNER_COMMAND, 3u, SP_PLANNER_COMMAND_SIZE},
#endif
#if SP_WITH_WHEEL_DUTY
    {SP_TYPE_WHEEL_DUTY, 4u, SP_WHEEL_DUTY_SIZE},
#endif
    {SP_TYPE_DESCRIBE_ENUM, 2u, SP_DESCRIBE_ENUM_SIZE},
#if SP_WITH_SET_STREAM_RATE
    {SP_TYPE_SET_STREAM_RATE, 3u, SP_SET_STREAM_RATE_SIZE},
#endif
#if SP_WITH_REBOOT
    {SP_TYPE_REBOOT, 2u, SP_REBOOT_SIZE},
#endif
#if SP_WITH_SYNC
    {SP_TYPE_SYNC | SP_DEVICE_BIT, 1u, SP_SYNC_SIZE},
#endif
#if SP_WITH_STATUS
    {SP_TYPE_STATUS | SP_DEVICE_BIT, 5u, SP_STATUS_SIZE},
#endif
#if SP_WITH_IMU
    {SP_TYPE_IMU | SP_DEVICE_BIT, 7u, SP_IMU_SIZE},
#endif
#if SP_WITH_ENCODERS
    {SP_TYPE_ENCODERS | SP_DEVICE_BIT, 2u, SP_ENCODERS_SIZE},
#endif
#if SP_WITH_TIME_REPLY
    {SP_TYPE_TIME_REPLY | SP_DEVICE_BIT, 2u, SP_TIME_REPLY_SIZE},
#endif
    {SP_TYPE_ACK | SP_DEVICE_BIT, 2u, SP_ACK_SIZE},
    {SP_TYPE_NACK | SP_DEVICE_BIT, 3u, SP_NACK_SIZE},
    {SP_TYPE_HELLO | SP_DEVICE_BIT, 10u, SP_HELLO_SIZE},
    {SP_TYPE_DESCRIBE_REPLY | SP_DEVICE_BIT, 4u, SP_DESCRIBE_REPLY_SIZE},
#if SP_WITH_IMU_INFO
    {SP_TYPE_IMU_INFO | SP_DEVICE_BIT, 4u, SP_IMU_INFO_SIZE},
#endif
    {SP_TYPE_DESCRIBE_ENUM_REPLY | SP_DEVICE_BIT, 3u, SP_DESCRIBE_ENUM_REPLY_SIZE},
#if SP_WITH_CHALLENGE
    {SP_TYPE_CHALLENGE | SP_DEVICE_BIT, 1u, SP_CHALLENGE_SIZE},
#endif
#if SP_WITH_RANGE
    {SP_TYPE_RANGE | SP_DEVICE_BIT, 4u, SP_RANGE_SIZE},
#endif
#if SP_WITH_POWER
    {SP_TYPE_POWER | SP_DEVICE_BIT, 4u, SP_POWER_SIZE},
#endif
#if SP_WITH_LINK_COUNTERS
    {SP_TYPE_LINK_COUNTERS | SP_DEVICE_BIT, 8u, SP_LINK_COUNTERS_SIZE},
#endif
#if SP_WITH_PLANNER_STATE
    {SP_TYPE_PLANNER_STATE | SP_DEVICE_BIT, 8u, SP_PLANNER_STATE_SIZE},
#endif
#if SP_WITH_GET_PARAMETER
    {SP_TYPE_GET_PARAMETER, 2u, SP_GET_PARAMETER_SIZE},
#endif
#if SP_WITH_SET_PARAMETER
    {SP_TYPE_SET_PARAMETER, 4u, SP_SET_PARAMETER_SIZE},
#endif
#if SP_WITH_SAVE_PARAMETERS
    {SP_TYPE_SAVE_PARAMETERS, 1u, SP_SAVE_PARAMETERS_SIZE},
#endif
#if SP_WITH_SET_KEY
    {SP_TYPE_SET_KEY, 5u, SP_SET_KEY_SIZE},
#endif
#if SP_WITH_PARAMETER_VALUE
    {SP_TYPE_PARAMETER_VALUE | SP_DEVICE_BIT, 9u, SP_PARAMETER_VALUE_SIZE},
#endif
#if SP_WITH_LOG_TEXT
    {SP_TYPE_LOG_TEXT | SP_DEVICE_BIT, 2u, SP_LOG_TEXT_SIZE},
#endif
};

/* Of each message in turn: the size of each field; 0: a text. */
static const uint8_t sp_sizes[] = {
    /* stop_all */
    2u, 1u, /* stop */
#if SP_WITH_VELOCITY_SETPOINT
    2u, 2u, 1u, 1u, /* velocity_setpoint */
#endif
    4u, 4u, 4u, 1u, 0u, /* host_hello */
#if SP_WITH_CLEAR_STOP
    2u, 1u, /* clear_stop */
#endif
#if SP_WITH_SET_MODE
    2u, 1u, /* set_mode */
#endif
#if SP_WITH_TIME_REQUEST
    1u, /* time_request */
#endif
    1u, 1u, /* describe */
#if SP_WITH_PLANNER_COMMAND
    2u, 1u, 1u, /* planner_command */
#endif
#if SP_WITH_WHEEL_DUTY
    2u, 2u, 1u, 1u, /* wheel_duty */
#endif
    4u, 1u, /* describe_enum */
#if SP_WITH_SET_STREAM_RATE
    2u, 1u, 2u, /* set_stream_rate */
#endif
#if SP_WITH_REBOOT
    2u, 1u, /* reboot */
#endif
#if SP_WITH_SYNC
    4u, /* sync */
#endif
#if SP_WITH_STATUS
    1u, 1u, 2u, 1u, 1u, /* status */
#endif
#if SP_WITH_IMU
    2u, 2u, 2u, 2u, 2u, 2u, 2u, /* imu */
#endif
#if SP_WITH_ENCODERS
    2u, 2u, /* encoders */
#endif
#if SP_WITH_TIME_REPLY
    1u, 4u, /* time_reply */
#endif
    2u, 1u, /* ack */
    2u, 1u, 1u, /* nack */
    4u, 12u, 4u, 4u, 1u, 2u, 1u, 1u, 1u, 0u, /* hello */
    1u, 1u, 1u, 4u, /* describe_reply */
#if SP_WITH_IMU_INFO
    4u, 4u, 4u, 2u, /* imu_info */
#endif
    4u, 1u, 4u, /* describe_enum_reply */
#if SP_WITH_CHALLENGE
    4u, /* challenge */
#endif
#if SP_WITH_RANGE
    2u, 1u, 1u, 1u, /* range */
#endif
#if SP_WITH_POWER
    2u, 1u, 1u, 1u, /* power */
#endif
#if SP_WITH_LINK_COUNTERS
    2u, 2u, 2u, 2u, 2u, 1u, 1u, 2u, /* link_counters */
#endif
#if SP_WITH_PLANNER_STATE
    1u, 1u, 2u, 2u, 2u, 2u, 1u, 1u, /* planner_state */
#endif
#if SP_WITH_GET_PARAMETER
    2u, 1u, /* get_parameter */
#endif
#if SP_WITH_SET_PARAMETER
    2u, 1u, 1u, 4u, /* set_parameter */
#endif
#if SP_WITH_SAVE_PARAMETERS
    2u, /* save_parameters */
#endif
#if SP_WITH_SET_KEY
    2u, 4u, 4u, 4u, 4u, /* set_key */
#endif
#if SP_WITH_PARAMETER_VALUE
    1u, 1u, 1u, 1u, 4u, 4u, 4u, 4u, 0u, /* parameter_value */
#endif
#if SP_WITH_LOG_TEXT
    1u, 0u, /* log_text */
#endif
};

/* Of each message in turn: the hash before its first field and after each. */
static const uint32_t sp_chains[] = {
    /* stop_all */
    0x87EBFD9Fu,
    /* stop */
    0x7422A3E4u, 0xF08938C6u, 0xFEE9C447u,
#if SP_WITH_VELOCITY_SETPOINT
    /* velocity_setpoint */
    0x22DE17E3u, 0x0C48A406u, 0x45E8C1EDu, 0x4FF96DD3u, 0x8D4E7AF7u,
#endif
    /* host_hello */
    0xCEAD6422u, 0x44696583u, 0xC803D3A1u, 0xBA61EB48u, 0x0B4DF5EDu, 0x40F6E3FBu,
#if SP_WITH_CLEAR_STOP
    /* clear_stop */
    0xDA543D58u, 0x0A9E9690u, 0x04F9A367u,
#endif
#if SP_WITH_SET_MODE
    /* set_mode */
    0xA3D55C42u, 0x2CC4B1CFu, 0x30BB165Cu,
#endif
#if SP_WITH_TIME_REQUEST
    /* time_request */
    0x31FEA73Fu, 0xFEC67E3Du,
#endif
    /* describe */
    0x721DB8E2u, 0x2807825Cu, 0xF58883E1u,
#if SP_WITH_PLANNER_COMMAND
    /* planner_command */
    0xB46CEB6Bu, 0x0BC2F604u, 0x7FF0E6D8u, 0x594DD963u,
#endif
#if SP_WITH_WHEEL_DUTY
    /* wheel_duty */
    0xAA3561BDu, 0x0B456704u, 0x7635125Cu, 0x75C0333Eu, 0x0F8C968Au,
#endif
    /* describe_enum */
    0xAC312045u, 0x6654B46Au, 0x99DB6C77u,
#if SP_WITH_SET_STREAM_RATE
    /* set_stream_rate */
    0xF089DBFDu, 0x784B381Au, 0x7FBE92ADu, 0xA641D32Eu,
#endif
#if SP_WITH_REBOOT
    /* reboot */
    0xA5B0CFEBu, 0xA88EDEB0u, 0x06F4A882u,
#endif
#if SP_WITH_SYNC
    /* sync */
    0x5BC8F17Du, 0x8658E196u,
#endif
#if SP_WITH_STATUS
    /* status */
    0xC299F437u, 0xF6D50AE1u, 0xF422ADE4u, 0x1108BAF7u, 0xB78EF3CBu, 0x9ED0F2B1u,
#endif
#if SP_WITH_IMU
    /* imu */
    0xF5CC8026u, 0x7C062FC5u, 0x08754738u, 0x47F66BAEu, 0xD0BCA31Au, 0x213183CAu,
    0x8F790DEAu, 0x22CC1538u,
#endif
#if SP_WITH_ENCODERS
    /* encoders */
    0xA2E7BF2Au, 0x246098BDu, 0x5B99BC29u,
#endif
#if SP_WITH_TIME_REPLY
    /* time_reply */
    0xE87DBFC8u, 0x9ADC92FDu, 0x66BE6CE8u,
#endif
    /* ack */
    0x9E9246E4u, 0x5602A638u, 0xD48D6D0Cu,
    /* nack */
    0x89075394u, 0x27A85322u, 0x37ED98E1u, 0xFB7FAD9Au,
    /* hello */
    0x268D11FDu, 0x437F3201u, 0x06A30613u, 0x6690AF38u, 0x1594981Cu, 0x07FED372u,
    0xCD03F2B2u, 0x89A3705Cu, 0xE3A8B046u, 0x9489B876u, 0xAC2266F1u,
    /* describe_reply */
    0x3E18ACB5u, 0x28402A43u, 0xD4B9CF68u, 0x71195A82u, 0x87B94A42u,
#if SP_WITH_IMU_INFO
    /* imu_info */
    0xE1FEFDAEu, 0x316208B8u, 0xCBCE769Du, 0xA0FB1B4Eu, 0x4BFBB710u,
#endif
    /* describe_enum_reply */
    0x041C7E0Eu, 0xA5861ADFu, 0xC5B9A703u, 0xD00C69E8u,
#if SP_WITH_CHALLENGE
    /* challenge */
    0x9520DD4Bu, 0xC6D9C38Fu,
#endif
#if SP_WITH_RANGE
    /* range */
    0x11450895u, 0xC4132051u, 0x094F9DD7u, 0x1A9B6743u, 0xF8B39255u,
#endif
#if SP_WITH_POWER
    /* power */
    0x56B47A56u, 0xC75514D0u, 0x9D00A83Fu, 0x5830D93Cu, 0xEC266ED2u,
#endif
#if SP_WITH_LINK_COUNTERS
    /* link_counters */
    0x0A6A7C4Cu, 0xD2FA0190u, 0x825CEA43u, 0x03FC1640u, 0xAE48D122u, 0xA3C12723u,
    0x808326A4u, 0xCF1A0050u, 0x97CB6C44u,
#endif
#if SP_WITH_PLANNER_STATE
    /* planner_state */
    0x6970F7DFu, 0x0092111Au, 0x23123B1Bu, 0x90DE3F07u, 0x4C64A13Fu, 0x4302A0E8u,
    0x92856134u, 0xB0BE9B55u, 0xB19B3A53u,
#endif
#if SP_WITH_GET_PARAMETER
    /* get_parameter */
    0xA4D243E9u, 0x2004D694u, 0xD290F0B8u,
#endif
#if SP_WITH_SET_PARAMETER
    /* set_parameter */
    0x9BE783F9u, 0x7C308744u, 0xD78AEB65u, 0x2809192Bu, 0xE8AEC345u,
#endif
#if SP_WITH_SAVE_PARAMETERS
    /* save_parameters */
    0xFB2BB9D7u, 0x2F3DD5C0u,
#endif
#if SP_WITH_SET_KEY
    /* set_key */
    0x866B1B03u, 0x7CDEF62Fu, 0x14538AB5u, 0x8A7A38FDu, 0xE9B32FFDu, 0xFA30C6EFu,
#endif
#if SP_WITH_PARAMETER_VALUE
    /* parameter_value */
    0x30F1B52Bu, 0xA7F09445u, 0xC5171491u, 0xB2A9E6AAu, 0x5D600E1Fu, 0x12DEA9FFu,
    0x2A66AB9Eu, 0x17950DADu, 0x1197214Du, 0x90C77657u,
#endif
#if SP_WITH_LOG_TEXT
    /* log_text */
    0x1E4AA095u, 0x19489A9Bu, 0x0229F783u,
#endif
};

/* Of each enumeration in turn: how many members it has, and the hash before the first and after
 * each. The first hash, of its name and kind, is what it is asked about by. */
static const uint8_t sp_enum_members[] = {
    8u, /* Capability */
#if SP_WITH_RANGE
    3u, /* Contact */
#endif
#if SP_WITH_STATUS
    16u, /* Fault */
#endif
#if SP_WITH_LOG_TEXT
    4u, /* LogLevel */
#endif
#if SP_WITH_SET_MODE || SP_WITH_STATUS
    4u, /* Mode */
#endif
    12u, /* NackReason */
#if SP_WITH_PLANNER_COMMAND
    4u, /* OnboardPlanner */
#endif
#if SP_WITH_PARAMETER_VALUE
    4u, /* ParameterFlag */
#endif
#if SP_WITH_SET_PARAMETER || SP_WITH_PARAMETER_VALUE
    2u, /* ParameterKind */
#endif
#if SP_WITH_PLANNER_COMMAND
    4u, /* PlannerAction */
#endif
#if SP_WITH_PLANNER_STATE
    10u, /* PlannerPhase */
#endif
#if SP_WITH_REBOOT
    2u, /* RebootKind */
#endif
    6u, /* ResetCause */
    6u, /* StopCause */
    0u, /* the end */
};
static const uint32_t sp_enum_chains[] = {
    /* Capability */
    0xC2C0F6C8u, 0xB8101067u, 0x6C298798u, 0xB9B12F62u, 0x3B307D73u, 0x8D1B1DDAu,
    0x5AFB9D12u, 0xED59AD0Cu, 0x53300429u,
#if SP_WITH_RANGE
    /* Contact */
    0xCBAD447Cu, 0x03D5556Au, 0x8C8D7E43u, 0xEAA572C7u,
#endif
#if SP_WITH_STATUS
    /* Fault */
    0x200B98E1u, 0x7A63E11Bu, 0x3F26E683u, 0x1D71A148u, 0x901EDED7u, 0x55C3A7E4u,
    0x12527078u, 0x5FD09E29u, 0xE31FECC3u, 0x727AC842u, 0x701ED1BBu, 0xE4D85944u,
    0x24F2C6A9u, 0x59D57D62u, 0xD6A4AC42u, 0xD0EFD08Eu, 0xCE47D92Bu,
#endif
#if SP_WITH_LOG_TEXT
    /* LogLevel */
    0xE7F10002u, 0x2FCD631Eu, 0x9EE54CD0u, 0x149508B3u, 0x91304789u,
#endif
#if SP_WITH_SET_MODE || SP_WITH_STATUS
    /* Mode */
    0x124C84E8u, 0x81403BB5u, 0x8375321Eu, 0xF6E4D6B9u, 0x61CEBFA6u,
#endif
    /* NackReason */
    0x40F912E0u, 0xC7E900E4u, 0x08FAC786u, 0x2C4AAD99u, 0xE19681A7u, 0xFFC6B808u,
    0x1EEA7DCDu, 0x0580430Cu, 0x9E2DDB46u, 0xA7E2D9B8u, 0x37820A85u, 0x5B735D93u,
    0xE538D63Au,
#if SP_WITH_PLANNER_COMMAND
    /* OnboardPlanner */
    0xDB35CAD1u, 0x641D537Cu, 0x7188D3AAu, 0x8A226E45u, 0x30BFFB49u,
#endif
#if SP_WITH_PARAMETER_VALUE
    /* ParameterFlag */
    0x6466976Du, 0x20EE0B9Cu, 0x287DF776u, 0x02238ECCu, 0x8B4A1862u,
#endif
#if SP_WITH_SET_PARAMETER || SP_WITH_PARAMETER_VALUE
    /* ParameterKind */
    0xC9B3E0E2u, 0xA74F576Eu, 0x55570A4Bu,
#endif
#if SP_WITH_PLANNER_COMMAND
    /* PlannerAction */
    0xC4CC4287u, 0x18C834D0u, 0xF0F7275Cu, 0xB9EABCE4u, 0x89EDBD48u,
#endif
#if SP_WITH_PLANNER_STATE
    /* PlannerPhase */
    0x2FF72BEBu, 0x3DB49B6Au, 0x8D7208E1u, 0x72FCBD80u, 0xB00FC741u, 0x2021530Eu,
    0x43D59F52u, 0xF97AD4A1u, 0x8BF779C0u, 0xF56A6AB8u, 0x49C0712Cu,
#endif
#if SP_WITH_REBOOT
    /* RebootKind */
    0x3A8339F2u, 0x4CE1E98Fu, 0xB4D3E92Eu,
#endif
    /* ResetCause */
    0xD4F89891u, 0x8988F16Eu, 0x7EA3081Du, 0x7D15047Cu, 0xF3E3D567u, 0xB7CD047Eu,
    0xEFAA038Bu,
    /* StopCause */
    0x12A0BF9Eu, 0x58C19E39u, 0xFC9A9893u, 0x6DA1BBDEu, 0xA1E9782Du, 0xEEED3FB5u,
    0xD49C6DF9u,
    0u, /* the end */
};

#define SP_ENUMS (sizeof sp_enum_members / sizeof sp_enum_members[0] - 1u)
#define SP_MESSAGES (sizeof sp_messages / sizeof sp_messages[0])

/* Place of a type among them; SP_MESSAGES: unknown. */
static size_t sp_index(uint8_t type)
{
    size_t i = 0;
    while (i < SP_MESSAGES && (sp_messages[i][0] & ~SP_DEVICE_BIT) != type) {
        i++;
    }
    return i;
}

sp_direction_t sp_direction(uint8_t type)
{
    const size_t i = sp_index(type);
    if (i == SP_MESSAGES) {
        return SP_UNKNOWN;
    }
    return sp_messages[i][0] & SP_DEVICE_BIT ? SP_FROM_DEVICE : SP_FROM_HOST;
}

static uint8_t sp_hex(uint32_t digit)
{
    return (uint8_t)(digit < 10u ? '0' + digit : 'a' - 10u + digit);
}

/* A hash in hexadecimal and a newline; gives where they end. */
static uint8_t *sp_put_hash(uint8_t *line, uint32_t value)
{
    for (uint32_t k = 0; k < 8u; k++) {
        *line++ = sp_hex(value >> (28u - 4u * k) & 15u);
    }
    *line++ = '\n';
    return line;
}

uint32_t sp_catalogue_hash(void)
{
    const uint32_t *chain = sp_chains;
    uint32_t hash = 0;
    uint8_t line[18];
    for (size_t i = 0; i < SP_MESSAGES; i++) {
        /* "tt:cccccccc", newline: the type and its last chain value in hexadecimal */
        chain += sp_messages[i][1];
        line[0] = sp_hex(sp_messages[i][0] >> 4 & 7u);
        line[1] = sp_hex(sp_messages[i][0] & 15u);
        line[2] = ':';
        const uint8_t *const end = sp_put_hash(line + 3, *chain);
        hash = sp_crc32_update(hash, line, (size_t)(end - line));
        chain++;
    }
    chain = sp_enum_chains;
    for (size_t i = 0; i < SP_ENUMS; i++) {
        /* "kkkkkkkk:cccccccc", newline: its first and its last chain value */
        (void)sp_put_hash(line, chain[0]);
        line[8] = ':';
        chain += sp_enum_members[i];
        const uint8_t *const end = sp_put_hash(line + 9, *chain);
        hash = sp_crc32_update(hash, line, (size_t)(end - line));
        chain++;
    }
    return hash;
}

void sp_describe(const sp_describe_t *question, sp_describe_reply_t *answer)
{
    const uint32_t *chain = sp_chains;
    const size_t index = sp_index(question->described_type);
    answer->described_type = question->described_type;
    if (index == SP_MESSAGES) {
        answer->field_count = SP_UNKNOWN_COUNT;
        answer->payload_length = 0;
        answer->chain = 0;
        return;
    }
    for (size_t i = 0; i < index; i++) {
        chain += sp_messages[i][1] + 1u;
    }
    const uint8_t fields = sp_messages[index][1];
    answer->field_count = fields;
    answer->payload_length = sp_messages[index][2];
    answer->chain = chain[question->field_count < fields ? question->field_count : fields];
}

void sp_describe_enum(const sp_describe_enum_t *question, sp_describe_enum_reply_t *answer)
{
    const uint32_t *chain = sp_enum_chains;
    answer->enumeration = question->enumeration;
    answer->member_count = SP_UNKNOWN_COUNT;
    answer->chain = 0;
    for (size_t i = 0; i < SP_ENUMS; i++) {
        const uint8_t members = sp_enum_members[i];
        if (*chain == question->enumeration) {
            answer->member_count = members;
            answer->chain = chain[question->member_count < members ? question->member_count : members];
        }
        chain += members + 1u;
    }
}

bool sp_is_bootstrap(uint8_t type)
{
    switch (type) {
    case SP_TYPE_STOP_ALL:
    case SP_TYPE_STOP:
    case SP_TYPE_HOST_HELLO:
    case SP_TYPE_DESCRIBE:
    case SP_TYPE_DESCRIBE_ENUM:
    case SP_TYPE_ACK:
    case SP_TYPE_NACK:
    case SP_TYPE_HELLO:
    case SP_TYPE_DESCRIBE_REPLY:
    case SP_TYPE_DESCRIBE_ENUM_REPLY:
        return true;
    default:
        return false;
    }
}

uint8_t sp_field_count(uint8_t type)
{
    const size_t index = sp_index(type);
    return index == SP_MESSAGES ? 0u : sp_messages[index][1];
}

uint8_t sp_prefix_size(uint8_t type, uint8_t fields)
{
    const uint8_t *size = sp_sizes;
    const size_t index = sp_index(type);
    uint32_t sum = 0;
    if (index == SP_MESSAGES) {
        return 0;
    }
    for (size_t i = 0; i < index; i++) {
        size += sp_messages[i][1];
    }
    for (uint8_t i = 0; i < sp_messages[index][1] && i < fields; i++) {
        sum += size[i];
    }
    return (uint8_t)sum;
}

#if SP_WITH_CAN
/* ---- classic CAN -------------------------------------------------------------------------- */

#define SP_CAN_START 0x80u
#define SP_CAN_END 0x40u
#define SP_CAN_TOGGLE 0x20u
#define SP_CAN_TRANSFER 0x1Fu
#define SP_CAN_WHOLE_STAMP 8u
#define SP_CAN_SEGMENT 7u

/* Stretches of a periodic message's payload, by message and then by frame. */
typedef struct {
    uint8_t can_type; /* in the identifier */
    uint8_t type;     /* of the message */
    uint8_t first;
    uint8_t size;
    uint8_t slow; /* place among the slow parts, from 1; 0: sent with every message */
    uint8_t full; /* the stamp has 32 bits and stands first */
} sp_can_span_t;

static const sp_can_span_t sp_can_spans[] = {
#if SP_WITH_VELOCITY_SETPOINT
    {0x02u, 0x02u, 0u, 6u, 0u, 0u}, /* velocity_setpoint */
#endif
#if SP_WITH_WHEEL_DUTY
    {0x0Au, 0x0Au, 0u, 6u, 0u, 0u}, /* wheel_duty */
#endif
#if SP_WITH_SYNC
    {0x10u, 0x10u, 0u, 4u, 0u, 1u}, /* sync */
#endif
#if SP_WITH_STATUS
    {0x11u, 0x11u, 0u, 6u, 0u, 0u}, /* status */
#endif
#if SP_WITH_IMU
    {0x15u, 0x13u, 6u, 2u, 1u, 0u}, /* imu */
    {0x13u, 0x13u, 0u, 6u, 0u, 0u}, /* imu */
    {0x14u, 0x13u, 8u, 6u, 0u, 0u}, /* imu */
#endif
#if SP_WITH_ENCODERS
    {0x16u, 0x16u, 0u, 4u, 0u, 0u}, /* encoders */
#endif
#if SP_WITH_RANGE
    {0x20u, 0x20u, 0u, 5u, 0u, 0u}, /* range */
#endif
#if SP_WITH_POWER
    {0x24u, 0x24u, 0u, 5u, 0u, 0u}, /* power */
#endif
#if SP_WITH_LINK_COUNTERS
    {0x28u, 0x28u, 0u, 6u, 0u, 0u}, /* link_counters */
    {0x29u, 0x28u, 6u, 4u, 0u, 0u}, /* link_counters */
    {0x2Au, 0x28u, 10u, 4u, 0u, 0u}, /* link_counters */
#endif
#if SP_WITH_PLANNER_STATE
    {0x2Cu, 0x2Cu, 0u, 6u, 0u, 0u}, /* planner_state */
    {0x2Du, 0x2Cu, 6u, 6u, 0u, 0u}, /* planner_state */
#endif
    {0xFFu, 0xFFu, 0u, 0u, 0u, 0u}, /* the end */
};

static const uint32_t sp_can_slow_us[] = {1000000u};

/* The first stretch of a message; the end where it is none of these. */
static const sp_can_span_t *sp_can_span(uint8_t type)
{
    const sp_can_span_t *span = sp_can_spans;
    while (span->type != type && span->type != 0xFFu) {
        span++;
    }
    return span;
}

/* The first stretch in a frame; the end where it is none of these. */
static const sp_can_span_t *sp_can_part(uint8_t can_type)
{
    const sp_can_span_t *span = sp_can_spans;
    while (span->can_type != can_type && span->can_type != 0xFFu) {
        span++;
    }
    return span;
}

sp_direction_t sp_can_direction(uint8_t can_type)
{
    const sp_can_span_t *const span = sp_can_part(can_type);
    return sp_direction(span->type == 0xFFu ? can_type : span->type);
}

bool sp_can_begin(sp_can_sender_t *sender, sp_can_message_t *message, uint8_t type, uint32_t t_us,
    const uint8_t *payload, size_t length)
{
    const size_t index = sp_index(type);
    const sp_can_span_t *const span = sp_can_span(type);
    if (index == SP_MESSAGES || length > SP_PAYLOAD_MAX) {
        return false;
    }
    message->payload = payload;
    message->length = (uint8_t)length;
    message->type = type;
    message->t_us = t_us;
    message->native = span->type == type;
    if (message->native) {
        message->position = (uint16_t)(span - sp_can_spans);
        return length == sp_messages[index][2];
    }
    message->head[0] = (uint8_t)(SP_VERSION << 4 | (sender->flags & 7u));
    if (3u + length <= SP_CAN_SEGMENT && SP_CAN_SEGMENT < 5u + length) {
        sp_put_u16(message->head + 1, (uint16_t)(t_us >> 4));
        message->head_length = 3;
    } else {
        message->head[0] |= SP_CAN_WHOLE_STAMP;
        sp_put_u32(message->head + 1, t_us);
        message->head_length = 5;
    }
    message->position = 0;
    message->total = (uint16_t)(message->head_length + length);
    if (message->total > SP_CAN_SEGMENT) {
        uint32_t crc = sp_crc32_update(0, message->head, message->head_length);
        crc = sp_crc32_update(crc, payload, length);
        sp_put_u32(message->crc, crc);
        message->total = (uint16_t)(message->total + 4u);
    }
    message->tail = sender->transfer[index];
    message->toggle = SP_CAN_TOGGLE;
    sender->transfer[index] = (message->tail + 1u) & SP_CAN_TRANSFER;
    return true;
}

static bool sp_can_next_part(
    sp_can_sender_t *sender, sp_can_message_t *message, sp_can_frame_t *frame)
{
    const sp_can_span_t *span = sp_can_spans + message->position;
    while (span->type == message->type && span->slow != 0) {
        const uint32_t slow = span->slow - 1u;
        const uint8_t bit = (uint8_t)(1u << slow);
        if ((sender->slow_sent & bit) == 0
            || message->t_us - sender->slow_us[slow] >= sp_can_slow_us[slow]) {
            sender->slow_sent |= bit;
            sender->slow_us[slow] = message->t_us;
            break;
        }
        const uint8_t passed = span->can_type;
        while (span->can_type == passed) {
            span++;
        }
    }
    if (span->type != message->type) {
        message->position = (uint16_t)(span - sp_can_spans);
        return false;
    }
    const uint8_t can_type = span->can_type;
    const bool full = span->full != 0;
    uint8_t length = 0;
    sender->frames++;
    if (full) {
        sp_put_u32(frame->data, message->t_us);
        length = 4;
    } else {
        sp_put_u16(frame->data, (uint16_t)(message->t_us >> 4));
        length = 2;
    }
    while (span->can_type == can_type) {
        sp_copy(frame->data + length, message->payload + span->first, span->size);
        length = (uint8_t)(length + span->size);
        span++;
    }
#ifdef SP_TYPE_SYNC
    if (can_type == SP_TYPE_SYNC) {
        sp_put_u32(frame->data + 4, sender->frames);
    }
#endif
    message->position = (uint16_t)(span - sp_can_spans);
    frame->id = (uint16_t)(can_type << 4 | sender->node);
    frame->length = length;
    return true;
}

static uint8_t sp_can_content(const sp_can_message_t *message, size_t i)
{
    if (i < message->head_length) {
        return message->head[i];
    }
    i -= message->head_length;
    return i < message->length ? message->payload[i] : message->crc[i - message->length];
}

bool sp_can_next(sp_can_sender_t *sender, sp_can_message_t *message, sp_can_frame_t *frame)
{
    if (message->native) {
        return sp_can_next_part(sender, message, frame);
    }
    if (message->position == message->total) {
        return false;
    }
    uint8_t tail = (uint8_t)(message->tail | message->toggle);
    uint8_t length = 0;
    if (message->position == 0) {
        tail |= SP_CAN_START;
    }
    while (length < SP_CAN_SEGMENT && message->position < message->total) {
        frame->data[length] = sp_can_content(message, message->position);
        message->position++;
        length++;
    }
    if (message->position == message->total) {
        tail |= SP_CAN_END;
    }
    message->toggle ^= SP_CAN_TOGGLE;
    frame->data[length] = tail;
    frame->length = (uint8_t)(length + 1u);
    frame->id = (uint16_t)(message->type << 4 | sender->node);
    sender->frames++;
    return true;
}

/* A sum modulo 2^32, read as a signed number. */
static int32_t sp_signed(uint32_t value)
{
    return value < 0x80000000u ? (int32_t)value : -(int32_t)~value - 1;
}

static void sp_can_whole_stamp(sp_can_receiver_t *receiver, uint32_t t_us, uint32_t now_us)
{
    const uint32_t ahead = t_us - now_us;
    const uint32_t aged = receiver->ahead_us - (now_us - receiver->at_us) / 2000u;
    const int32_t change = sp_signed(ahead - receiver->ahead_us);
    const bool other = !receiver->stamped || change < -2000000 || change > 2000000;
    receiver->stamped = true;
    receiver->wire_us = t_us;
    receiver->at_us = now_us;
    receiver->ahead_us = other || sp_signed(ahead - aged) > 0 ? ahead : aged;
}

static bool sp_can_short_stamp(
    sp_can_receiver_t *receiver, uint16_t t16, uint32_t now_us, uint32_t *t_us)
{
    const uint32_t before = receiver->wire_us >> 4;
    const uint32_t ahead = (t16 - before) & 0xFFFFu;
    const uint32_t stamp =
        (before + (ahead < 0x8000u ? ahead : ahead - 0x10000u)) << 4;
    const int32_t age = sp_signed(now_us + receiver->ahead_us - stamp);
    if (!receiver->stamped || age < -50000 || age > 500000) {
        return false;
    }
    if (sp_signed(stamp - receiver->wire_us) > 0) {
        receiver->wire_us = stamp;
    }
    *t_us = stamp;
    return true;
}

/* Whether the frame is one that has just been taken; else it is kept for the next time. */
static bool sp_can_duplicate(
    sp_can_receiver_t *receiver, const sp_can_frame_t *in, uint32_t now_us)
{
    size_t place = SP_CAN_RECENT;
    for (size_t i = 0; i < SP_CAN_RECENT; i++) {
        const sp_can_frame_t *const known = &receiver->recent[i].frame;
        if (!receiver->recent[i].used || known->id != in->id) {
            continue;
        }
        bool same = known->length == in->length && now_us - receiver->recent[i].at_us < 500000u;
        for (size_t k = 0; same && k < in->length; k++) {
            same = known->data[k] == in->data[k];
        }
        if (same) {
            return true;
        }
        place = i;
    }
    if (place == SP_CAN_RECENT) {
        place = receiver->next_recent;
        receiver->next_recent = (uint8_t)((place + 1u) % SP_CAN_RECENT);
    }
    receiver->recent[place].used = true;
    receiver->recent[place].at_us = now_us;
    receiver->recent[place].frame = *in;
    return false;
}

static void sp_can_give_up(sp_can_receiver_t *receiver, sp_can_transfer_t *open)
{
    open->length = 0;
    receiver->given_up++;
}

/* A transfer's first segment, of several. */
static void sp_can_open(sp_can_receiver_t *receiver, const sp_can_frame_t *in, uint32_t now_us)
{
    const uint8_t length = (uint8_t)(in->length - 1u);
    sp_can_transfer_t *open = &receiver->open[0];
    for (size_t i = 1; i < SP_CAN_OPEN && open->length != 0; i++) {
        sp_can_transfer_t *const other = &receiver->open[i];
        if (other->length == 0 || sp_signed(other->order - open->order) < 0) {
            open = other;
        }
    }
    if (open->length != 0) {
        sp_can_give_up(receiver, open); /* the oldest makes room */
    }
    open->began_us = now_us;
    open->order = receiver->order++;
    open->id = in->id;
    open->transfer = in->data[length] & SP_CAN_TRANSFER;
    open->toggle = 0;
    open->length = length;
    sp_copy(open->data, in->data, length);
}

/* Take a segment: a complete content's first byte, or NULL. */
static const uint8_t *sp_can_segment(sp_can_receiver_t *receiver, const sp_can_frame_t *in,
    uint32_t now_us, size_t *content, sp_event_t *event)
{
    const uint8_t length = (uint8_t)(in->length - 1u);
    const uint8_t tail = in->data[length];
    sp_can_transfer_t *open = NULL;
    for (size_t i = 0; i < SP_CAN_OPEN; i++) {
        if (receiver->open[i].length != 0 && receiver->open[i].id == in->id) {
            open = &receiver->open[i];
        }
    }
    if (tail & SP_CAN_START) {
        if (open != NULL) {
            sp_can_give_up(receiver, open);
        }
        if (!(tail & SP_CAN_TOGGLE) || length == 0) {
            return NULL;
        }
        if (tail & SP_CAN_END) {
            sp_copy(receiver->single, in->data, length);
            *content = length;
            return receiver->single;
        }
        sp_can_open(receiver, in, now_us);
        return NULL;
    }
    if (open == NULL) {
        return NULL;
    }
    if ((tail & SP_CAN_TOGGLE) != open->toggle || (tail & SP_CAN_TRANSFER) != open->transfer
        || length == 0 || now_us - open->began_us > 1000000u
        || open->length + (uint32_t)length > sizeof open->data) {
        sp_can_give_up(receiver, open);
        return NULL;
    }
    sp_copy(open->data + open->length, in->data, length);
    open->length = (uint16_t)(open->length + length);
    open->toggle ^= SP_CAN_TOGGLE;
    if (!(tail & SP_CAN_END)) {
        return NULL;
    }
    const size_t whole = open->length < 4u ? 0u : open->length - 4u;
    open->length = 0;
    if (whole <= SP_CAN_SEGMENT
        || sp_crc32_update(0, open->data, whole) != sp_get_u32(open->data + whole)) {
        receiver->damaged++;
        *event = SP_BAD_CRC;
        return NULL;
    }
    *content = whole;
    return open->data;
}

#if SP_CAN_HOST_PARTS > 1
void sp_can_limit(sp_can_receiver_t *receiver, uint8_t type, size_t length)
{
    const size_t index = sp_index(type);
    if (index < SP_MESSAGES) {
        receiver->unshared[index] =
            length < sp_messages[index][2] ? (uint8_t)(sp_messages[index][2] - length) : 0u;
    }
}

/* Bytes of a stretch that the host sends, of a payload of which it knows `known`. */
static uint8_t sp_can_shared(const sp_can_span_t *span, uint8_t known)
{
    if (span->first >= known) {
        return 0;
    }
    const uint8_t left = (uint8_t)(known - span->first);
    return left < span->size ? left : span->size;
}

/* The payload from the parts, as far as they go; what is beyond the fields is put behind. */
static uint8_t sp_can_assemble(sp_can_joined_t *joined, uint8_t known)
{
    uint8_t taken[SP_CAN_HOST_PARTS] = {0};
    uint8_t length = known;
    uint8_t part = 0;
    const sp_can_span_t *span = sp_can_span(joined->type);
    const uint8_t type = span->type;
    for (; span->type == type; span++) {
        const uint8_t size = sp_can_shared(span, known);
        if (taken[part] + size > joined->part_length[part]) {
            length = span->first < length ? span->first : length;
        } else {
            sp_copy(joined->payload + span->first, joined->parts[part] + taken[part], size);
            taken[part] = (uint8_t)(taken[part] + size);
        }
        part = (uint8_t)(part + (span[1].can_type != span->can_type));
    }
    for (uint8_t i = 0; i < part; i++) {
        const uint8_t more = (uint8_t)(joined->part_length[i] - taken[i]);
        sp_copy(joined->payload + length, joined->parts[i] + taken[i], more);
        length = (uint8_t)(length + more);
    }
    return length;
}

/* A frame of a message in several of them: true where it completes it. The host sends them one
 * after the other, so one message at a time is put together. */
static bool sp_can_join(
    sp_can_receiver_t *receiver, const sp_can_frame_t *in, sp_frame_t *frame)
{
    sp_can_joined_t *const joined = &receiver->joined;
    const uint8_t can_type = (uint8_t)(in->id >> 4);
    const uint8_t known =
        (uint8_t)(sp_messages[sp_index(frame->type)][2] - receiver->unshared[sp_index(frame->type)]);
    uint8_t part = 0, mine = SP_CAN_HOST_PARTS, wanted = 0;
    for (const sp_can_span_t *span = sp_can_span(frame->type); span->type == frame->type; span++) {
        const uint8_t bit = (uint8_t)(1u << part);
        if (sp_can_shared(span, known) != 0) {
            wanted |= bit;
            mine = span->can_type == can_type ? part : mine;
        }
        part = (uint8_t)(part + (span[1].can_type != span->can_type));
    }
    if (mine == SP_CAN_HOST_PARTS) {
        return false; /* of fields that are not shared */
    }
    if (joined->came == 0 || joined->type != frame->type || joined->node != frame->node
        || joined->t_us != frame->t_us) {
        receiver->incomplete += joined->came != 0;
        joined->came = 0;
        joined->type = frame->type;
        joined->node = frame->node;
        joined->t_us = frame->t_us;
    }
    joined->came |= (uint8_t)(1u << mine);
    joined->part_length[mine] = (uint8_t)(in->length - 2u);
    sp_copy(joined->parts[mine], in->data + 2, joined->part_length[mine]);
    if (joined->came != wanted) {
        return false;
    }
    joined->came = 0;
    for (uint8_t i = 0; i < SP_CAN_HOST_PARTS; i++) {
        joined->part_length[i] = wanted >> i & 1u ? joined->part_length[i] : 0u;
    }
    frame->length = sp_can_assemble(joined, known);
    frame->payload = joined->payload;
    return true;
}
#endif

/* A frame of a periodic message; true where the message is complete. */
static bool sp_can_periodic(sp_can_receiver_t *receiver, const sp_can_frame_t *in,
    uint32_t now_us, sp_frame_t *frame)
{
    if (in->length < 2u) {
        return false;
    }
    if (!sp_can_short_stamp(receiver, sp_get_u16(in->data), now_us, &frame->t_us)) {
        receiver->stale++;
        return false;
    }
    frame->version = SP_VERSION;
    frame->flags = 0;
#if SP_CAN_HOST_PARTS > 1
    const sp_can_span_t *span = sp_can_span(frame->type);
    const uint8_t first = span->can_type;
    while (span->type == frame->type && span->can_type == first) {
        span++;
    }
    if (span->type == frame->type) {
        return sp_can_join(receiver, in, frame);
    }
#endif
    frame->length = (uint8_t)(in->length - 2u);
    sp_copy(receiver->single, in->data + 2, frame->length);
    frame->payload = receiver->single;
    return true;
}

static bool sp_can_parse(sp_can_receiver_t *receiver, const uint8_t *content, size_t length,
    uint32_t now_us, sp_frame_t *frame)
{
    const bool whole = content[0] & SP_CAN_WHOLE_STAMP;
    const size_t head = whole ? 5u : 3u;
    if (length < head || length - head > SP_PAYLOAD_MAX) {
        return false;
    }
    if (whole) {
        frame->t_us = sp_get_u32(content + 1);
        sp_can_whole_stamp(receiver, frame->t_us, now_us);
    } else if (!sp_can_short_stamp(receiver, sp_get_u16(content + 1), now_us, &frame->t_us)) {
        if (frame->type != SP_TYPE_STOP) {
            receiver->stale++;
            return false;
        }
        frame->t_us = now_us + receiver->ahead_us; /* accepted at any time */
    }
    frame->version = content[0] >> 4;
    frame->flags = content[0] & 0x0Fu & ~SP_CAN_WHOLE_STAMP;
    frame->payload = content + head;
    frame->length = (uint8_t)(length - head);
    return true;
}

sp_event_t sp_can_receive(
    sp_can_receiver_t *receiver, const sp_can_frame_t *in, uint32_t now_us, sp_frame_t *frame)
{
    const uint8_t can_type = (uint8_t)(in->id >> 4);
    const sp_can_span_t *const span = sp_can_part(can_type);
    const uint8_t type = span->type == 0xFFu ? can_type : span->type;
    sp_event_t event = SP_NOTHING;
    if (in->id > 0x7FFu || in->length > 8u) {
        return event;
    }
    if (type == SP_TYPE_STOP_ALL) {
        /* Its identifier is the whole message: accepted with any data, never a duplicate. */
        frame->version = SP_VERSION;
        frame->flags = 0;
        frame->type = type;
        frame->node = in->id & 0x0Fu;
        frame->seq = 0;
        frame->t_us = 0;
        frame->payload = receiver->single;
        frame->length = 0;
        receiver->frames++;
        return SP_FRAME;
    }
    if (sp_can_duplicate(receiver, in, now_us)) {
        receiver->duplicates++;
        return event;
    }
    if (in->length == 0 || sp_direction(type) != SP_FROM_HOST) {
        return event;
    }
    frame->type = type;
    frame->node = in->id & 0x0Fu;
    frame->seq = 0;
    bool complete = false;
    receiver->content = NULL;
    if (span->type == type) {
        complete = sp_can_periodic(receiver, in, now_us, frame);
    } else {
        size_t length = 0;
        const uint8_t *const content = sp_can_segment(receiver, in, now_us, &length, &event);
        complete = content != NULL && sp_can_parse(receiver, content, length, now_us, frame);
        receiver->content = content;
        receiver->content_length = length;
    }
    if (complete) {
        receiver->frames++;
        event = SP_FRAME;
    }
    return event;
}
#endif
