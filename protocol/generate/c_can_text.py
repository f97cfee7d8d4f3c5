"""The C for classic CAN that is the same for every catalogue."""

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

SOURCE = """\
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

/* A sum modulo 2^32, read as a signed number. */
static int32_t sp_signed(uint32_t value)
{{
    return value < 0x80000000u ? (int32_t)value : -(int32_t)~value - 1;
}}

static void sp_can_whole_stamp(sp_can_receiver_t *receiver, uint32_t t_us, uint32_t now_us)
{{
    const uint32_t ahead = t_us - now_us;
    const uint32_t aged = receiver->ahead_us - (now_us - receiver->at_us) / {drift}u;
    const int32_t change = sp_signed(ahead - receiver->ahead_us);
    const bool other = !receiver->stamped || change < -{step} || change > {step};
    receiver->stamped = true;
    receiver->wire_us = t_us;
    receiver->at_us = now_us;
    receiver->ahead_us = other || sp_signed(ahead - aged) > 0 ? ahead : aged;
}}

static bool sp_can_short_stamp(
    sp_can_receiver_t *receiver, uint16_t t16, uint32_t now_us, uint32_t *t_us)
{{
    const uint32_t before = receiver->wire_us >> {shift};
    const uint32_t ahead = (t16 - before) & 0xFFFFu;
    const uint32_t stamp =
        (before + (ahead < 0x8000u ? ahead : ahead - 0x10000u)) << {shift};
    const int32_t age = sp_signed(now_us + receiver->ahead_us - stamp);
    if (!receiver->stamped || age < -{lead} || age > {oldest}) {{
        return false;
    }}
    if (sp_signed(stamp - receiver->wire_us) > 0) {{
        receiver->wire_us = stamp;
    }}
    *t_us = stamp;
    return true;
}}

/* Whether the frame is one that has just been taken; else it is kept for the next time. */
static bool sp_can_doubled(
    sp_can_receiver_t *receiver, const sp_can_frame_t *in, uint32_t now_us)
{{
    size_t place = SP_CAN_RECENT;
    for (size_t i = 0; i < SP_CAN_RECENT; i++) {{
        const sp_can_frame_t *const known = &receiver->recent[i].frame;
        if (!receiver->recent[i].used || known->id != in->id) {{
            continue;
        }}
        bool same = known->length == in->length && now_us - receiver->recent[i].at_us < {double}u;
        for (size_t k = 0; same && k < in->length; k++) {{
            same = known->data[k] == in->data[k];
        }}
        if (same) {{
            return true;
        }}
        place = i;
    }}
    if (place == SP_CAN_RECENT) {{
        place = receiver->next_recent;
        receiver->next_recent = (uint8_t)((place + 1u) % SP_CAN_RECENT);
    }}
    receiver->recent[place].used = true;
    receiver->recent[place].at_us = now_us;
    receiver->recent[place].frame = *in;
    return false;
}}

static void sp_can_give_up(sp_can_receiver_t *receiver, sp_can_transfer_t *open)
{{
    open->length = 0;
    receiver->given_up++;
}}

/* A transfer's first segment, of several. */
static void sp_can_open(sp_can_receiver_t *receiver, const sp_can_frame_t *in, uint32_t now_us)
{{
    const uint8_t length = (uint8_t)(in->length - 1u);
    sp_can_transfer_t *open = &receiver->open[0];
    for (size_t i = 1; i < SP_CAN_OPEN && open->length != 0; i++) {{
        sp_can_transfer_t *const other = &receiver->open[i];
        if (other->length == 0 || sp_signed(other->order - open->order) < 0) {{
            open = other;
        }}
    }}
    if (open->length != 0) {{
        sp_can_give_up(receiver, open); /* the oldest makes room */
    }}
    open->began_us = now_us;
    open->order = receiver->order++;
    open->id = in->id;
    open->transfer = in->data[length] & SP_CAN_TRANSFER;
    open->toggle = 0;
    open->length = length;
    sp_copy(open->data, in->data, length);
}}

/* Take a segment: a complete content's first byte, or NULL. */
static const uint8_t *sp_can_segment(sp_can_receiver_t *receiver, const sp_can_frame_t *in,
    uint32_t now_us, size_t *content, sp_event_t *event)
{{
    const uint8_t length = (uint8_t)(in->length - 1u);
    const uint8_t tail = in->data[length];
    sp_can_transfer_t *open = NULL;
    for (size_t i = 0; i < SP_CAN_OPEN; i++) {{
        if (receiver->open[i].length != 0 && receiver->open[i].id == in->id) {{
            open = &receiver->open[i];
        }}
    }}
    if (tail & SP_CAN_START) {{
        if (open != NULL) {{
            sp_can_give_up(receiver, open);
        }}
        if (!(tail & SP_CAN_TOGGLE) || length == 0) {{
            return NULL;
        }}
        if (tail & SP_CAN_END) {{
            sp_copy(receiver->single, in->data, length);
            *content = length;
            return receiver->single;
        }}
        sp_can_open(receiver, in, now_us);
        return NULL;
    }}
    if (open == NULL) {{
        return NULL;
    }}
    if ((tail & SP_CAN_TOGGLE) != open->toggle || (tail & SP_CAN_TRANSFER) != open->transfer
        || length == 0 || now_us - open->began_us > {open}u
        || open->length + (uint32_t)length > sizeof open->data) {{
        sp_can_give_up(receiver, open);
        return NULL;
    }}
    sp_copy(open->data + open->length, in->data, length);
    open->length = (uint16_t)(open->length + length);
    open->toggle ^= SP_CAN_TOGGLE;
    if (!(tail & SP_CAN_END)) {{
        return NULL;
    }}
    const size_t whole = open->length < 4u ? 0u : open->length - 4u;
    open->length = 0;
    if (whole <= SP_CAN_SEGMENT
        || sp_crc32_update(0, open->data, whole) != sp_get_u32(open->data + whole)) {{
        receiver->damaged++;
        *event = SP_BAD_CRC;
        return NULL;
    }}
    *content = whole;
    return open->data;
}}

/* A periodic message: its payload stands in the frame as it is. */
static bool sp_can_periodic(sp_can_receiver_t *receiver, const sp_can_frame_t *in,
    uint32_t now_us, sp_frame_t *frame)
{{
    if (in->length < 2u) {{
        return false;
    }}
    const uint8_t length = (uint8_t)(in->length - 2u);
    if (!sp_can_short_stamp(receiver, sp_get_u16(in->data + length), now_us, &frame->t_us)) {{
        receiver->stale++;
        return false;
    }}
    sp_copy(receiver->single, in->data, length);
    frame->version = SP_VERSION;
    frame->flags = 0;
    frame->payload = receiver->single;
    frame->length = length;
    return true;
}}

static bool sp_can_parse(sp_can_receiver_t *receiver, const uint8_t *content, size_t length,
    uint32_t now_us, sp_frame_t *frame)
{{
    const bool whole = content[0] & SP_CAN_WHOLE_STAMP;
    const size_t head = whole ? 5u : 3u;
    if (length < head || length - head > SP_PAYLOAD_MAX) {{
        return false;
    }}
    if (whole) {{
        frame->t_us = sp_get_u32(content + 1);
        sp_can_whole_stamp(receiver, frame->t_us, now_us);
    }} else if (!sp_can_short_stamp(receiver, sp_get_u16(content + 1), now_us, &frame->t_us)) {{
        if (frame->type != SP_TYPE_STOP) {{
            receiver->stale++;
            return false;
        }}
        frame->t_us = now_us + receiver->ahead_us; /* obeyed whenever it was said */
    }}
    frame->version = content[0] >> 4;
    frame->flags = content[0] & 0x0Fu & ~SP_CAN_WHOLE_STAMP;
    frame->payload = content + head;
    frame->length = (uint8_t)(length - head);
    return true;
}}

sp_event_t sp_can_receive(
    sp_can_receiver_t *receiver, const sp_can_frame_t *in, uint32_t now_us, sp_frame_t *frame)
{{
    const uint8_t type = (uint8_t)(in->id >> 4);
    sp_event_t event = SP_NOTHING;
    if (in->id > 0x7FFu || in->length > 8u) {{
        return event;
    }}
    if (sp_can_doubled(receiver, in, now_us)) {{
        receiver->doubled++;
        return event;
    }}
    if (in->length == 0 || sp_direction(type) != SP_FROM_HOST) {{
        return event;
    }}
    frame->type = type;
    frame->node = in->id & 0x0Fu;
    frame->seq = 0;
    bool complete = false;
    if (sp_can_span(type)->type == type) {{
        complete = sp_can_periodic(receiver, in, now_us, frame);
    }} else {{
        size_t length = 0;
        const uint8_t *const content = sp_can_segment(receiver, in, now_us, &length, &event);
        complete = content != NULL && sp_can_parse(receiver, content, length, now_us, frame);
    }}
    if (complete) {{
        receiver->frames++;
        event = SP_FRAME;
    }}
    return event;
}}
#endif
"""
