/* A board on paper: the firmware lives through a script that it reads from stdin, in the time that
 * the script says, and tells on stdout what it did. Nothing else has a say, so that what a script
 * brings about is always the same. Tests drive it, and it is what the fuzzer feeds (fuzz.c).
 *
 * A script is a row of records, integers little-endian:
 *   'B' u32 boot_id, u8 reset_cause, u8 flags   boot; flag 1: on CAN, 2: with empty flash
 *   'R' u16 x2 encoders, i16 x7 IMU, u16 x3 ranges, u8 contacts, u16 x4 power
 *                                               what the sensors read from now on (board.h)
 *   'S' u32 microseconds, u16 length, bytes     live for so long, then take what has come:
 *                                               bytes, or frames of 16 B (struct can_frame)
 *   'F' u8 node, u8 type, u32 stamp, u8 length, payload
 *                                               take a whole frame, sealed here (UART only): for a
 *                                               fuzzer, which does not guess checks
 *   'P' u16 periods                             lose the supply so many control periods after the
 *                                               next save has begun: the flash stays as it is then
 * Each 'S' is answered by one record: see tell().
 */
#include "script.h"

#include <string.h>

#include "board.h"
#include "firmware.h"
#include "firmware_state.h"

#define CAN_RECORD 16u
#define ERASE_PERIODS 25u /* 250 ms for a sector */

static struct {
    board_identity_t identity;
    uint64_t now_us;
    uint64_t end_us; /* of its life: no step goes beyond */
    uint64_t booted_us;
    uint8_t out[65536];
    size_t out_length;
    int16_t left;
    int16_t right;
    uint8_t reboots;

    board_encoders_t encoders;
    board_imu_t imu;
    board_ranges_t ranges;
    uint8_t contacts;
    board_power_t power;

    uint8_t pages[BOARD_FLASH_PAGES][BOARD_FLASH_PAGE_SIZE];
    unsigned flash_wait;
    unsigned supply_left; /* periods of saving until it is lost; 0: it is not */
    bool supply_lost;
} board;

static const char NAME[] = "virtual sweeper";

/* ---- what board.h asks for ----------------------------------------------------------------- */

uint32_t board_now_us(void)
{
    return (uint32_t)(board.now_us - board.booted_us);
}

uint32_t board_busy_us(void)
{
    return 0;
}

void board_watchdog_feed(void)
{
}

void board_reboot(void)
{
    board.reboots++;
    board.identity.boot_id++;
    board.identity.reset_cause = SP_RESET_CAUSE_SOFTWARE;
}

const board_identity_t *board_identity(void)
{
    return &board.identity;
}

size_t board_uart_room(void)
{
    return sizeof board.out - board.out_length;
}

void board_uart_write(const uint8_t *data, size_t length)
{
    memcpy(board.out + board.out_length, data, length);
    board.out_length += length;
}

uint32_t board_uart_wait_us(void)
{
    return board.out_length == 0 ? 0u : 1u;
}

bool board_can_write(const sp_can_frame_t *frame)
{
    uint8_t *const record = board.out + board.out_length;
    if (board_uart_room() < CAN_RECORD) {
        return false;
    }
    memset(record, 0, CAN_RECORD);
    record[0] = (uint8_t)frame->id;
    record[1] = (uint8_t)(frame->id >> 8);
    record[4] = frame->length;
    memcpy(record + 8, frame->data, frame->length);
    board.out_length += CAN_RECORD;
    return true;
}

void board_motors(int16_t left, int16_t right)
{
    board.left = left;
    board.right = right;
}

void board_encoders(board_encoders_t *out)
{
    *out = board.encoders;
    out->sampled_us = board_now_us();
}

void board_imu(board_imu_t *out)
{
    *out = board.imu;
    out->sampled_us = board_now_us();
}

void board_ranges(board_ranges_t *out)
{
    *out = board.ranges;
    out->sampled_us = board_now_us();
}

uint8_t board_contacts(void)
{
    return board.contacts;
}

void board_power(board_power_t *out)
{
    *out = board.power;
    out->sampled_us = board_now_us();
}

/* ---- flash: what it costs in time, and that it may stay half done --------------------------- */

const uint8_t *board_flash_page(unsigned page)
{
    return board.pages[page];
}

void board_flash_erase(unsigned page)
{
    memset(board.pages[page], 0xFF, BOARD_FLASH_PAGE_SIZE);
    board.flash_wait = ERASE_PERIODS;
}

