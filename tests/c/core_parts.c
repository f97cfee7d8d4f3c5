/* Checks of parts in which the two firmwares cannot be compared: interrupt rings, the line's queue,
 * the time of sending. Each check sets up its own board. No output if all checks pass. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board.h"
#include "flash_store.h"
#include "inbox.h"
#include "line.h"
#include "period.h"
#include "text.h"

#define CHECK(condition)                                                                    \
    do {                                                                                    \
        if (!(condition)) {                                                                 \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                 \
            exit(1);                                                                        \
        }                                                                                   \
    } while (0)

static struct {
    size_t room;
    uint32_t wait_us;
    uint8_t out[4096];
    size_t out_length;
    size_t can_room;
    size_t can_written;
    sp_can_frame_t can_last;
    unsigned flash_wait; /* calls until the flash is idle */
    unsigned erased;
} parts;

uint32_t board_now_us(board_t *board) { return 1000; }
size_t board_uart_room(board_t *board) { return parts.room; }
uint32_t board_uart_wait_us(board_t *board) { return parts.wait_us; }

void board_uart_write(board_t *board, const uint8_t *data, size_t length)
{
    memcpy(parts.out + parts.out_length, data, length);
    parts.out_length += length;
}

bool board_can_write(board_t *board, const sp_can_frame_t *frame)
{
    if (parts.can_room == 0) {
        return false;
    }
    parts.can_room--;
    parts.can_written++;
    parts.can_last = *frame;
    return true;
}

const uint8_t *board_flash_page(board_t *board, unsigned page) { return NULL; }

void board_flash_erase(board_t *board, unsigned page)
{
    CHECK(parts.flash_wait == 0);
    parts.erased++;
    parts.flash_wait = 3;
}

void board_flash_write(board_t *board, unsigned page, size_t offset, const uint8_t *data, size_t length)
{
}

bool board_flash_busy(board_t *board) { return parts.flash_wait != 0; }
void board_watchdog_feed(board_t *board) { parts.flash_wait--; }

/* A factory reset waits for a save that still runs: the chip ignores an erase during a save. */
static void a_factory_reset_waits_for_the_flash(void)
{
    parts.flash_wait = 5;
    flash_store_erase(NULL);
    CHECK(parts.erased == BOARD_FLASH_PAGES && parts.flash_wait == 0);
}

/* A zero keeps the time of its interrupt, however late the main loop reads it. */
static void zeros_keep_their_moment(void)
{
    static inbox_t inbox;
    const uint8_t first[] = {0, 1, 2, 0};
    const uint8_t second[] = {3, 0};
    uint8_t byte;
    uint32_t arrived_us = 0;
    inbox_put_bytes(&inbox, first, sizeof first, 100);
    inbox_put_bytes(&inbox, second, sizeof second, 200);
    const uint32_t wanted[] = {100, 100, 100, 100, 100, 200};
    for (unsigned i = 0; i < 6; i++) {
        CHECK(inbox_take_byte(&inbox, &byte, &arrived_us));
        CHECK(arrived_us == wanted[i]);
    }
    CHECK(!inbox_take_byte(&inbox, &byte, &arrived_us));
    CHECK(inbox.dropped == 0);
}

/* Data without room is dropped and counted; the rest stays in order, over many wraps. */
static void a_full_inbox_drops(void)
{
    static inbox_t inbox;
    uint8_t byte;
    uint8_t wanted = 1;
    uint32_t arrived_us;
    for (unsigned turn = 0; turn < 200; turn++) {
        for (unsigned i = 0; i < 700; i++) {
            byte = (uint8_t)(1u + (turn * 700u + i) % 255u);
            inbox_put_bytes(&inbox, &byte, 1, 0);
        }
        for (unsigned i = 0; i < 700; i++) {
            CHECK(inbox_take_byte(&inbox, &byte, &arrived_us));
            CHECK(byte == wanted);
            wanted = (uint8_t)(1u + wanted % 255u);
        }
    }
    CHECK(inbox.dropped == 0);
    byte = 7;
    for (unsigned i = 0; i < INBOX_BYTES + 5u; i++) {
        inbox_put_bytes(&inbox, &byte, 1, 0);
    }
    CHECK(inbox.dropped == 5);
    inbox_clear(&inbox);
    CHECK(!inbox_take_byte(&inbox, &byte, &arrived_us));
    byte = 0;
    for (unsigned i = 0; i < INBOX_STAMPS + 3u; i++) {
        inbox_put_bytes(&inbox, &byte, 1, i);
    }
    CHECK(inbox.dropped == 8);
    for (unsigned i = 0; i < INBOX_STAMPS; i++) {
        CHECK(inbox_take_byte(&inbox, &byte, &arrived_us) && arrived_us == i);
    }
}

