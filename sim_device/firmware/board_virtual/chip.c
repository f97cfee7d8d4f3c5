#include "chip.h"

#include <stdlib.h>
#include <string.h>

#include "flash.h"
#include "mpu6050.h"

#define CAN_RECORD 16u
#define NOT_STANDARD 0xE0u /* flags in the fourth byte: extended, remote and error frame */
#define RECEIVE_PIECE 128u /* half of a DMA ring buffer */
#define BOOT_BYTES 40u
#define POLL_BYTES (CHIP_HEAD + 19u)
#define SENT_MAX (CHIP_PAYLOAD_MAX - CHIP_REPLY_HEAD)
/* Assumed computing time of a control period and of a frame on a 168 MHz Cortex-M4, for the load.
 */
#define PERIOD_WORK_US 400u
#define FRAME_WORK_US 25u
#define WAIT_US 1000u /* time step while the program waits in its own loop */

struct chip {
    const firmware_library_t *library;
    firmware_t *firmware;
    chip_ask_t *ask;
    board_t board;

    board_identity_t identity;
    board_crash_t crash;
    bool running;
    bool rebooted;
    uint8_t fed; /* number of watchdog feeds in this call */
    uint64_t now_us;
    uint32_t waited_us;
    uint32_t busy_us;

    int16_t left, right;
    bool drivers;
    board_encoders_t encoders;
    mpu6050_t imu;
    uint32_t imu_stamp_us;
    virtual_flash_t flash;

    uint32_t line_room; /* free space of the link at the start of the call */
    board_can_health_t can;
    bool blocked;      /* a frame waits for the bus */
    size_t sent;       /* number of bytes in the reply */
    size_t waiting;    /* number of these bytes that are not sent yet */
    uint8_t answer[10]; /* answer to the last request */
    uint8_t payload[CHIP_PAYLOAD_MAX];
    uint8_t reply[CHIP_PAYLOAD_MAX];
};

static const char *why = "";

/* ---- integers ------------------------------------------------------------------------------ */

static uint16_t u16_at(const uint8_t *from)
{
    return (uint16_t)(from[0] | from[1] << 8);
}

static uint32_t u32_at(const uint8_t *from)
{
    return u16_at(from) | (uint32_t)u16_at(from + 2) << 16;
}

static uint64_t u64_at(const uint8_t *from)
{
    return u32_at(from) | (uint64_t)u32_at(from + 4) << 32;
}

static int16_t i16_at(const uint8_t *from)
{
    return (int16_t)((int32_t)(u16_at(from) ^ 0x8000u) - 0x8000);
}

static uint8_t *put(uint8_t *to, uint64_t value, unsigned size)
{
    for (unsigned i = 0; i < size; i++) {
        to[i] = (uint8_t)(value >> (8u * i));
    }
    return to + size;
}

/* ---- the board's functions ----------------------------------------------------------------- */

static uint32_t now_us(void *context)
{
    const chip_t *const chip = context;
    return (uint32_t)(chip->now_us + chip->waited_us);
}

static uint32_t busy_us(void *context)
{
    const chip_t *const chip = context;
    return chip->busy_us;
}

static void watchdog_feed(void *context)
{
    chip_t *const chip = context;
    if (chip->fed != 0) { /* the program waits in its own loop, so advance the time */
        chip->waited_us += WAIT_US;
    } else {
        chip->busy_us += PERIOD_WORK_US;
    }
    chip->fed = 1;
}

static void reboot(void *context)
{
    chip_t *const chip = context;
    chip->rebooted = true;
}

static const board_identity_t *identity(void *context)
{
    const chip_t *const chip = context;
    return &chip->identity;
}

static size_t uart_room(void *context)
{
    const chip_t *const chip = context;
    const size_t reply_room = SENT_MAX - chip->sent;
    const size_t line_room = chip->sent < chip->line_room ? chip->line_room - chip->sent : 0u;
    return line_room < reply_room ? line_room : reply_room;
}

