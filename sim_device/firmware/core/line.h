/* The line to the host, UART or CAN: messages go out and frames come in, and above it nobody knows
 * which of the two it is. */
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
/* Streams leave so much of the board's queue to replies. */
#define LINE_KEPT_BYTES 256u
#define LINE_KEPT_FRAMES 24u

typedef struct {
    board_t *board;
    bool can;
    uint8_t frame[SP_FRAME_MAX]; /* being made */
    uint32_t intact;             /* frames that came whole, a host's or of no known type */
    uint32_t refused;            /* of those and of others: of no use to this device */
    uint32_t dropped;            /* messages that found no room on their way out */

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

/* Where a message's payload is encoded, SP_PAYLOAD_MAX bytes; line_send() then sends it.
 *     line_send(line, SP_TYPE_ACK, t_us, sp_ack_encode(&ack, line_payload(line), SP_PAYLOAD_MAX));
 */
static inline uint8_t *line_payload(line_t *line)
{
    return sp_payload(line->frame);
}

/* Send the payload that was encoded, -1: it did not fit. What finds no room is dropped and counted
 * as sent, so that the host sees that it is missing. */
void line_send(line_t *line, uint8_t type, uint32_t t_us, int payload_length);

/* The same for what must not overtake an earlier message of this type (a lower type leaves first).
 */
void line_send_after(
    line_t *line, uint8_t type, uint8_t rank, uint32_t t_us, int payload_length);

/* The same for what is sent periodically, or may be missing: it leaves room for replies. */
void line_stream(line_t *line, uint8_t type, uint32_t t_us, int payload_length);

/* Frames sent so far, for the sync message and the load. */
uint32_t line_sent(const line_t *line);

/* The next intact frame that has come, of this protocol's version and from a host, and when it had
 * arrived; false where there is no more. Its payload stands until the next call. */
bool line_receive(line_t *line, inbox_t *inbox, sp_frame_t *frame, uint32_t *arrived_us);

/* Another host begins with this frame: its clock is a new one. */
void line_new_host(line_t *line, const sp_frame_t *frame, uint32_t arrived_us);

/* The host knows so many bytes of a message's payload. On a bus it sends no frames beyond them. */
void line_limit(line_t *line, uint8_t type, uint8_t length);

/* The host is gone: the next one knows every message whole. */
void line_forget_limits(line_t *line);

/* Frames with a bad check or form so far. */
uint32_t line_damaged(const line_t *line);

/* Hand waiting CAN frames to the controller as it has room. */
void line_pump(line_t *line);

/* When the next byte would leave, for a reply that tells the moment of its sending. */
uint32_t line_departure_us(const line_t *line);

/* Whether all that was sent has left. */
bool line_idle(const line_t *line);

#endif
