/* Queues from the interrupts to the main loop: one writer and one reader each, no lock. One holds
 * UART bytes, with the arrival time of each zero, because a zero may end a frame. One holds CAN
 * frames with their arrival times. */
#ifndef INBOX_H
#define INBOX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

/* Sizes: powers of two, at most 32 768; a build may set its own (-DINBOX_BYTES=256u). */
#ifndef INBOX_BYTES
#define INBOX_BYTES 1024u /* 11 ms at 921 600 baud */
#endif
#ifndef INBOX_STAMPS
#define INBOX_STAMPS 256u /* a frame has two zeros at most, and 14 B at least */
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
    /* Free-running places; only the interrupt changes the writer's. */
    uint16_t bytes_in, bytes_out;
    uint16_t stamps_in, stamps_out;
    uint16_t frames_in, frames_out;
    uint32_t dropped; /* bytes and frames without room */
} inbox_t;

/* Called by the interrupt. */
void inbox_put_bytes(inbox_t *inbox, const uint8_t *data, size_t length, uint32_t arrived_us);
void inbox_put_frame(inbox_t *inbox, const sp_can_frame_t *frame, uint32_t arrived_us);

/* Called by the main loop; false if there is no byte. `arrived_us` is set for a zero only. */
bool inbox_take_byte(inbox_t *inbox, uint8_t *byte, uint32_t *arrived_us);
bool inbox_take_frame(inbox_t *inbox, sp_can_frame_t *frame, uint32_t *arrived_us);

/* Called by the main loop: drop everything that waits. */
void inbox_clear(inbox_t *inbox);

#endif
