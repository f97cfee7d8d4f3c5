#include "line.h"

#include <string.h>

void line_start(line_t *line, board_t *board, uint8_t node, bool can)
{
    line->board = board;
    line->can = can;
    line->sender.node = node;
    line->can_sender.node = node;
}

/* ---- sending -------------------------------------------------------------------------------- */

static void send_uart(line_t *line, uint8_t type, uint32_t t_us, size_t length, size_t kept)
{
    const size_t whole = sp_seal(line->frame, &line->sender, type, t_us, length);
    /* If the UART is idle, a zero is sent first, so that the rest of an interrupted frame does not
     * damage the new frame. */
    const size_t skip = board_uart_wait_us(line->board) == 0 ? 0u : 1u;
    if (board_uart_room(line->board) < whole + kept) {
        line->dropped++;
        return;
    }
    board_uart_write(line->board, line->frame + skip, whole - skip);
}

/* Add a frame to the CAN queue; the last entry is sent first. A new frame is sent before frames
 * with a larger rank, and after frames with an equal rank. */
static void queue_can(line_t *line, const sp_can_frame_t *frame, uint8_t rank)
{
    uint8_t i = line->waiting_count;
    while (i != 0 && line->waiting[i - 1u].rank <= rank) {
        line->waiting[i] = line->waiting[i - 1u];
        i--;
    }
    line->waiting[i].frame = *frame;
    line->waiting[i].rank = rank;
    line->waiting_count++;
}

static void send_can(
    line_t *line, uint8_t type, uint8_t rank, uint32_t t_us, size_t length, size_t kept)
{
    /* Maximum number of frames of a message. A periodic message has at most three frames. All other
     * messages are segmented: payload, header and CRC (9 B) are sent in frames of seven bytes. */
    const size_t most = 3u + (length + 9u) / 7u;
    const bool room = line->waiting_count + most + kept <= LINE_CAN_WAITING;
    sp_can_message_t message;
    sp_can_frame_t frame;
    if (!sp_can_begin(&line->can_sender, &message, type, t_us, line_payload(line), length)) {
        return;
    }
    line->dropped += !room;
    while (sp_can_next(&line->can_sender, &message, &frame)) {
        if (room) {
            queue_can(line, &frame, rank);
        } else {
            line->can_gone++;
        }
    }
    line_pump(line);
}

static void send(line_t *line, uint8_t type, uint8_t rank, uint32_t t_us, int length, bool keeps)
{
    if (length < 0) {
        return;
    }
    if (line->can) {
        send_can(line, type, rank, t_us, (size_t)length, keeps ? LINE_KEPT_FRAMES : 0u);
    } else {
        send_uart(line, type, t_us, (size_t)length, keeps ? LINE_KEPT_BYTES : 0u);
    }
}

void line_send(line_t *line, uint8_t type, uint32_t t_us, int payload_length)
{
    send(line, type, type, t_us, payload_length, false);
}

void line_send_after(
    line_t *line, uint8_t type, uint8_t rank, uint32_t t_us, int payload_length)
{
    send(line, type, rank, t_us, payload_length, false);
}

void line_stream(line_t *line, uint8_t type, uint32_t t_us, int payload_length)
{
    send(line, type, type, t_us, payload_length, true);
}

uint32_t line_sent(const line_t *line)
{
    return line->can ? line->can_sender.frames : line->sender.frames;
}

void line_pump(line_t *line)
{
    while (line->waiting_count != 0) {
        sp_can_frame_t *const next = &line->waiting[line->waiting_count - 1u].frame;
        if (next->id >> 4 == SP_TYPE_SYNC) {
            /* The count is known only now, because frames are not sent in the order of creation. */
            const uint32_t count = line->can_gone + 1u;
            for (unsigned i = 0; i < 4u; i++) {
                next->data[4u + i] = (uint8_t)(count >> (8u * i));
            }
        }
        if (!board_can_write(line->board, next)) {
            return;
        }
        line->can_gone++;
        line->waiting_count--;
    }
}

uint32_t line_departure_us(const line_t *line)
{
    return board_now_us(line->board) + (line->can ? 0u : board_uart_wait_us(line->board));
}

bool line_idle(const line_t *line)
{
    return line->can ? line->waiting_count == 0 : board_uart_wait_us(line->board) == 0;
}

/* ---- receiving ------------------------------------------------------------------------------ */

static bool next_uart(line_t *line, inbox_t *inbox, sp_frame_t *frame, uint32_t *arrived_us)
{
    uint8_t byte;
    while (inbox_take_byte(inbox, &byte, arrived_us)) {
        if (sp_parser_byte(&line->parser, byte, frame) == SP_FRAME) {
            return true;
        }
    }
    return false;
}