void board_flash_write(unsigned page, size_t offset, const uint8_t *data, size_t length)
{
    if (board.supply_lost) {
        return;
    }
    if (board.supply_left == 1u) {
        length = length / 8u * 4u; /* half of it, in whole words */
    }
    memcpy(board.pages[page] + offset, data, length);
    board.flash_wait = 1;
}

bool board_flash_busy(void)
{
    if (board.supply_left != 0 && --board.supply_left == 0) {
        board.supply_lost = true;
    }
    if (board.flash_wait != 0) {
        board.flash_wait--;
    }
    return board.flash_wait != 0;
}

/* ---- the script ---------------------------------------------------------------------------- */

typedef struct {
    const uint8_t *data;
} reader_t;

static uint32_t take(reader_t *reader, size_t size)
{
    uint32_t value = 0;
    for (size_t i = 0; i < size; i++) {
        value |= (uint32_t)reader->data[i] << (8u * i);
    }
    reader->data += size;
    return value;
}

static uint16_t take_u16(reader_t *reader)
{
    return (uint16_t)take(reader, 2);
}

static int16_t take_i16(reader_t *reader)
{
    return (int16_t)((int32_t)(take(reader, 2) ^ 0x8000u) - 0x8000);
}

static void boot(void)
{
    board.booted_us = board.now_us;
    board.flash_wait = 0;
    board.supply_lost = false;
    board.left = board.right = 0;
    firmware_boot();
}

static void take_boot(reader_t *reader)
{
    const uint32_t boot_id = take(reader, 4);
    const uint8_t reset_cause = (uint8_t)take(reader, 1);
    const uint8_t flags = (uint8_t)take(reader, 1);
    memcpy(board.identity.uid, "script-board", sizeof board.identity.uid);
    board.identity.boot_id = boot_id;
    board.identity.reset_cause = reset_cause;
    board.identity.node = 1;
    board.identity.can = flags & 1u;
    board.identity.name = NAME;
    if (flags & 2u) {
        memset(board.pages, 0xFF, sizeof board.pages);
    }
    boot();
}

static void take_readings(reader_t *reader)
{
    board.encoders.left = take_u16(reader);
    board.encoders.right = take_u16(reader);
    board.imu.accel_x = take_i16(reader);
    board.imu.accel_y = take_i16(reader);
    board.imu.accel_z = take_i16(reader);
    board.imu.temperature = take_i16(reader);
    board.imu.gyro_x = take_i16(reader);
    board.imu.gyro_y = take_i16(reader);
    board.imu.gyro_z = take_i16(reader);
    board.ranges.ultrasonic_mm = take_u16(reader);
    board.ranges.infrared_left_dmm = take_u16(reader);
    board.ranges.infrared_right_dmm = take_u16(reader);
    board.contacts = (uint8_t)take(reader, 1) & 7u;
    board.power.battery_mv = take_u16(reader);
    board.power.logic_mv = take_u16(reader);
    board.power.motor_left_ma = take_u16(reader);
    board.power.motor_right_ma = take_u16(reader);
}

static void poll(void)
{
    const uint8_t reboots = board.reboots;
    firmware_poll();
    if (board.reboots != reboots || board.supply_lost) {
        board.identity.boot_id += board.supply_lost;
        boot();
    }
}

/* Live for so long: in every control period that is due at its moment. */
static void live(uint32_t for_us)
{
    const uint64_t left_us = board.end_us - board.now_us;
    const uint64_t until_us = board.now_us + (for_us < left_us ? for_us : left_us);
    for (;;) {
        const int64_t due_us = firmware_state()->due_us + (int64_t)board.booted_us;
        if (due_us > (int64_t)until_us) {
            break;
        }
        board.now_us = due_us > (int64_t)board.now_us ? (uint64_t)due_us : board.now_us;
        poll();
    }
    board.now_us = until_us;
    poll();
}

static void deliver(const uint8_t *data, size_t length)
{
    if (!board.identity.can) {
        for (size_t at = 0; at < length; at += 128u) {
            firmware_uart_received(
                data + at, length - at < 128u ? length - at : 128u, board_now_us());
            poll();
        }
        return;
    }
    for (size_t at = 0; at + CAN_RECORD <= length; at += CAN_RECORD) {
        sp_can_frame_t frame = {.id = (uint16_t)(data[at] | data[at + 1u] << 8)};
        frame.length = data[at + 4u] & 0x0Fu;
        if (frame.length <= sizeof frame.data) {
            memcpy(frame.data, data + at + 8u, sizeof frame.data);
            firmware_can_received(&frame, board_now_us());
            poll();
        }
    }
}