static void append(chip_t *chip, const uint8_t *data, size_t length)
{
    if (length <= SENT_MAX - chip->sent) {
        memcpy(chip->reply + CHIP_REPLY_HEAD + chip->sent, data, length);
        chip->sent += length;
        chip->waiting += length;
    }
}

static void uart_write(void *context, const uint8_t *data, size_t length)
{
    chip_t *const chip = context;
    append(chip, data, length);
    chip->busy_us += FRAME_WORK_US;
}

/* The caller models the link's timing. On this board a byte is sent when the program's turn ends.
 */
static uint32_t uart_wait_us(void *context)
{
    const chip_t *const chip = context;
    return chip->waiting == 0 ? 0u : 1u;
}

static bool can_write(void *context, const sp_can_frame_t *frame)
{
    chip_t *const chip = context;
    uint8_t record[CAN_RECORD] = {0};
    const bool off = (chip->identity.troubles & BOARD_TROUBLE_CLOCK) != 0; /* see board.h */
    if (off) {
        return false;
    }
    if (chip->sent / CAN_RECORD >= chip->line_room || SENT_MAX - chip->sent < CAN_RECORD) {
        chip->blocked = true;
        return false;
    }
    record[0] = (uint8_t)frame->id;
    record[1] = (uint8_t)(frame->id >> 8);
    record[4] = frame->length;
    memcpy(record + 8, frame->data, frame->length);
    append(chip, record, CAN_RECORD);
    chip->busy_us += FRAME_WORK_US;
    return true;
}

static void can_health(void *context, board_can_health_t *out)
{
    const chip_t *const chip = context;
    *out = chip->can;
}

static void motors(void *context, int16_t left, int16_t right)
{
    chip_t *const chip = context;
    chip->left = left;
    chip->right = right;
}

static void drivers(void *context, bool enabled)
{
    chip_t *const chip = context;
    chip->drivers = enabled;
}

static void encoders(void *context, board_encoders_t *out)
{
    const chip_t *const chip = context;
    *out = chip->encoders;
}

static void imu(void *context, board_imu_t *out)
{
    chip_t *const chip = context;
    uint8_t data[MPU6050_DATA_BYTES];
    int16_t counts[7];
    mpu6050_read(&chip->imu, MPU6050_DATA, data, sizeof data);
    for (unsigned i = 0; i < 7u; i++) {
        const uint8_t swapped[] = {data[2u * i + 1u], data[2u * i]};
        counts[i] = i16_at(swapped);
    }
    const board_imu_t reading = {counts[0], counts[1], counts[2], counts[3], counts[4], counts[5],
        counts[6], chip->imu_stamp_us};
    *out = reading;
}

static void ranges(void *context, board_ranges_t *out)
{
    chip_t *const chip = context;
    chip->ask(CHIP_ASK_RANGES);
    const uint32_t sampled_us = now_us(chip);
    const board_ranges_t reading = {u16_at(chip->answer), u16_at(chip->answer + 2),
        u16_at(chip->answer + 4), sampled_us, sampled_us - u32_at(chip->answer + 6)};
    *out = reading;
}

static uint8_t contacts(void *context)
{
    chip_t *const chip = context;
    chip->ask(CHIP_ASK_CONTACTS);
    return chip->answer[0];
}

static void power(void *context, board_power_t *out)
{
    chip_t *const chip = context;
    chip->ask(CHIP_ASK_POWER);
    const board_power_t reading = {u16_at(chip->answer), u16_at(chip->answer + 2),
        u16_at(chip->answer + 4), u16_at(chip->answer + 6), now_us(chip)};
    *out = reading;
}

static const uint8_t *flash_page(void *context, unsigned page)
{
    const chip_t *const chip = context;
    return chip->flash.pages[page % BOARD_FLASH_PAGES];
}