static bool next_can(line_t *line, inbox_t *inbox, sp_frame_t *frame, uint32_t *arrived_us)
{
    sp_can_frame_t in;
    while (inbox_take_frame(inbox, &in, arrived_us)) {
        const uint32_t duplicates = line->can_receiver.duplicates;
        const stamps_t before = stamps_of(&line->can_receiver);
        const sp_event_t event = sp_can_receive(&line->can_receiver, &in, *arrived_us, frame);
        const sp_direction_t sender = sp_can_direction((uint8_t)(in.id >> 4));
        if (line->can_receiver.duplicates == duplicates && sender != SP_FROM_DEVICE) {
            line->intact++; /* number of frames; on UART, line_receive() counts complete messages */
            if (sender == SP_UNKNOWN) {
                if (held_tagged(&line->held, &line->authentication, &in, *arrived_us, frame)) {
                    stamps_set(&line->can_receiver, &line->held.stamps);
                    return true;
                }
                line->rejected++;
            } else {
                held_note(&line->held, &line->can_receiver, &in);
            }
        }
        if (line->authentication.keyed) {
            frame->flags &= (uint8_t)~SP_FLAG_AUTHENTICATED; /* only a valid tag sets this flag */
        }
        if (line->authentication.begun) { /* only a stamp with a valid tag may be the reference for
                                             the next stamp */
            line->held.coming = stamps_of(&line->can_receiver);
            stamps_set(&line->can_receiver, &before);
        }
        if (event != SP_FRAME) {
            continue;
        }
        if (!line->authentication.begun || !sp_may_have_tag(frame->type)
            || held_swap(&line->held, *arrived_us, frame)) {
            return true;
        }
    }
    return false;
}

/* Remove the tag of a UART frame; return whether the frame is authentic. A stop needs no tag. On
 * CAN the tag is a separate frame. */
static bool genuine(line_t *line, sp_frame_t *frame)
{
    if (line->can || (frame->flags & SP_FLAG_AUTHENTICATED) == 0) {
        return true;
    }
    if (frame->type == SP_TYPE_STOP || frame->type == SP_TYPE_STOP_ALL) {
        frame->flags &= (uint8_t)~SP_FLAG_AUTHENTICATED; /* a stop is accepted with any tag */
        return true;
    }
    if (frame->length < SP_TRAILER_SIZE) {
        return false;
    }
    frame->length = (uint8_t)(frame->length - SP_TRAILER_SIZE);
    const bool ours = authentication_check(&line->authentication, frame->payload - SP_HEADER_SIZE,
        SP_HEADER_SIZE + (size_t)frame->length, frame->payload + frame->length, SP_TRAILER_SIZE);
    if (!ours && frame->type == SP_TYPE_TIME_REQUEST) {
        frame->flags &= (uint8_t)~SP_FLAG_AUTHENTICATED; /* answered, but not marked authentic */
        return true;
    }
    return ours;
}

bool line_receive(line_t *line, inbox_t *inbox, sp_frame_t *frame, uint32_t *arrived_us)
{
    if (held_late(&line->held, board_now_us(line->board), frame, arrived_us)) {
        return true;
    }
    while (line->can ? next_can(line, inbox, frame, arrived_us)
                     : next_uart(line, inbox, frame, arrived_us)) {
        const sp_direction_t sender = sp_direction(frame->type);
        if (frame->version != SP_VERSION || sender == SP_FROM_DEVICE) {
            line->rejected++;
            continue;
        }
        line->intact += !line->can;
        if (sender == SP_FROM_HOST && genuine(line, frame)) {
            return true;
        }
        line->rejected++;
    }
    return false;
}

void line_new_host(line_t *line, const sp_frame_t *frame, uint32_t arrived_us)
{
    line->can_receiver.wire_us = frame->t_us;
    line->can_receiver.ahead_us = frame->t_us - arrived_us;
    line->can_receiver.at_us = arrived_us;
}

void line_limit(line_t *line, uint8_t type, uint8_t length)
{
#if SP_CAN_HOST_PARTS > 1
    sp_can_limit(&line->can_receiver, type, length);
#else
    (void)line;
    (void)type;
    (void)length;
#endif
}

void line_forget_limits(line_t *line)
{
#if SP_CAN_HOST_PARTS > 1
    memset(line->can_receiver.unshared, 0, sizeof line->can_receiver.unshared);
#else
    (void)line;
#endif
}

uint32_t line_damaged(const line_t *line)
{
    return line->rejected + (line->can ? line->can_receiver.damaged : line->parser.damaged);
}
