#include "held.h"

#include <string.h>

#define STAMP 2u /* number of stamp bytes before a periodic frame's payload */

/* Add identifier, length and data of a frame; return false if there is no space. */
static bool cover(covered_t *covered, uint16_t id, const uint8_t *data, size_t length)
{
    uint8_t *const to = covered->bytes + covered->length;
    if (covered->length + 3u + length > HELD_COVERED) {
        return false;
    }
    to[0] = (uint8_t)id;
    to[1] = (uint8_t)(id >> 8);
    to[2] = (uint8_t)length;
    memcpy(to + 3, data, length);
    covered->length = (uint8_t)(covered->length + 3u + length);
    return true;
}

/* Return whether a frame continues a message: all parts of a message begin with an equal stamp. */
static bool continues(const covered_t *covered, const sp_can_frame_t *in)
{
    return covered->length > 3u + STAMP && memcmp(covered->bytes + 3, in->data, STAMP) == 0;
}

void held_note(held_t *held, const sp_can_receiver_t *receiver, const sp_can_frame_t *in)
{
    const bool whole = receiver->content != NULL;
    if (whole || !continues(&held->newest, in)) {
        held->newest.length = 0;
    }
    if (!(whole ? cover(&held->newest, in->id, receiver->content, receiver->content_length)
                : cover(&held->newest, in->id, in->data, in->length))) {
        held->newest.length = 0; /* no tag matches a message that is not covered completely */
    }
}

static void hand_over(held_t *held, sp_frame_t *frame)
{
    *frame = held->frame;
    held->waiting = false;
}

bool held_swap(held_t *held, uint32_t came_us, sp_frame_t *frame)
{
    const bool before = held->waiting;
    const sp_frame_t in = *frame;
    if (in.length > HELD_PAYLOAD) {
        return true; /* a message that needs a tag is never this long */
    }
    if (before) {
        hand_over(held, frame);
    }
    held->buffer ^= 1u;
    held->waiting = true;
    held->came_us = came_us;
    held->frame = in;
    memcpy(held->payload[held->buffer], in.payload, in.length);
    held->frame.payload = held->payload[held->buffer];
    held->covered = held->newest;
    held->stamps = held->coming;
    held->newest.length = 0;
    return before;
}

bool held_tagged(held_t *held, authentication_t *keys, const sp_can_frame_t *in, uint32_t now_us,
    sp_frame_t *frame)
{
    if (in->id >> 4 != SP_CAN_TAG_TYPE || !held->waiting || (in->id & 0x0Fu) != held->frame.node) {
        return false;
    }
    held->waiting = false;
    if (now_us - held->came_us > SP_CAN_TAG_US
        || !authentication_check(
            keys, held->covered.bytes, held->covered.length, in->data, in->length)) {
        return false;
    }
    hand_over(held, frame);
    frame->flags |= SP_FLAG_AUTHENTICATED;
    return true;
}

bool held_late(held_t *held, uint32_t now_us, sp_frame_t *frame, uint32_t *came_us)
{
    if (!held->waiting || now_us - held->came_us <= SP_CAN_TAG_US) {
        return false;
    }
    *came_us = held->came_us;
    hand_over(held, frame);
    return true;
}