static void flash_erase(void *context, unsigned page)
{
    chip_t *const chip = context;
    virtual_flash_erase(&chip->flash, page, chip->now_us + chip->waited_us);
}

static void flash_write(
    void *context, unsigned page, size_t offset, const uint8_t *data, size_t length)
{
    chip_t *const chip = context;
    virtual_flash_write(
        &chip->flash, page, offset, data, length, chip->now_us + chip->waited_us);
}

static bool flash_busy(void *context)
{
    chip_t *const chip = context;
    return virtual_flash_busy(&chip->flash, chip->now_us + chip->waited_us);
}

static const board_api_t api = {
    .now_us = now_us,
    .busy_us = busy_us,
    .watchdog_feed = watchdog_feed,
    .reboot = reboot,
    .identity = identity,
    .uart_room = uart_room,
    .uart_write = uart_write,
    .uart_wait_us = uart_wait_us,
    .can_write = can_write,
    .can_health = can_health,
    .motors = motors,
    .drivers = drivers,
    .encoders = encoders,
    .imu = imu,
    .ranges = ranges,
    .contacts = contacts,
    .power = power,
    .flash_page = flash_page,
    .flash_erase = flash_erase,
    .flash_write = flash_write,
    .flash_busy = flash_busy,
};

/* ---- the IMU's settings -------------------------------------------------------------------- */

#define FULL_SCALES 4u
#define NO_SCALE FULL_SCALES
/* Counts per deg/s and per g for each value of FS_SEL and AFS_SEL: register map, 4.19 and 4.17. */
static const float gyro_scales[FULL_SCALES] = {131.0f, 65.5f, 32.8f, 16.4f};
static const float accel_scales[FULL_SCALES] = {16384.0f, 8192.0f, 4096.0f, 2048.0f};

static unsigned full_scale(const float scales[FULL_SCALES], float counts)
{
    unsigned i = 0;
    while (i < FULL_SCALES && !(counts > 0.99f * scales[i] && counts < 1.01f * scales[i])) {
        i++;
    }
    return i;
}

/* Configure the IMU: awake, clock from the gyro; 100 Hz; filter 44/42 Hz; the scales of the
 * firmware. */
static void set_up_imu(chip_t *chip)
{
    const firmware_library_t *const library = chip->library;
    mpu6050_power_on(&chip->imu);
    mpu6050_write(&chip->imu, MPU6050_POWER, 0x01);
    mpu6050_write(&chip->imu, MPU6050_DIVIDER, 9);
    mpu6050_write(&chip->imu, MPU6050_CONFIG, 3);
    mpu6050_write(&chip->imu, MPU6050_GYRO_CONFIG,
        (uint8_t)(full_scale(gyro_scales, library->imu_per_deg_s) << 3));
    mpu6050_write(&chip->imu, MPU6050_ACCEL_CONFIG,
        (uint8_t)(full_scale(accel_scales, library->imu_per_g) << 3));
}

uint32_t chip_imu_settings(chip_t *chip)
{
    uint8_t settings[4];
    mpu6050_read(&chip->imu, MPU6050_DIVIDER, settings, sizeof settings);
    return u32_at(settings);
}

/* ---- loading ------------------------------------------------------------------------------- */

/* Check that library and board have equal structures. Return the reason of an error, or NULL. */
static const char *objection(const firmware_library_t *library)
{
    static const uint16_t sizes[BOARD_API_SIZES] = BOARD_API_SIZES_NOW;
    if (library == NULL || library->magic != BOARD_API_MAGIC) {
        return "it is no firmware library: sweepctl_firmware() gives something else";
    }
    if (library->version != BOARD_API_VERSION) {
        return "it has another version of the ABI of board.h: build it with this sweepctl's sources";
    }
    if (library->size != sizeof *library || memcmp(library->sizes, sizes, sizeof sizes) != 0) {
        return "its structures have other sizes than this sweepctl's: build it with these sources "
               "and for this processor";
    }
    if (full_scale(gyro_scales, library->imu_per_deg_s) == NO_SCALE
        || full_scale(accel_scales, library->imu_per_g) == NO_SCALE) {
        return "its IMU is none that the virtual board has: an MPU6050 counts 131, 65.5, 32.8 or 16.4 "
               "per deg/s and 16384, 8192, 4096 or 2048 per g";
    }
    return NULL;
}