static void can_frames_wait_in_order(void)
{
    static inbox_t inbox;
    sp_can_frame_t frame = {0};
    uint32_t arrived_us;
    for (uint16_t i = 0; i < INBOX_CAN_FRAMES + 2u; i++) {
        frame.id = i;
        inbox_put_frame(&inbox, &frame, 10u * i);
    }
    CHECK(inbox.dropped == 2);
    for (uint16_t i = 0; i < INBOX_CAN_FRAMES; i++) {
        CHECK(inbox_take_frame(&inbox, &frame, &arrived_us));
        CHECK(frame.id == i && arrived_us == 10u * i);
    }
    CHECK(!inbox_take_frame(&inbox, &frame, &arrived_us));
}

static int encode(line_t *line, uint16_t id)
{
    const sp_ack_t ack = {id, SP_TYPE_STOP};
    return sp_ack_encode(&ack, line_payload(line), SP_PAYLOAD_MAX);
}

/* A frame on an idle line has a leading zero. A stream leaves room for replies. A gap in the
 * sequence numbers shows dropped frames. */
static void the_uart_is_shared_out(void)
{
    static line_t line;
    line_start(&line, NULL, 3, false);
    parts.room = LINE_KEPT_BYTES + 18u;
    parts.wait_us = 0;
    line_stream(&line, SP_TYPE_ACK, 0, encode(&line, 1));
    CHECK(parts.out_length == 18 && parts.out[0] == 0);
    parts.wait_us = 5;
    parts.room = LINE_KEPT_BYTES + 17u;
    line_stream(&line, SP_TYPE_ACK, 0, encode(&line, 2));
    CHECK(parts.out_length == 18 && line.dropped == 1);
    line_send(&line, SP_TYPE_ACK, 0, encode(&line, 3));
    CHECK(parts.out_length == 18 + 17 && parts.out[18] != 0);
    CHECK(line_sent(&line) == 3 && line.sender.seq == 3);
    parts.room = 17;
    line_send(&line, SP_TYPE_ACK, 0, encode(&line, 4));
    CHECK(line.dropped == 2);
    line_send(&line, SP_TYPE_ACK, 0, -1); /* it did not fit a payload: nothing is sent */
    CHECK(line_sent(&line) == 4);
}

/* A reply that reports its sending time uses the line's time, not the program's. */
static void departure_is_the_line_s(void)
{
    static line_t line;
    line_start(&line, NULL, 3, false);
    parts.wait_us = 250;
    CHECK(line_departure_us(&line) == 1250 && !line_idle(&line));
    parts.wait_us = 0;
    CHECK(line_departure_us(&line) == 1000 && line_idle(&line));
}

/* Frames wait for a mailbox and keep their order; a message is sent completely or not at all. */
static void the_bus_is_shared_out(void)
{
    static line_t line;
    line_start(&line, NULL, 3, true);
    parts.can_room = 1;
    line_send(&line, SP_TYPE_ACK, 0, encode(&line, 1));
    CHECK(parts.can_written == 1 && line_idle(&line));
    line_send(&line, SP_TYPE_ACK, 0, encode(&line, 2));
    CHECK(line.waiting_count == 1 && !line_idle(&line));
    memset(line_payload(&line), 'x', 120);
    for (unsigned i = 0; i < 5; i++) {
        line_send(&line, SP_TYPE_LOG_TEXT, 0, 120);
    }
    CHECK(line.dropped == 2);
    const uint8_t waiting = line.waiting_count;
    line_stream(&line, SP_TYPE_ACK, 0, encode(&line, 3));
    CHECK(line.dropped == 3 && line.waiting_count == waiting);
    parts.can_room = 1000;
    line_pump(&line);
    CHECK(line_idle(&line) && parts.can_written == 1u + waiting);
    CHECK((parts.can_last.data[parts.can_last.length - 1u] & 0x40u) != 0); /* a transfer's end */
}

