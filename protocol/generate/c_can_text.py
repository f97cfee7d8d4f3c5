"""The C for classic CAN that is the same for every catalogue: header, and what sends."""

from __future__ import annotations

HEADER = """\
#if SP_WITH_CAN
/* ---- classic CAN: id = type << 4 | node, 11 bits, at most 8 B ----------------------------- */

#ifndef SP_CAN_OPEN
#define SP_CAN_OPEN 2 /* transfers that are put together at the same time */
#endif
#ifndef SP_CAN_RECENT
#define SP_CAN_RECENT 4 /* frames of different ids that are known again when they are doubled */
#endif
#define SP_CAN_CONTENT_MAX 246u

typedef struct {{
    uint16_t id;
    uint8_t length;
    uint8_t data[8];
}} sp_can_frame_t;

/* A device that sends. All zero but for the node is one that has sent nothing. */
typedef struct {{
    uint8_t node;
    uint8_t flags;         /* SP_FLAG_*, of what is not periodic */
    uint8_t slow_sent;     /* bits: parts with a slow pace that were sent */
    uint32_t frames;       /* sent so far; it is put into every sync message */
    uint32_t slow_us[{slow}];   /* when they were */
    uint8_t transfer[{messages}]; /* next transfer of each message */
}} sp_can_sender_t;

/* A message on its way out. Its payload must stay until the last frame is fetched. */
typedef struct {{
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
}} sp_can_message_t;

/* A transfer of which segments are still to come. */
typedef struct {{
    uint32_t began_us;
    uint32_t order;
    uint16_t id;
    uint16_t length; /* 0: free */
    uint8_t transfer;
    uint8_t toggle;
    uint8_t data[SP_CAN_CONTENT_MAX + 4u];
}} sp_can_transfer_t;

/* A device that listens to its host. All zero is one that has heard nothing. */
typedef struct {{
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
    struct {{
        uint32_t at_us;
        sp_can_frame_t frame;
        bool used;
    }} recent[SP_CAN_RECENT];
    sp_can_transfer_t open[SP_CAN_OPEN];
}} sp_can_receiver_t;

/* Begin to send a message whose payload has been encoded; false where its length is wrong or its
 * type unknown. Then fetch its frames until there is no more. */
bool sp_can_begin(sp_can_sender_t *sender, sp_can_message_t *message, uint8_t type, uint32_t t_us,
    const uint8_t *payload, size_t length);
bool sp_can_next(sp_can_sender_t *sender, sp_can_message_t *message, sp_can_frame_t *frame);

/* Take a data frame with an 11-bit identifier that came at now_us. SP_FRAME: a message is
 * complete, its payload stands in the receiver until the next frame is taken. */
sp_event_t sp_can_receive(
    sp_can_receiver_t *receiver, const sp_can_frame_t *in, uint32_t now_us, sp_frame_t *frame);
#endif
"""

