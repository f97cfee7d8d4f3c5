/* Holds a message from the CAN bus that needs a tag until its tag has arrived. */
#ifndef HELD_H
#define HELD_H

#include <stdbool.h>
#include <stdint.h>

#include "authentication.h"
#include "sweepctl_protocol.h"

#define HELD_PAYLOAD 32u
#define HELD_COVERED 48u

typedef struct {
    uint8_t length;
    uint8_t bytes[HELD_COVERED];
} covered_t;

/* State of a receiver for the extension of short stamps. */
typedef struct {
    uint32_t wire_us;
    uint32_t ahead_us;
    uint32_t at_us;
    bool stamped;
} stamps_t;

static inline stamps_t stamps_of(const sp_can_receiver_t *receiver)
{
    const stamps_t stamps = {
        receiver->wire_us, receiver->ahead_us, receiver->at_us, receiver->stamped};
    return stamps;
}

static inline void stamps_set(sp_can_receiver_t *receiver, const stamps_t *stamps)
{
    receiver->wire_us = stamps->wire_us;
    receiver->ahead_us = stamps->ahead_us;
    receiver->at_us = stamps->at_us;
    receiver->stamped = stamps->stamped;
}

typedef struct {
    bool waiting;
    sp_frame_t frame;
    uint32_t came_us;
    stamps_t stamps; /* state after the held message */
    stamps_t coming; /* state after the message that is being received */
    covered_t covered; /* bytes of the held message that the tag covers */
    covered_t newest; /* covered bytes of the message that is being received */
    uint8_t buffer;      /* index of the buffer with the held payload; callers may use the other
                            buffer */
    uint8_t payload[2][HELD_PAYLOAD];
} held_t;

/* Add this frame to the bytes that the tag of its message covers. */
void held_note(held_t *held, const sp_can_receiver_t *receiver, const sp_can_frame_t *in);

/* Hold a complete message and its covered bytes. Return true if an earlier message was held: it has
 * no tag and is now in `frame`. */
bool held_swap(held_t *held, uint32_t came_us, sp_frame_t *frame);

/* Return whether this is the tag of the held message. If so, the message is in `frame`, marked as
 * authenticated. */
bool held_tagged(held_t *held, authentication_t *keys, const sp_can_frame_t *in, uint32_t now_us,
    sp_frame_t *frame);

/* Return whether the time for the tag is over. If so, the message is in `frame`, without the
 * mark. */
bool held_late(held_t *held, uint32_t now_us, sp_frame_t *frame, uint32_t *came_us);

#endif
