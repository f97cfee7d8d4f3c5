/* The sweeper's wire in C99.
 *
 * Made by `sweepctl generate c`; changes belong into the catalogue.
 * Protocol version @version@, catalogue 0x@hash@, @messages@ messages.
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
@crc_table@};
#else
static const uint32_t sp_crc_table[16] = {
@crc_nibbles@};
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

@definitions@
/* ---- comparison --------------------------------------------------------------------------- */

#define SP_DEVICE_BIT 0x80u

/* Type, number of fields, size of the fixed part; by rising type. */
static const uint8_t sp_messages[][3] = {
@message_rows@};

/* Of each message in turn: the size of each field; 0: a text. */
static const uint8_t sp_sizes[] = {
@size_rows@};

/* Of each message in turn: the hash before its first field and after each. */
static const uint32_t sp_chains[] = {
@chain_rows@};

/* Of each enumeration in turn: how many members it has, and the hash before the first and after
 * each. The first hash, of its name and kind, is what it is asked about by. */
static const uint8_t sp_enum_members[] = {
@enum_members@    0u, /* the end */
};
static const uint32_t sp_enum_chains[] = {
@enum_rows@    0u, /* the end */
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
@bootstrap_cases@        return true;
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

#define SP_CAN_START 0x@start@u
#define SP_CAN_END 0x@end@u
#define SP_CAN_TOGGLE 0x@toggle@u
#define SP_CAN_TRANSFER 0x@transfer@u
#define SP_CAN_WHOLE_STAMP @flag_whole_stamp@u
#define SP_CAN_SEGMENT @segment@u

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
@spans@    {0xFFu, 0xFFu, 0u, 0u, 0u, 0u}, /* the end */
};

static const uint32_t sp_can_slow_us[] = {@slow_us@};

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
        sp_put_u16(message->head + 1, (uint16_t)(t_us >> @stamp_shift@));
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
        sp_put_u16(frame->data, (uint16_t)(message->t_us >> @stamp_shift@));
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
    const uint32_t aged = receiver->ahead_us - (now_us - receiver->at_us) / @drift@u;
    const int32_t change = sp_signed(ahead - receiver->ahead_us);
    const bool other = !receiver->stamped || change < -@step_us@ || change > @step_us@;
    receiver->stamped = true;
    receiver->wire_us = t_us;
    receiver->at_us = now_us;
    receiver->ahead_us = other || sp_signed(ahead - aged) > 0 ? ahead : aged;
}

static bool sp_can_short_stamp(
    sp_can_receiver_t *receiver, uint16_t t16, uint32_t now_us, uint32_t *t_us)
{
    const uint32_t before = receiver->wire_us >> @stamp_shift@;
    const uint32_t ahead = (t16 - before) & 0xFFFFu;
    const uint32_t stamp =
        (before + (ahead < 0x8000u ? ahead : ahead - 0x10000u)) << @stamp_shift@;
    const int32_t age = sp_signed(now_us + receiver->ahead_us - stamp);
    if (!receiver->stamped || age < -@lead_us@ || age > @oldest_us@) {
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
        bool same = known->length == in->length && now_us - receiver->recent[i].at_us < @duplicate_us@u;
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
        || length == 0 || now_us - open->began_us > @open_us@u
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
