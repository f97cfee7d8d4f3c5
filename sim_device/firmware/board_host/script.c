/* A board without hardware. It reads a script from stdin, runs the firmware in simulated time and
 * writes the results to stdout. There is no other input, so the result of a script is always the
 * same. Tests and the fuzzer (fuzz.c) use it.
 *
 * A script is a sequence of records, integers little-endian:
 *   'B' u32 boot_id, u8 reset_cause, u8 flags   boot; flag 1: on CAN, 2: with empty flash,
 *                                               4: without its crystal, 8: after a crash, 16: with a
 *                                               flash that keeps nothing from now on, 32: without
 *                                               rangers, bumper and cliff sensor, 64: with a program
 *                                               that misses two of three control periods
 *   'R' u16 x2 encoders, i16 x7 IMU, u16 x3 ranges, u32 age of the first in us, u8 contacts, u16 x4 power
 *                                               sensor readings from now on (board.h); contact 8:
 *                                               the encoders have no new sample from now on
 *   'S' u32 microseconds, u16 length, bytes     run for this time, then receive the data:
 *                                               bytes, or frames of 16 B (struct can_frame)
 *   'F' u8 node, u8 type, u32 stamp, u8 length, payload
 *                                               receive a frame; the CRC is added here (UART only),
 *                                               because a fuzzer cannot guess it
 *   'P' u16 periods                             lose the supply this many control periods after the
 *                                               next save has begun: the flash stays as it is then
 * Each 'S' is answered by one record: see write_result().
 */
#include "script.h"

#include <string.h>

#include "board.h"
#include "firmware_state.h"

#define CAN_RECORD 16u
#define ERASE_PERIODS 25u /* 250 ms for a sector */

static struct {
    board_identity_t identity;
    uint64_t now_us;
    uint64_t end_us; /* maximum time of the run */
    uint64_t booted_us;
    uint8_t out[65536];
    size_t out_length;
    int16_t left;
    int16_t right;
    bool drivers;
    bool worn; /* the flash does not store written data */
    uint8_t reboots;

    board_encoders_t encoders;
    board_imu_t imu;
    board_ranges_t ranges;
    uint32_t ultrasonic_age_us;
    uint8_t contacts;
    int64_t missed_us;
    uint32_t encoders_us; /* time of the last sample of the encoders; 0: each reading is new */
    board_power_t power;

    uint8_t pages[BOARD_FLASH_PAGES][BOARD_FLASH_PAGE_SIZE];
    unsigned flash_wait;
    unsigned supply_left; /* control periods of a save until the supply is lost; 0: never */
    bool supply_lost;
} lives;

static firmware_t device;

static const char NAME[] = "virtual sweeper";
static const board_crash_t CRASH = {0x08004D2Au, 0x08004C91u, 0x00010000u, 12345678u};

/* ---- functions of board.h ------------------------------------------------------------------- */

static uint32_t uptime_us(void)
{
    return (uint32_t)(lives.now_us - lives.booted_us);
}

uint32_t board_now_us(board_t *board)
{
    return uptime_us();
}

uint32_t board_busy_us(board_t *board)
{
    return 0;
}

void board_watchdog_feed(board_t *board)
{
}

void board_reboot(board_t *board)
{
    lives.reboots++;
    lives.identity.boot_id++;
    lives.identity.reset_cause = SP_RESET_CAUSE_SOFTWARE;
}

const board_identity_t *board_identity(board_t *board)
{
    return &lives.identity;
}

size_t board_uart_room(board_t *board)
{
    return sizeof lives.out - lives.out_length;
}

void board_uart_write(board_t *board, const uint8_t *data, size_t length)
{
    memcpy(lives.out + lives.out_length, data, length);
    lives.out_length += length;
}

uint32_t board_uart_wait_us(board_t *board)
{
    return lives.out_length == 0 ? 0u : 1u;
}

bool board_can_write(board_t *board, const sp_can_frame_t *frame)
{
    uint8_t *const record = lives.out + lives.out_length;
    if (board_uart_room(board) < CAN_RECORD) {
        return false;
    }
    memset(record, 0, CAN_RECORD);
    record[0] = (uint8_t)frame->id;
    record[1] = (uint8_t)(frame->id >> 8);
    record[4] = frame->length;
    memcpy(record + 8, frame->data, frame->length);
    lives.out_length += CAN_RECORD;
    return true;
}