SEND = """\
#if SP_WITH_CAN
/* ---- classic CAN -------------------------------------------------------------------------- */

#define SP_CAN_START 0x80u
#define SP_CAN_END 0x40u
#define SP_CAN_TOGGLE 0x20u
#define SP_CAN_TRANSFER 0x1Fu
#define SP_CAN_WHOLE_STAMP {whole}u
#define SP_CAN_SEGMENT 7u

/* Stretches of a periodic message's payload, by message and then by frame. */
typedef struct {{
    uint8_t can_type; /* in the identifier */
    uint8_t type;     /* of the message */
    uint8_t first;
    uint8_t size;
    uint8_t slow; /* place among the slow parts, from 1; 0: sent with every message */
    uint8_t full; /* the stamp has 32 bits and stands first */
}} sp_can_span_t;

static const sp_can_span_t sp_can_spans[] = {{
{spans}    {{0xFFu, 0xFFu, 0u, 0u, 0u, 0u}}, /* the end */
}};

static const uint32_t sp_can_slow_us[] = {{{slow}}};

static const sp_can_span_t *sp_can_span(uint8_t type)
{{
    const sp_can_span_t *span = sp_can_spans;
    while (span->type != type && span->type != 0xFFu) {{
        span++;
    }}
    return span;
}}

bool sp_can_begin(sp_can_sender_t *sender, sp_can_message_t *message, uint8_t type, uint32_t t_us,
    const uint8_t *payload, size_t length)
{{
    const size_t index = sp_index(type);
    const sp_can_span_t *const span = sp_can_span(type);
    if (index == SP_MESSAGES || length > SP_PAYLOAD_MAX) {{
        return false;
    }}
    message->payload = payload;
    message->length = (uint8_t)length;
    message->type = type;
    message->t_us = t_us;
    message->native = span->type == type;
    if (message->native) {{
        message->position = (uint16_t)(span - sp_can_spans);
        return length == sp_messages[index][2];
    }}
    message->head[0] = (uint8_t)(SP_VERSION << 4 | (sender->flags & 7u));
    if (3u + length <= SP_CAN_SEGMENT && SP_CAN_SEGMENT < 5u + length) {{
        sp_put_u16(message->head + 1, (uint16_t)(t_us >> {shift}));
        message->head_length = 3;
    }} else {{
        message->head[0] |= SP_CAN_WHOLE_STAMP;
        sp_put_u32(message->head + 1, t_us);
        message->head_length = 5;
    }}
    message->position = 0;
    message->total = (uint16_t)(message->head_length + length);
    if (message->total > SP_CAN_SEGMENT) {{
        uint32_t crc = sp_crc32_update(0, message->head, message->head_length);
        crc = sp_crc32_update(crc, payload, length);
        sp_put_u32(message->crc, crc);
        message->total = (uint16_t)(message->total + 4u);
    }}
    message->tail = sender->transfer[index];
    message->toggle = SP_CAN_TOGGLE;
    sender->transfer[index] = (message->tail + 1u) & SP_CAN_TRANSFER;
    return true;
}}

static bool sp_can_next_part(
    sp_can_sender_t *sender, sp_can_message_t *message, sp_can_frame_t *frame)
{{
    const sp_can_span_t *span = sp_can_spans + message->position;
    while (span->type == message->type && span->slow != 0) {{
        const uint32_t slow = span->slow - 1u;
        const uint8_t bit = (uint8_t)(1u << slow);
        if ((sender->slow_sent & bit) == 0
            || message->t_us - sender->slow_us[slow] >= sp_can_slow_us[slow]) {{
            sender->slow_sent |= bit;
            sender->slow_us[slow] = message->t_us;
            break;
        }}
        const uint8_t passed = span->can_type;
        while (span->can_type == passed) {{
            span++;
        }}
    }}
    if (span->type != message->type) {{
        message->position = (uint16_t)(span - sp_can_spans);
        return false;
    }}
    const uint8_t can_type = span->can_type;
    const bool full = span->full != 0;
    uint8_t length = 0;
    sender->frames++;
    if (full) {{
        sp_put_u32(frame->data, message->t_us);
        length = 4;
    }}
    while (span->can_type == can_type) {{
        sp_copy(frame->data + length, message->payload + span->first, span->size);
        length = (uint8_t)(length + span->size);
        span++;
    }}
#ifdef SP_TYPE_SYNC
    if (can_type == SP_TYPE_SYNC) {{
        sp_put_u32(frame->data + 4, sender->frames);
    }}
#endif
    if (!full) {{
        sp_put_u16(frame->data + length, (uint16_t)(message->t_us >> {shift}));
        length = (uint8_t)(length + 2u);
    }}
    message->position = (uint16_t)(span - sp_can_spans);
    frame->id = (uint16_t)(can_type << 4 | sender->node);
    frame->length = length;
    return true;
}}

static uint8_t sp_can_content(const sp_can_message_t *message, size_t i)
{{
    if (i < message->head_length) {{
        return message->head[i];
    }}
    i -= message->head_length;
    return i < message->length ? message->payload[i] : message->crc[i - message->length];
}}

bool sp_can_next(sp_can_sender_t *sender, sp_can_message_t *message, sp_can_frame_t *frame)
{{
    if (message->native) {{
        return sp_can_next_part(sender, message, frame);
    }}
    if (message->position == message->total) {{
        return false;
    }}
    uint8_t tail = (uint8_t)(message->tail | message->toggle);
    uint8_t length = 0;
    if (message->position == 0) {{
        tail |= SP_CAN_START;
    }}
    while (length < SP_CAN_SEGMENT && message->position < message->total) {{
        frame->data[length] = sp_can_content(message, message->position);
        message->position++;
        length++;
    }}
    if (message->position == message->total) {{
        tail |= SP_CAN_END;
    }}
    message->toggle ^= SP_CAN_TOGGLE;
    frame->data[length] = tail;
    frame->length = (uint8_t)(length + 1u);
    frame->id = (uint16_t)(message->type << 4 | sender->node);
    sender->frames++;
    return true;
}}
"""
