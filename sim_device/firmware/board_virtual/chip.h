/* The virtual board: a chip with its peripherals. The board runs one firmware library
 * (board_api.h). Its inputs are the time, sensor readings and bytes; its outputs are duties and
 * bytes. Python code simulates the robot's body. Several chips can run in one process.
 *
 * Every operation is one call with a payload, so that it works both in this process and over a pipe
 * (sim_device/core). All integers are little-endian. chip.py defines the same layout. */
#ifndef CHIP_H
#define CHIP_H

#include <stddef.h>
#include <stdint.h>

#include "board_api.h"

#define CHIP_VERSION 2u
#define CHIP_PAYLOAD_MAX 65536u

/* Operations that the caller requests. */
enum {
    CHIP_BOOT = 1, /* uid 12 B, boot id u32, reset cause u8, node u8, CAN u8, troubles u8,
                      capabilities u16, crashed u8, 0 u8, pc, lr, cfsr, uptime_us u32 */
    CHIP_POLL = 2, /* head, counts left, right u16, fresh u8, IMU 7 i16: one poll */
    CHIP_RECEIVE = 3, /* head, bytes of the UART or frames of 16 B (struct can_frame) */
    CHIP_RESET = 4,   /* end the program; a flash operation in progress stays incomplete */
    CHIP_FLASH = 5    /* page u8, content: set the content of a flash page */
};

/* Head of CHIP_POLL and CHIP_RECEIVE: uptime_us u64; amount that the line accepts now u32, in bytes on
 * the UART and in frames on CAN; the CAN controller's send errors, receive errors, bus-off now u8, 0 u8,
 * number of bus-offs u16. */
#define CHIP_HEAD 18u
#define CHIP_NO_LIMIT 0xFFFFFFFFu /* the line accepts any amount */

/* Reply of CHIP_BOOT, CHIP_POLL and CHIP_RECEIVE: duties left, right i16; drivers, rebooted, fed,
 * state, stop cause, negotiated, keyed, flash busy, frames wait for the bus u8; faults u16; session id
 * u32; waited_us u32 (time for which the program waited in this call); uptime of the next period i64;
 * then the sent bytes. */
#define CHIP_REPLY_HEAD 31u

/* Requests of the chip while the program runs. The caller writes the answer to chip_answer(). */
enum {
    CHIP_ASK_RANGES = 1,   /* ultrasonic in mm, infrared left, right in tenths of mm, u16 each; time
                              since the ultrasonic pulse in us, u32 */
    CHIP_ASK_CONTACTS = 2, /* SP_CONTACT_* u8 */
    CHIP_ASK_POWER = 3     /* battery, logic rail in mV, motors left, right in mA, u16 each */
};
typedef void chip_ask_t(uint32_t what);

typedef struct chip chip_t;

/* Create a chip with this library. If the result is NULL, chip_error() returns the reason.
 * chip_call() calls `ask`. */
BOARD_API_EXPORT chip_t *chip_open(const firmware_library_t *library, chip_ask_t *ask);
BOARD_API_EXPORT const char *chip_error(void);
BOARD_API_EXPORT void chip_close(chip_t *chip);

/* Return the buffers: the caller writes the payload before a call and reads the reply after it. */
BOARD_API_EXPORT uint8_t *chip_payload(chip_t *chip);
BOARD_API_EXPORT uint8_t *chip_reply(chip_t *chip);
BOARD_API_EXPORT uint8_t *chip_answer(chip_t *chip);

/* Execute an operation; return the number of bytes of the reply. */
BOARD_API_EXPORT uint32_t chip_call(chip_t *chip, uint32_t operation, uint32_t length);

/* Return the IMU registers 0x19 to 0x1C, as configured by the board; one byte each. */
BOARD_API_EXPORT uint32_t chip_imu_settings(chip_t *chip);

/* Return CHIP_VERSION of this library. */
BOARD_API_EXPORT uint32_t chip_version(void);

/* Print a backtrace on stderr if the program crashes. Use it only for a program in its own process.
 */
BOARD_API_EXPORT void chip_catch_signals(void);

#endif
