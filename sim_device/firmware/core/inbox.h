/* Queues from the interrupts to the main loop. Each queue has one writer and one reader, and needs
 * no lock. The first queue contains UART bytes, and the arrival time of each zero byte, because a
 * zero may end a frame. The second queue contains CAN frames with their arrival times. */
#ifndef INBOX_H
#define INBOX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

/* Sizes of the queues: powers of two, at most 32 768. A build may set other sizes
 * (-DINBOX_BYTES=256u). */
#ifndef INBOX_BYTES
#define INBOX_BYTES 1024u /* 11 ms at 921 600 baud */
#endif
#ifndef INBOX_STAMPS
#define INBOX_STAMPS 256u /* a frame has at most two zeros, and at least 14 B */
#endif
#ifndef INBOX_CAN_FRAMES
#define INBOX_CAN_FRAMES 32u
#endif

typedef struct {
    sp_can_frame_t frame;
    uint32_t arrived_us;
} inbox_can_t;

typedef struct {
    uint8_t bytes[INBOX_BYTES];
    uint32_t stamps[INBOX_STAMPS];
    inbox_can_t frames[INBOX_CAN_FRAMES];
    /* Free-running positions. Only the interrupt changes the `in` positions. */
    uint16_t bytes_in, bytes_out;
    uint16_t stamps_in, stamps_out;
    uint16_t frames_in, frames_out;
    uint32_t dropped; /* number of bytes and frames dropped because a queue was full */
} inbox_t;

/* Add UART bytes. Called by the interrupt. */
void inbox_put_bytes(inbox_t *inbox, const uint8_t *data, size_t length, uint32_t arrived_us);
void inbox_put_frame(inbox_t *inbox, const sp_can_frame_t *frame, uint32_t arrived_us);

/* Count dropped bytes or frames. Called by the interrupt. */
void inbox_drop(inbox_t *inbox, uint32_t count);

/* Return the next byte; false if there is no byte. Called by the main loop. `arrived_us` is set
 * only for a zero byte. */
bool inbox_take_byte(inbox_t *inbox, uint8_t *byte, uint32_t *arrived_us);
bool inbox_take_frame(inbox_t *inbox, sp_can_frame_t *frame, uint32_t *arrived_us);

/* Drop everything in the queues. Called by the main loop. */
void inbox_clear(inbox_t *inbox);

#endif