void board_can_health(board_t *board, board_can_health_t *out)
{
    memset(out, 0, sizeof *out);
}

void board_motors(board_t *board, int16_t left, int16_t right)
{
    lives.left = left;
    lives.right = right;
}

void board_drivers(board_t *board, bool enabled)
{
    lives.drivers = enabled;
}

void board_encoders(board_t *board, board_encoders_t *out)
{
    *out = lives.encoders;
    out->sampled_us = lives.encoders_us != 0 ? lives.encoders_us : uptime_us();
}

void board_imu(board_t *board, board_imu_t *out)
{
    *out = lives.imu;
    out->sampled_us = uptime_us();
}

void board_ranges(board_t *board, board_ranges_t *out)
{
    *out = lives.ranges;
    out->sampled_us = uptime_us();
    out->ultrasonic_us = out->sampled_us - lives.ultrasonic_age_us;
}

uint8_t board_contacts(board_t *board)
{
    return lives.contacts;
}

void board_power(board_t *board, board_power_t *out)
{
    *out = lives.power;
    out->sampled_us = uptime_us();
}

/* ---- flash: its delays, and interrupted writes
 * --------------------------------------------------- */

const uint8_t *board_flash_page(board_t *board, unsigned page)
{
    return lives.pages[page];
}

void board_flash_erase(board_t *board, unsigned page)
{
    memset(lives.pages[page], 0xFF, BOARD_FLASH_PAGE_SIZE);
    lives.flash_wait = ERASE_PERIODS;
}

void board_flash_write(board_t *board, unsigned page, size_t offset, const uint8_t *data, size_t length)
{
    if (lives.supply_lost) {
        return;
    }
    if (lives.worn) {
        lives.flash_wait = 1;
        return;
    }
    if (lives.supply_left == 1u) {
        length = length / 8u * 4u; /* half of the data, in whole words */
    }
    memcpy(lives.pages[page] + offset, data, length);
    lives.flash_wait = 1;
}

bool board_flash_busy(board_t *board)
{
    if (lives.supply_left != 0 && --lives.supply_left == 0) {
        lives.supply_lost = true;
    }
    if (lives.flash_wait != 0) {
        lives.flash_wait--;
    }
    return lives.flash_wait != 0;
}

/* ---- the script ----------------------------------------------------------------------------- */

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
    lives.booted_us = lives.now_us;
    lives.flash_wait = 0;
    lives.supply_lost = false;
    lives.left = lives.right = 0;
    lives.drivers = false;
    firmware_boot(&device, NULL);
}

static void take_boot(reader_t *reader)
{
    const uint32_t boot_id = take(reader, 4);
    const uint8_t reset_cause = (uint8_t)take(reader, 1);
    const uint8_t flags = (uint8_t)take(reader, 1);
    memcpy(lives.identity.uid, "script-board", sizeof lives.identity.uid);
    lives.identity.boot_id = boot_id;
    lives.identity.reset_cause = reset_cause;
    lives.identity.node = 1;
    lives.identity.can = flags & 1u;
    lives.identity.troubles = flags & 4u ? BOARD_TROUBLE_CLOCK : 0u;
    lives.identity.crash = flags & 8u ? &CRASH : NULL;
    lives.worn = flags & 16u;
    lives.missed_us = flags & 64u ? 20000 : 0;
    lives.identity.name = NAME;
    lives.identity.capabilities = SP_CAPABILITY_ENCODERS | SP_CAPABILITY_IMU;
    if (!(flags & 32u)) {
        lives.identity.capabilities |= SP_CAPABILITY_ULTRASONIC | SP_CAPABILITY_INFRARED
            | SP_CAPABILITY_BUMPER | SP_CAPABILITY_CLIFF;
    }
    if (flags & 2u) {
        memset(lives.pages, 0xFF, sizeof lives.pages);
    }
    boot();
}

