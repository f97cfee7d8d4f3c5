/* A message on the bus that needs a tag, held until it has come. */
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

/* By what a receiver judges short stamps. */
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
    stamps_t stamps;     /* with the message that waits */
    stamps_t coming;     /* with the message that comes in */
    covered_t covered;   /* of the message that waits */
    covered_t newest;    /* of the message that comes in */
    uint8_t buffer;      /* in which the waiting one's payload is; the other one's is given out */
    uint8_t payload[2][HELD_PAYLOAD];
} held_t;

/* Note what a tag of the message would cover of which this is a frame. */
void held_note(held_t *held, const sp_can_receiver_t *receiver, const sp_can_frame_t *in);

/* Hold a message that is complete, with what was noted. True where another was held, which has no
 * tag: it is in `frame` now. */
bool held_swap(held_t *held, uint32_t came_us, sp_frame_t *frame);

/* Whether this is the tag of the message that is held: it is in `frame` then, marked. */
bool held_tagged(held_t *held, authentication_t *keys, const sp_can_frame_t *in, uint32_t now_us,
    sp_frame_t *frame);

/* Whether the tag did not come in time: the message is in `frame` then, without one. */
bool held_late(held_t *held, uint32_t now_us, sp_frame_t *frame, uint32_t *came_us);

#endif
