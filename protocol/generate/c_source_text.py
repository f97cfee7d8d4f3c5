"""The source's C that is the same for every catalogue: CRC, framing, agreement."""

from __future__ import annotations

SOURCE_TOP = """\
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
"""

SOURCE_CRC = """\
/* ---- CRC-32: reflected 0x04C11DB7, ones in, complemented out ------------------------------ */

#ifdef SP_CRC_FULL_TABLE
static const uint32_t sp_crc_table[256] = {{
{full}}};
#else
static const uint32_t sp_crc_table[16] = {{
{nibble}}};
#endif

uint32_t sp_crc32_update(uint32_t crc, const uint8_t *data, size_t length)
{{
    crc = ~crc;
    for (size_t i = 0; i < length; i++) {{
#ifdef SP_CRC_FULL_TABLE
        crc = crc >> 8 ^ sp_crc_table[(crc ^ data[i]) & 0xFFu];
#else
        crc ^= data[i];
        crc = crc >> 4 ^ sp_crc_table[crc & 0xFu];
        crc = crc >> 4 ^ sp_crc_table[crc & 0xFu];
#endif
    }}
    return ~crc;
}}

#ifdef SP_CRC_UNIT
#ifndef SP_CRC_UNIT_RESET /* RM0090, section 4.4: data register, control register */
#define SP_CRC_UNIT_RESET() (*(volatile uint32_t *)0x40023008u = 1u)
#define SP_CRC_UNIT_WRITE(word) (*(volatile uint32_t *)0x40023000u = (word))
#define SP_CRC_UNIT_READ() (*(volatile uint32_t *)0x40023000u)
#endif

static uint32_t sp_reverse_bits(uint32_t word)
{{
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
}}

uint32_t sp_crc32_unit(const uint8_t *data, size_t length)
{{
    /* The unit shifts the highest bit first: words go in and come out mirrored. */
    const size_t whole = length & ~(size_t)3u;
    SP_CRC_UNIT_RESET();
    for (size_t i = 0; i < whole; i += 4u) {{
        SP_CRC_UNIT_WRITE(sp_reverse_bits(sp_get_u32(data + i)));
    }}
    return sp_crc32_update(~sp_reverse_bits(SP_CRC_UNIT_READ()), data + whole, length - whole);
}}
#endif

#ifndef SP_CRC32
#ifdef SP_CRC_UNIT
#define SP_CRC32(data, length) sp_crc32_unit((data), (length))
#else
#define SP_CRC32(data, length) sp_crc32_update(0u, (data), (length))
#endif
#endif
"""

SOURCE_FRAMING = """\
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
"""

SOURCE_SCHEMA = """\
/* ---- agreement ---------------------------------------------------------------------------- */

#define SP_DEVICE_BIT 0x80u

/* Type, number of fields, size of the fixed part; by rising type. */
static const uint8_t sp_messages[][3] = {{
{rows}}};

/* Of each message in turn: the hash before its first field and after each. */
static const uint32_t sp_chains[] = {{
{chains}}};

#define SP_MESSAGES (sizeof sp_messages / sizeof sp_messages[0])

/* Place of a type among them; SP_MESSAGES: unknown. */
static size_t sp_index(uint8_t type)
{{
    size_t i = 0;
    while (i < SP_MESSAGES && (sp_messages[i][0] & ~SP_DEVICE_BIT) != type) {{
        i++;
    }}
    return i;
}}

sp_direction_t sp_direction(uint8_t type)
{{
    const size_t i = sp_index(type);
    if (i == SP_MESSAGES) {{
        return SP_UNKNOWN;
    }}
    return sp_messages[i][0] & SP_DEVICE_BIT ? SP_FROM_DEVICE : SP_FROM_HOST;
}}

static uint8_t sp_hex(uint32_t digit)
{{
    return (uint8_t)(digit < 10u ? '0' + digit : 'a' - 10u + digit);
}}

uint32_t sp_catalogue_hash(void)
{{
    const uint32_t *chain = sp_chains;
    uint32_t hash = 0;
    for (size_t i = 0; i < SP_MESSAGES; i++) {{
        /* "tt:cccccccc", newline: the type and its last chain value in hexadecimal */
        uint8_t line[12];
        chain += sp_messages[i][1];
        line[0] = sp_hex(sp_messages[i][0] >> 4 & 7u);
        line[1] = sp_hex(sp_messages[i][0] & 15u);
        line[2] = ':';
        for (uint32_t k = 0; k < 8u; k++) {{
            line[3 + k] = sp_hex(*chain >> (28u - 4u * k) & 15u);
        }}
        line[11] = '\\n';
        hash = sp_crc32_update(hash, line, sizeof line);
        chain++;
    }}
    return hash;
}}

void sp_describe(const sp_describe_t *question, sp_describe_reply_t *answer)
{{
    const uint32_t *chain = sp_chains;
    const size_t index = sp_index(question->described_type);
    answer->described_type = question->described_type;
    if (index == SP_MESSAGES) {{
        answer->field_count = SP_UNKNOWN_MESSAGE;
        answer->payload_length = 0;
        answer->chain = 0;
        return;
    }}
    for (size_t i = 0; i < index; i++) {{
        chain += sp_messages[i][1] + 1u;
    }}
    const uint8_t fields = sp_messages[index][1];
    answer->field_count = fields;
    answer->payload_length = sp_messages[index][2];
    answer->chain = chain[question->field_count < fields ? question->field_count : fields];
}}
"""
