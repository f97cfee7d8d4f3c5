"""The C for classic CAN that is the same for every catalogue: what receives."""

from __future__ import annotations

RECEIVE = """\
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
