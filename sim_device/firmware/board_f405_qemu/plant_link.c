#include "plant_link.h"

#include <string.h>

#include "cortex_m4.h"
#include "stm32f4.h"

#define SYNC 0xA5u
#define HEAD 2u
#define CHECK 4u
#define PAYLOAD_MAX (3u + PLANT_CHUNK)

volatile bool plant_known;
volatile bool plant_hang;
volatile bool plant_crash;
board_identity_t plant_identity;
uint8_t plant_pages[BOARD_FLASH_PAGES][BOARD_FLASH_PAGE_SIZE];

static plant_readings_t present, coming;
static volatile bool on_its_way; /* the time of `coming` may be in the future */
static uint8_t plant_frame[HEAD + PAYLOAD_MAX + CHECK];
static size_t filled;
static bool in_frame;
static uint8_t chunks;

void plant_begin(void) {
    plant_known = plant_hang = plant_crash = in_frame = false;
    filled = 0;
    chunks = 0;
    memset(plant_pages, 0xFF, sizeof plant_pages);
    on_its_way = false;
    present.ranges.ultrasonic_mm = BOARD_NO_RANGE;
    present.ranges.infrared_left_dmm = BOARD_NO_RANGE;
    present.ranges.infrared_right_dmm = BOARD_NO_RANGE;
    coming = present;
}

static void publish_due(void) {
    if (on_its_way && (int32_t)(uptime_us() - coming.sample_us) >= 0) {
        on_its_way = false;
        present = coming;
    }
}

void plant_readings(plant_readings_t *out) {
    const uint32_t state = irq_save();
    publish_due();
    *out = present;
    irq_restore(state);
}

static void put(uint8_t byte) {
    while ((USART2->sr & USART_SR_TXE) == 0) {
    }
    USART2->dr = byte;
}

static void put_all(const uint8_t *data, size_t length) {
    for (size_t i = 0; i < length; i++) {
        put(data[i]);
    }
}

void plant_send(uint8_t type, const uint8_t *payload, size_t length) {
    const uint8_t head[HEAD] = {type, (uint8_t)length};
    uint8_t check[CHECK];
    (void)put_u32(check, sp_crc32_update(sp_crc32_update(0, head, HEAD), payload, length));
    const uint32_t state = irq_save(); /* the tick's interrupt sends too */
    put(SYNC);
    put_all(head, HEAD);
    put_all(payload, length);
    put_all(check, CHECK);
    irq_restore(state);
}

uint32_t plant_newest_us(void) { return coming.sample_us; }

static uint16_t u16_at(const uint8_t *from) {
    return (uint16_t)(from[0] | from[1] << 8);
}

static uint32_t u32_at(const uint8_t *from) {
    return u16_at(from) | (uint32_t)u16_at(from + 2) << 16;
}

static void take_sample(const uint8_t *p) {
    const uint32_t sampled_us = u32_at(p);
    board_imu_t *const imu = &coming.imu;
    publish_due(); /* an unexpected frame */
    coming.sample_us = sampled_us;
    coming.encoders.left = u16_at(p + 4);
    coming.encoders.right = u16_at(p + 6);
    coming.encoders.sampled_us = sampled_us;
    imu->accel_x = (int16_t)u16_at(p + 8);
    imu->accel_y = (int16_t)u16_at(p + 10);
    imu->accel_z = (int16_t)u16_at(p + 12);
    imu->temperature = (int16_t)u16_at(p + 14);
    imu->gyro_x = (int16_t)u16_at(p + 16);
    imu->gyro_y = (int16_t)u16_at(p + 18);
    imu->gyro_z = (int16_t)u16_at(p + 20);
    imu->sampled_us = sampled_us - u32_at(p + 29);
    coming.ranges.ultrasonic_mm = u16_at(p + 22);
    coming.ranges.infrared_left_dmm = u16_at(p + 24);
    coming.ranges.infrared_right_dmm = u16_at(p + 26);
    coming.ranges.sampled_us = sampled_us;
    coming.contacts = p[28];
    coming.ranges.ultrasonic_us = sampled_us - u32_at(p + 33);
    on_its_way = true;
}

static void take_power(const uint8_t *p) {
    coming.power.sampled_us = u32_at(p);
    coming.power.battery_mv = u16_at(p + 4);
    coming.power.logic_mv = u16_at(p + 6);
    coming.power.motor_left_ma = u16_at(p + 8);
    coming.power.motor_right_ma = u16_at(p + 10);
}

static void take_page(const uint8_t *p, size_t length) {
    const size_t offset = u16_at(p + 1), count = length - 3u;
    if (p[0] < BOARD_FLASH_PAGES && offset + count <= BOARD_FLASH_PAGE_SIZE) {
        memcpy(&plant_pages[p[0]][offset], p + 3, count);
        chunks++;
    }
}

static void take_identity(const uint8_t *p) {
    if (p[18] != chunks || plant_known) {
        chunks = 0; /* a part was lost: board_start() requests it again */
        return;
    }
    memcpy(plant_identity.uid, p, sizeof plant_identity.uid);
    plant_identity.boot_id = u32_at(p + 12);
    plant_identity.reset_cause = p[16];
    plant_identity.node = p[17];
    plant_known = true;
}

static void take(uint8_t type, const uint8_t *payload, size_t length) {
    if (type == PLANT_SAMPLE && length == 37u) {
        take_sample(payload);
    } else if (type == PLANT_POWER && length == 12u) {
        take_power(payload);
    } else if (type == PLANT_PAGE && length > 3u) {
        take_page(payload, length);
    } else if (type == PLANT_IDENTITY && length == 19u) {
        take_identity(payload);
    } else if (type == PLANT_HANG) {
        plant_hang = true;
    } else if (type == PLANT_CRASH) {
        plant_crash = true;
    }
}

void plant_received(uint8_t byte) {
    if (!in_frame) {
        in_frame = byte == SYNC;
        filled = 0;
        return;
    }
    plant_frame[filled++] = byte;
    if (filled < HEAD) {
        return;
    }
    const size_t length = plant_frame[1];
    if (length > PAYLOAD_MAX) {
        in_frame = false;
        return;
    }
    if (filled < HEAD + length + CHECK) {
        return;
    }
    in_frame = false;
    if (u32_at(plant_frame + HEAD + length) == sp_crc32_update(0, plant_frame, HEAD + length)) {
        take(plant_frame[0], plant_frame + HEAD, length);
    }
}