chip_t *chip_open(const firmware_library_t *library, chip_ask_t *ask)
{
    why = objection(library);
    if (why != NULL) {
        return NULL;
    }
    chip_t *const chip = calloc(1, sizeof *chip);
    firmware_t *const firmware = calloc(1, library->state_size);
    if (chip == NULL || firmware == NULL) {
        why = "out of memory";
        free(chip);
        free(firmware);
        return NULL;
    }
    chip->library = library;
    chip->firmware = firmware;
    chip->ask = ask;
    chip->board.api = &api;
    chip->board.context = chip;
    virtual_flash_new(&chip->flash);
    set_up_imu(chip);
    return chip;
}

const char *chip_error(void)
{
    return why;
}

void chip_close(chip_t *chip)
{
    if (chip != NULL) {
        free(chip->firmware);
        free(chip);
    }
}

uint8_t *chip_payload(chip_t *chip)
{
    return chip->payload;
}

uint8_t *chip_reply(chip_t *chip)
{
    return chip->reply;
}

uint8_t *chip_answer(chip_t *chip)
{
    return chip->answer;
}

uint32_t chip_version(void)
{
    return CHIP_VERSION;
}

/* ---- running ------------------------------------------------------------------------------- */

static void poll(chip_t *chip)
{
    if (chip->running && !chip->rebooted) {
        chip->library->poll(chip->firmware);
    }
}

/* Mark all data as sent, and execute a pending reboot if its reply is sent. */
static void drain(chip_t *chip)
{
    if (chip->waiting != 0) {
        chip->waiting = 0;
        poll(chip);
        chip->waiting = 0;
    }
}

static void boot(chip_t *chip, const uint8_t *p)
{
    board_identity_t *const who = &chip->identity;
    memcpy(who->uid, p, sizeof who->uid);
    who->boot_id = u32_at(p + 12);
    who->reset_cause = p[16];
    who->node = p[17];
    who->can = p[18] != 0;
    who->troubles = p[19];
    who->capabilities = u16_at(p + 20);
    chip->crash.pc = u32_at(p + 24);
    chip->crash.lr = u32_at(p + 28);
    chip->crash.cfsr = u32_at(p + 32);
    chip->crash.uptime_us = u32_at(p + 36);
    who->crash = p[22] != 0 ? &chip->crash : NULL;
    who->name = "virtual sweeper (C core)";
    chip->now_us = chip->waited_us = chip->busy_us = 0;
    chip->left = chip->right = 0;
    chip->drivers = chip->rebooted = false;
    chip->fed = 0;
    chip->line_room = CHIP_NO_LIMIT;
    memset(&chip->can, 0, sizeof chip->can);
    set_up_imu(chip);
    chip->running = true;
    chip->library->boot(chip->firmware, &chip->board);
}

static void take_head(chip_t *chip, const uint8_t *p)
{
    chip->now_us = u64_at(p);
    chip->line_room = u32_at(p + 8);
    chip->can.send_errors = p[12];
    chip->can.receive_errors = p[13];
    chip->can.off = p[14] != 0;
    chip->can.offs = u16_at(p + 16);
}

static void take_readings(chip_t *chip, const uint8_t *p)
{
    chip->encoders.left = u16_at(p);
    chip->encoders.right = u16_at(p + 2);
    chip->encoders.sampled_us = (uint32_t)chip->now_us;
    if (p[4] != 0) {
        int16_t counts[7];
        for (unsigned i = 0; i < 7u; i++) {
            counts[i] = i16_at(p + 5 + 2u * i);
        }
        mpu6050_convert(&chip->imu, counts);
        chip->imu_stamp_us = (uint32_t)chip->now_us;
    }
}

