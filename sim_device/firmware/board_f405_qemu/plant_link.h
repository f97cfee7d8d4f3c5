/* The link to the plant over the emulated chip's second UART: it receives sensor readings and sends
 * motor duties. sim_device/ports/qemu_link.py is the other end and defines the same numbers.
 *
 * A frame consists of 0xA5, type, payload length, payload and CRC-32 (as in zlib, from type to
 * payload). All numbers are little-endian. Only a reset causes data loss on this link. So damaged
 * frames are ignored, and all important data is requested again. */
#ifndef PLANT_LINK_H
#define PLANT_LINK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board.h"
#include "stm32f4.h"

#define PLANT_LINK_VERSION 3u
#define PLANT_CHUNK 128u

/* From the chip. */
enum {
    PLANT_BOOT = 0x01,    /* version u8: the chip asks for identity and flash */
    PLANT_REQUEST = 0x02, /* now u32, sample u32, newest u32, left i16, right i16, free stack u16,
                             drivers u8:
                             the plant may advance to `sample`, the time of the requested readings;
                             the chip has received the readings of `newest` */
    PLANT_MOTORS = 0x03,  /* now u32, left i16, right i16, drivers u8: a value has changed */
    PLANT_ERASE = 0x04,   /* page u8 */
    PLANT_WRITE = 0x05,   /* page u8, offset u16, data */
    PLANT_RESET = 0x06    /* cause u8: the chip is about to reset */
};

/* To the chip. */
enum {
    PLANT_IDENTITY = 0x81, /* uid 12, boot id u32, reset cause u8, node u8, chunks before it u8 */
    PLANT_PAGE = 0x82,     /* page u8, offset u16, data */
    PLANT_SAMPLE = 0x83,   /* sample u32, encoders 2 u16, IMU 7 i16, ultrasonic u16 mm, infrared
                              2 u16 tenths of mm, contacts u8, age of the IMU's sample u32 us, age
                              of the ultrasonic's u32 us */
    PLANT_POWER = 0x84,    /* sample u32, battery, logic u16 mV, motors 2 u16 mA */
    PLANT_HANG = 0x85,     /* the program must hang */
    PLANT_CRASH = 0x86     /* the program must cause a processor fault */
};

typedef struct {
    board_encoders_t encoders;
    board_imu_t imu;
    board_ranges_t ranges;
    uint8_t contacts;
    board_power_t power;
    uint32_t sample_us; /* time of all readings except the supply; IMU and ultrasonic add an age */
} plant_readings_t;

/* Return the present readings. Readings arrive before the time for which they are valid. Until this
 * time, the function returns the readings of the previous period. */
void plant_readings(plant_readings_t *out);
uint32_t plant_newest_us(void); /* time of the last received readings */
/* The interrupt writes these variables. */
extern volatile bool plant_known; /* the identity has been received */
extern volatile bool plant_hang;
extern volatile bool plant_crash;
extern board_identity_t plant_identity;
extern uint8_t plant_pages[BOARD_FLASH_PAGES][BOARD_FLASH_PAGE_SIZE];

void plant_begin(void);
void plant_send(uint8_t type, const uint8_t *payload, size_t length);
void plant_received(uint8_t byte); /* called by the interrupt */

static inline uint32_t uptime_us(void) { return TIM2->cnt; }

static inline uint8_t *put_u16(uint8_t *to, uint16_t value) {
    to[0] = (uint8_t)value;
    to[1] = (uint8_t)(value >> 8);
    return to + 2;
}

static inline uint8_t *put_u32(uint8_t *to, uint32_t value) {
    return put_u16(put_u16(to, (uint16_t)value), (uint16_t)(value >> 16));
}

#endif
