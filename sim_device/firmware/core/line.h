/* The link to the host, UART or CAN: it sends messages and receives frames. The code that uses it
 * does not depend on the kind of link. */
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
#define LINE_CAN_WAITING 64u /* frames */
#endif
/* Number of bytes of the board's queue that streams leave free for replies. */
#define LINE_KEPT_BYTES 256u
#define LINE_KEPT_FRAMES (3u * LINE_CAN_WAITING / 8u)
/* Number of frames of the longest message, a log line. */
#define LINE_LONGEST_FRAMES 20u
#if LINE_CAN_WAITING < LINE_KEPT_FRAMES + LINE_LONGEST_FRAMES
#error "an idle queue must have room for the longest message"
#endif

typedef struct {
    board_t *board;
    bool can;
    uint8_t frame[SP_FRAME_MAX]; /* frame that is being encoded */
    uint32_t intact;             /* number of complete frames, from a host or of unknown type */
    uint32_t rejected;           /* number of intact frames that the device has rejected */
    uint32_t dropped;            /* number of outgoing messages dropped because a queue was full */

    sp_sender_t sender;
    sp_parser_t parser;

    sp_can_sender_t can_sender;
    sp_can_receiver_t can_receiver;
    authentication_t authentication;
    held_t held;
    struct {
        sp_can_frame_t frame;
        uint8_t rank;
    } waiting[LINE_CAN_WAITING]; /* the last entry is sent first */
    uint8_t waiting_count;
    uint32_t can_gone; /* number of frames that were sent or dropped */
} line_t;

void line_start(line_t *line, board_t *board, uint8_t node, bool can);

/* Return the buffer (SP_PAYLOAD_MAX bytes) in which the caller encodes a message's payload;
 * line_send() then sends the payload.     line_send(line, SP_TYPE_ACK, t_us, sp_ack_encode(&ack,
 * line_payload(line), SP_PAYLOAD_MAX)); */
static inline uint8_t *line_payload(line_t *line)
{
    return sp_payload(line->frame);
}

/* Send the encoded payload; the length -1 means that the payload did not fit. If the queue is full,
 * the message is dropped but counted as sent, so that the host detects the loss. */
void line_send(line_t *line, uint8_t type, uint32_t t_us, int payload_length);

/* Send the encoded payload with the rank of another type, so that it is not sent before an earlier
 * message of that type. (On CAN the message with the lowest rank is sent first.) */
void line_send_after(
    line_t *line, uint8_t type, uint8_t rank, uint32_t t_us, int payload_length);

/* Send a periodic or optional message only if there is enough free space for later replies. */
void line_stream(line_t *line, uint8_t type, uint32_t t_us, int payload_length);

/* Return the number of frames sent so far, for the sync message and the load. */
uint32_t line_sent(const line_t *line);

/* Return a host's next intact frame with our protocol version, and its arrival time; false if there
 * is no frame. The payload is valid until the next call. */
bool line_receive(line_t *line, inbox_t *inbox, sp_frame_t *frame, uint32_t *arrived_us);

/* Initialise the clock of a new host from the stamp of its first frame. */
void line_new_host(line_t *line, const sp_frame_t *frame, uint32_t arrived_us);

/* Limit a message's payload to the fields that the host declares. On CAN the host sends no frames
 * for the other fields. */
void line_limit(line_t *line, uint8_t type, uint8_t length);

/* Remove the limits of the last host. */
void line_forget_limits(line_t *line);

/* Return the number of frames with an invalid CRC or format. */
uint32_t line_damaged(const line_t *line);

/* Pass waiting CAN frames to the controller while it accepts frames. */
void line_pump(line_t *line);

/* Return the time at which the next byte would be sent, for a reply that contains its sending
 * time. */
uint32_t line_departure_us(const line_t *line);

/* Return whether all queued data has been sent. */
bool line_idle(const line_t *line);

#endif