/* The lowest type is sent first. Equal types are sent in the order of the queue, so that the parts
 * of a message stay together. A sync counts the frames that were sent or dropped before it. */
static void the_bus_serves_the_most_urgent_first(void)
{
    static line_t line;
    const sp_imu_t imu = {1, 2, 3, 4, 5, 6, 7};
    const sp_sync_t sync = {0};
    line_start(&line, NULL, 3, true);
    parts.can_room = 0;
    parts.can_written = 0;
    memset(line_payload(&line), 'x', 120);
    line_stream(&line, SP_TYPE_LOG_TEXT, 0, 20); /* 5 frames */
    memset(line_payload(&line), 'x', 120);
    line_stream(&line, SP_TYPE_LOG_TEXT, 0, 120);
    memset(line_payload(&line), 'x', 120);
    line_stream(&line, SP_TYPE_LOG_TEXT, 0, 120); /* no room: its 19 frames are dropped */
    line_send_after(&line, SP_TYPE_ACK, SP_TYPE_LOG_TEXT, 0, encode(&line, 1));
    for (uint32_t t_us = 0; t_us < 20000; t_us += 10000) {
        line_stream(&line, SP_TYPE_IMU, t_us,
            sp_imu_encode(&imu, line_payload(&line), SP_PAYLOAD_MAX));
    }
    line_send(&line, SP_TYPE_ACK, 0, encode(&line, 2));
    line_stream(&line, SP_TYPE_SYNC, 0, sp_sync_encode(&sync, line_payload(&line), SP_PAYLOAD_MAX));
    CHECK(line.dropped == 1);
    parts.can_room = 1;
    line_pump(&line);
    CHECK(parts.can_last.id == (SP_TYPE_SYNC << 4 | 3) && parts.can_last.data[4] == 1u + 19u);
    parts.can_room = 5; /* acceleration and rotation twice, temperature once */
    line_pump(&line);
    CHECK(sp_can_direction((uint8_t)(parts.can_last.id >> 4)) == SP_FROM_DEVICE);
    CHECK(sp_direction((uint8_t)(parts.can_last.id >> 4)) == SP_UNKNOWN); /* part of the IMU's */
    parts.can_room = 1;
    line_pump(&line);
    CHECK(parts.can_last.id == (SP_TYPE_ACK << 4 | 3) && parts.can_last.data[3] == 2);
    CHECK(line.waiting_count == 5 + 19 + 1);
    parts.can_room = 1;
    line_pump(&line);
    CHECK(parts.can_last.id == (SP_TYPE_LOG_TEXT << 4 | 3) && (parts.can_last.data[7] & 0x80u) != 0);
    parts.can_room = 1000;
    line_pump(&line);
    CHECK(parts.can_last.id == (SP_TYPE_ACK << 4 | 3) && parts.can_last.data[3] == 1);
}

static void a_full_text_takes_nothing_more(void)
{
    static text_t text;
    char long_line[119];
    memset(long_line, 'x', sizeof long_line);
    text_add_foreign(&text, long_line, sizeof long_line);
    text_add(&text, "\xC3\xA9"); /* needs two bytes; one is left */
    text_add(&text, "y");
    CHECK(text.length == 119 && text.full);
}

/* Work that was due in a missed period is done in the next one, and only once. */
static void missed_periods_lose_nothing(void)
{
    unsigned counted = 0;
    for (uint32_t tick = 0, ticks = 1; tick < 3000; ticks = 1 + tick % 7u, tick += ticks) {
        counted += due_every(100, 3, tick, ticks);
    }
    CHECK(counted == 30);
    CHECK(due_every(5, 4, 4, 1) && !due_every(5, 4, 5, 1) && due_every(5, 4, 5, 2));
    CHECK(!due_every(100, 0, 99, 99) && due_every(100, 0, 99, 100) && due_every(1, 0, 17, 1));
}

int main(void)
{
    missed_periods_lose_nothing();
    a_factory_reset_waits_for_the_flash();
    zeros_keep_their_moment();
    a_full_inbox_drops();
    can_frames_wait_in_order();
    the_uart_is_shared_out();
    departure_is_the_line_s();
    the_bus_is_shared_out();
    the_bus_serves_the_most_urgent_first();
    a_full_text_takes_nothing_more();
    return 0;
}