/* ---- what became of it --------------------------------------------------------------------- */

typedef struct {
    script_write_t *write;
    void *to;
} writer_t;

static void put(const writer_t *writer, uint64_t value, size_t size)
{
    uint8_t bytes[8];
    for (size_t i = 0; i < size; i++) {
        bytes[i] = (uint8_t)(value >> (8u * i));
    }
    writer->write(writer->to, bytes, size);
}

static void put_watchdog(const writer_t *writer, const watchdog_t *watchdog)
{
    put(writer, (uint16_t)watchdog->first, 2);
    put(writer, (uint16_t)watchdog->second, 2);
    put(writer, watchdog->counter_known ? watchdog->counter : 0x100u, 2);
    put(writer, (uint64_t)watchdog->until_us, 8);
}

static void tell(const writer_t *writer)
{
    const firmware_t *const state = firmware_state();
    put(writer, (uint64_t)state->now_us, 8);
    put(writer, state->session_id, 4);
    put(writer, state->agreed, 1);
    put(writer, state->control.state, 1);
    put(writer, state->control.latch.cause, 1);
    put(writer, control_faults(&state->control), 2);
    put(writer, state->stale, 2);
    put(writer, board.reboots, 1);
    put_watchdog(writer, &state->control.setpoints);
    put_watchdog(writer, &state->control.duties);
    for (unsigned i = 0; i < PARAMETERS; i++) {
        put(writer, state->parameters.present[i], 4);
    }
    put(writer, (uint16_t)board.left, 2);
    put(writer, (uint16_t)board.right, 2);
    put(writer, board.out_length, 4);
    writer->write(writer->to, board.out, board.out_length);
    board.out_length = 0;
}

static void take_step(reader_t *reader, const writer_t *writer)
{
    const uint32_t for_us = take(reader, 4);
    const size_t length = take(reader, 2);
    live(for_us);
    deliver(reader->data, length);
    tell(writer);
    poll(); /* the line is idle now: a reboot that was answered happens */
}

static void take_frame(reader_t *reader)
{
    sp_sender_t host = {.node = (uint8_t)take(reader, 1)};
    const uint8_t type = (uint8_t)take(reader, 1);
    const uint32_t stamp_us = take(reader, 4);
    const size_t length = take(reader, 1);
    uint8_t frame[SP_FRAME_MAX];
    if (length <= SP_PAYLOAD_MAX) {
        memcpy(sp_payload(frame), reader->data, length);
        deliver(frame, sp_seal(frame, &host, type, stamp_us, length));
    }
}

/* Bytes of the record that begins here; 0: more are needed to tell; NO_RECORD: none does. */
#define NO_RECORD SIZE_MAX
static size_t record_size(const uint8_t *data, size_t length)
{
    switch (data[0]) {
    case 'B':
        return 7;
    case 'R':
        return 34;
    case 'F':
        return length < 8u ? 0u : 8u + (size_t)data[7];
    case 'P':
        return 3;
    case 'S':
        return length < 7u ? 0u : 7u + (data[5] | (size_t)data[6] << 8);
    default:
        return NO_RECORD;
    }
}

void script_begin(uint64_t life_us)
{
    static const uint8_t first_boot[] = {1, 0, 0, 0, SP_RESET_CAUSE_POWER_ON, 2};
    reader_t reader = {first_boot};
    memset(&board, 0, sizeof board);
    board.end_us = life_us;
    take_boot(&reader);
}

size_t script_take(const uint8_t *data, size_t length, script_write_t *write, void *to)
{
    const writer_t writer = {write, to};
    size_t taken = 0;
    while (taken < length) {
        const size_t size = record_size(data + taken, length - taken);
        reader_t reader = {data + taken + 1u};
        if (size == NO_RECORD) {
            return length; /* what follows is no script */
        }
        if (size == 0 || size > length - taken) {
            break;
        }
        switch (data[taken]) {
        case 'B':
            take_boot(&reader);
            break;
        case 'R':
            take_readings(&reader);
            break;
        case 'F':
            take_frame(&reader);
            break;
        case 'P':
            board.supply_left = take_u16(&reader);
            break;
        default:
            take_step(&reader, &writer);
            break;
        }
        taken += size;
    }
    return taken;
}
