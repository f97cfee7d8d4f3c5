/* The line to the host, UART or CAN: it sends messages and receives frames. The layers above do not
 * depend on its kind. */
#ifndef LINE_H
#define LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "authentication.h"
#include "board.h"
#include "held.h"
#include "inbox.h"
#include "sweepctl_protocol.h"

#ifndef LINE_CAN_WAITING
#define LINE_CAN_WAITING 64u /* frames; the longest message, a log line, has 20 */
#endif
/* Number of bytes of the board's queue that streams leave free for replies. */
#define LINE_KEPT_BYTES 256u
#define LINE_KEPT_FRAMES 24u

typedef struct {
    board_t *board;
    bool can;
    uint8_t frame[SP_FRAME_MAX]; /* in preparation */
    uint32_t intact;             /* complete frames, from a host or of unknown type */
    uint32_t refused;            /* intact frames that the device rejected */
    uint32_t dropped;            /* outgoing messages without room */

    sp_sender_t sender;
    sp_parser_t parser;

    sp_can_sender_t can_sender;
    sp_can_receiver_t can_receiver;
    authentication_t authentication;
    held_t held;
    struct {
        sp_can_frame_t frame;
        uint8_t rank;
    } waiting[LINE_CAN_WAITING]; /* the last one leaves first */
    uint8_t waiting_count;
    uint32_t can_gone; /* frames that have left or were dropped */
} line_t;

void line_start(line_t *line, board_t *board, uint8_t node, bool can);

/* Return the place where the caller encodes a message's payload, SP_PAYLOAD_MAX bytes; line_send()
 * then sends it.
 *     line_send(line, SP_TYPE_ACK, t_us, sp_ack_encode(&ack, line_payload(line), SP_PAYLOAD_MAX));
 */
static inline uint8_t *line_payload(line_t *line)
{
    return sp_payload(line->frame);
}

/* Send the encoded payload; length -1: it did not fit. A message without room is dropped but
 * counted as sent, so that the host notices its loss. */
void line_send(line_t *line, uint8_t type, uint32_t t_us, int payload_length);

/* The same for a message that must not overtake an earlier one of this type (a lower type leaves
 * first).
 */
void line_send_after(
    line_t *line, uint8_t type, uint8_t rank, uint32_t t_us, int payload_length);

/* The same for a periodic or optional message: it leaves room for replies. */
void line_stream(line_t *line, uint8_t type, uint32_t t_us, int payload_length);

/* Return the number of frames sent so far, for the sync message and the load. */
uint32_t line_sent(const line_t *line);

/* Return the next intact frame of this protocol's version from a host, and its arrival time; false
 * if there is none. Its payload is valid until the next call. */
bool line_receive(line_t *line, inbox_t *inbox, sp_frame_t *frame, uint32_t *arrived_us);

/* Take the clock of a new host from the stamp of this frame, its first one. */
void line_new_host(line_t *line, const sp_frame_t *frame, uint32_t arrived_us);

/* Limit a message's payload to the bytes that the host knows. On a bus the host sends no frames for
 * the other bytes. */
void line_limit(line_t *line, uint8_t type, uint8_t length);

/* Remove the limits of the last host. */
void line_forget_limits(line_t *line);

/* Return the number of frames with a bad check or form so far. */
uint32_t line_damaged(const line_t *line);

/* Pass waiting CAN frames to the controller while it has room. */
void line_pump(line_t *line);

/* Return the time at which the next byte would leave, for a reply that reports its sending time. */
uint32_t line_departure_us(const line_t *line);

/* Return whether everything sent has left. */
bool line_idle(const line_t *line);

#endif
