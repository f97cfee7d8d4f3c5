/* From the interrupts to the main loop: one writer and one reader each, no lock. Bytes of the UART
 * with the moment at which each zero had arrived, for it may end a frame; CAN frames with theirs. */
#ifndef INBOX_H
#define INBOX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

/* Powers of two, at most 32 768; a build may set its own (-DINBOX_BYTES=256u). */
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
    /* Free-running places; the writer's are changed by the interrupt alone. */
    uint16_t bytes_in, bytes_out;
    uint16_t stamps_in, stamps_out;
    uint16_t frames_in, frames_out;
    uint32_t dropped; /* bytes and frames that found no room */
} inbox_t;

/* From the interrupt. */
void inbox_put_bytes(inbox_t *inbox, const uint8_t *data, size_t length, uint32_t arrived_us);
void inbox_put_frame(inbox_t *inbox, const sp_can_frame_t *frame, uint32_t arrived_us);

/* From the main loop: false where there is none. `arrived_us` is set for a zero only. */
bool inbox_take_byte(inbox_t *inbox, uint8_t *byte, uint32_t *arrived_us);
bool inbox_take_frame(inbox_t *inbox, sp_can_frame_t *frame, uint32_t *arrived_us);

/* From the main loop: pass over all that waits. */
void inbox_clear(inbox_t *inbox);

#endif