static void receive(chip_t *chip, const uint8_t *data, size_t length)
{
    const firmware_library_t *const library = chip->library;
    if (!chip->identity.can) {
        for (size_t at = 0; at < length; at += RECEIVE_PIECE) {
            const size_t left = length - at;
            library->uart_received(chip->firmware, data + at,
                left < RECEIVE_PIECE ? left : RECEIVE_PIECE, (uint32_t)chip->now_us);
            poll(chip);
        }
        return;
    }
    if (length == 0) { /* the bus has accepted a frame, or time has passed */
        poll(chip);
    }
    for (size_t at = 0; at + CAN_RECORD <= length; at += CAN_RECORD) {
        sp_can_frame_t frame = {.id = u16_at(data + at) & 0x7FFu, .length = data[at + 4u] & 0x0Fu};
        const bool standard = (data[at + 3u] & NOT_STANDARD) == 0; /* as the controller's filters
                                                                      require */
        if (standard && frame.length <= sizeof frame.data) {
            memcpy(frame.data, data + at + 8u, sizeof frame.data);
            library->can_received(chip->firmware, &frame, (uint32_t)chip->now_us);
            poll(chip);
        }
    }
}

static uint32_t finish_reply(chip_t *chip)
{
    firmware_view_t view;
    memset(&view, 0, sizeof view);
    chip->library->view(chip->firmware, &view);
    uint8_t *to = chip->reply;
    to = put(to, (uint16_t)chip->left, 2);
    to = put(to, (uint16_t)chip->right, 2);
    to = put(to, chip->drivers, 1);
    to = put(to, chip->rebooted, 1);
    to = put(to, chip->fed, 1);
    to = put(to, view.state, 1);
    to = put(to, view.stop_cause, 1);
    to = put(to, view.negotiated, 1);
    to = put(to, view.keyed, 1);
    to = put(to, chip->flash.job != FLASH_JOB_NONE, 1);
    to = put(to, chip->blocked, 1);
    to = put(to, view.faults, 2);
    to = put(to, view.session_id, 4);
    to = put(to, chip->waited_us, 4);
    (void)put(to, (uint64_t)view.due_us, 8);
    return CHIP_REPLY_HEAD + (uint32_t)chip->sent;
}

uint32_t chip_call(chip_t *chip, uint32_t operation, uint32_t length)
{
    const uint8_t *const p = chip->payload;
    chip->sent = chip->waiting = 0;
    chip->fed = 0;
    chip->blocked = false;
    chip->now_us += chip->waited_us;
    chip->waited_us = 0;
    if (operation == CHIP_RESET) {
        virtual_flash_lose_supply(&chip->flash, chip->now_us);
        chip->running = false;
        return 0;
    }
    if (operation == CHIP_FLASH && length > 0 && length <= 1u + BOARD_FLASH_PAGE_SIZE) {
        memcpy(chip->flash.pages[p[0] % BOARD_FLASH_PAGES], p + 1, length - 1u);
        return 0;
    }
    if (operation == CHIP_BOOT && length == BOOT_BYTES) {
        boot(chip, p);
    } else if (operation == CHIP_POLL && length == POLL_BYTES) {
        take_head(chip, p);
        take_readings(chip, p + CHIP_HEAD);
        poll(chip);
        drain(chip);
    } else if (operation == CHIP_RECEIVE && length >= CHIP_HEAD && length <= CHIP_PAYLOAD_MAX) {
        take_head(chip, p);
        receive(chip, p + CHIP_HEAD, length - CHIP_HEAD);
        drain(chip);
    }
    return finish_reply(chip);
}