static void take_readings(reader_t *reader)
{
    lives.encoders.left = take_u16(reader);
    lives.encoders.right = take_u16(reader);
    lives.imu.accel_x = take_i16(reader);
    lives.imu.accel_y = take_i16(reader);
    lives.imu.accel_z = take_i16(reader);
    lives.imu.temperature = take_i16(reader);
    lives.imu.gyro_x = take_i16(reader);
    lives.imu.gyro_y = take_i16(reader);
    lives.imu.gyro_z = take_i16(reader);
    lives.ranges.ultrasonic_mm = take_u16(reader);
    lives.ranges.infrared_left_dmm = take_u16(reader);
    lives.ranges.infrared_right_dmm = take_u16(reader);
    lives.ultrasonic_age_us = take(reader, 4);
    const uint8_t contacts = (uint8_t)take(reader, 1);
    lives.contacts = contacts & 7u;
    lives.encoders_us = contacts & 8u ? uptime_us() : 0u;
    lives.power.battery_mv = take_u16(reader);
    lives.power.logic_mv = take_u16(reader);
    lives.power.motor_left_ma = take_u16(reader);
    lives.power.motor_right_ma = take_u16(reader);
}

static void poll(void)
{
    if ((int64_t)lives.now_us < device.due_us + (int64_t)lives.booted_us + lives.missed_us
        && lives.missed_us != 0) {
        return; /* the program is busy elsewhere */
    }
    const uint8_t reboots = lives.reboots;
    firmware_poll(&device);
    if (lives.reboots != reboots || lives.supply_lost) {
        lives.identity.boot_id += lives.supply_lost;
        boot();
    }
}

/* Run for `for_us`, with every control period at its due time. */
static void run_for(uint32_t for_us)
{
    const uint64_t left_us = lives.end_us - lives.now_us;
    const uint64_t until_us = lives.now_us + (for_us < left_us ? for_us : left_us);
    for (;;) {
        const int64_t due_us = device.due_us + (int64_t)lives.booted_us + lives.missed_us;
        if (due_us > (int64_t)until_us) {
            break;
        }
        lives.now_us = due_us > (int64_t)lives.now_us ? (uint64_t)due_us : lives.now_us;
        poll();
    }
    lives.now_us = until_us;
    poll();
}

static void deliver(const uint8_t *data, size_t length)
{
    if (!lives.identity.can) {
        for (size_t at = 0; at < length; at += 128u) {
            firmware_uart_received(&device, data + at,
                length - at < 128u ? length - at : 128u, uptime_us());
            poll();
        }
        return;
    }
    for (size_t at = 0; at + CAN_RECORD <= length; at += CAN_RECORD) {
        sp_can_frame_t frame = {.id = (uint16_t)(data[at] | data[at + 1u] << 8)};
        frame.length = data[at + 4u] & 0x0Fu;
        if (frame.length <= sizeof frame.data) {
            memcpy(frame.data, data + at + 8u, sizeof frame.data);
            firmware_can_received(&device, &frame, uptime_us());
            poll();
        }
    }
}

/* ---- results -------------------------------------------------------------------------------- */

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

static void write_result(const writer_t *writer)
{
    const firmware_t *const state = &device;
    put(writer, (uint64_t)state->now_us, 8);
    put(writer, state->session_id, 4);
    put(writer, state->negotiated, 1);
    put(writer, state->control.state, 1);
    put(writer, state->control.latch.cause, 1);
    put(writer, control_faults(&state->control), 2);
    put(writer, state->stale, 2);
    put(writer, lives.reboots, 1);
    put_watchdog(writer, &state->control.setpoints);
    put_watchdog(writer, &state->control.duties);
    for (unsigned i = 0; i < PARAMETERS; i++) {
        put(writer, state->parameters.present[i], 4);
    }
    put(writer, (uint16_t)lives.left, 2);
    put(writer, (uint16_t)lives.right, 2);
    put(writer, lives.drivers, 1);
    put(writer, lives.out_length, 4);
    writer->write(writer->to, lives.out, lives.out_length);
    lives.out_length = 0;
}

static void take_step(reader_t *reader, const writer_t *writer)
{
    const uint32_t for_us = take(reader, 4);
    const size_t length = take(reader, 2);
    run_for(for_us);
    deliver(reader->data, length);
    write_result(writer);
    poll(); /* the link is idle now, so a pending reboot is executed */
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

/* Return the length of the record at the start of the data. 0: more bytes are needed. NO_RECORD:
 * the record is invalid. */
#define NO_RECORD SIZE_MAX
static size_t record_size(const uint8_t *data, size_t length)
{
    switch (data[0]) {
    case 'B':
        return 7;
    case 'R':
        return 38;
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
    memset(&lives, 0, sizeof lives);
    lives.end_us = life_us;
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
            return length; /* the rest is invalid */
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
            lives.supply_left = take_u16(&reader);
            break;
        default:
            take_step(&reader, &writer);
            break;
        }
        taken += size;
    }
    return taken;
}
