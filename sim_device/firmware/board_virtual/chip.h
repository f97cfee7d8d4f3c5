/* The virtual board: a chip with its peripherals, in the time that its caller gives it. It runs one
 * firmware library (board_api.h) and knows nothing of the robot's body: readings come in, duties and
 * bytes go out. Several chips run side by side in one process.
 *
 * Every operation is one call with a payload, so that it works the same in this process and over a
 * pipe (sim_device/core). All integers are little-endian. chip.py holds the same layout.
 */
#ifndef CHIP_H
#define CHIP_H

#include <stddef.h>
#include <stdint.h>

#include "board_api.h"

#define CHIP_VERSION 2u
#define CHIP_PAYLOAD_MAX 65536u

/* What the caller asks for. */
enum {
    CHIP_BOOT = 1, /* uid 12 B, boot id u32, reset cause u8, node u8, CAN u8, troubles u8,
                      capabilities u16, crashed u8, 0 u8, pc, lr, cfsr, uptime_us u32 */
    CHIP_POLL = 2, /* head, counts left, right u16, fresh u8, IMU 7 i16: one poll */
    CHIP_RECEIVE = 3, /* head, bytes of the UART or frames of 16 B (struct can_frame) */
    CHIP_RESET = 4,   /* the program ends; what the flash was doing stays half done */
    CHIP_FLASH = 5    /* page u8, content: as if it had been written before */
};

/* Head of CHIP_POLL and CHIP_RECEIVE: uptime_us u64; how much the line takes now u32, in bytes on the
 * UART and in frames on CAN; the CAN controller's send errors, receive errors, bus-off now u8, 0 u8,
 * number of bus-offs u16. */
#define CHIP_HEAD 18u
#define CHIP_NO_LIMIT 0xFFFFFFFFu /* the line takes everything */

/* What CHIP_BOOT, CHIP_POLL and CHIP_RECEIVE give: duties left, right i16; drivers, rebooted, fed,
 * state, stop cause, negotiated, keyed, flash busy, frames wait for the bus u8; faults u16; session id
 * u32; waited_us u32 (what the program waited for in this call); uptime of the next period i64; then
 * what it has sent. */
#define CHIP_REPLY_HEAD 31u

/* What the chip asks for while the program runs; the answer is written to chip_answer(). */
enum {
    CHIP_ASK_RANGES = 1,   /* ultrasonic in mm, infrared left, right in tenths of mm, u16 each; time
                              since the ultrasonic pulse in us, u32 */
    CHIP_ASK_CONTACTS = 2, /* SP_CONTACT_* u8 */
    CHIP_ASK_POWER = 3     /* battery, logic rail in mV, motors left, right in mA, u16 each */
};
typedef void chip_ask_t(uint32_t what);

typedef struct chip chip_t;

/* A chip with this library, or NULL: chip_error() says why. `ask` is called within chip_call(). */
BOARD_API_EXPORT chip_t *chip_open(const firmware_library_t *library, chip_ask_t *ask);
BOARD_API_EXPORT const char *chip_error(void);
BOARD_API_EXPORT void chip_close(chip_t *chip);

/* Where a payload is put before the call, and where the reply stands after it. */
BOARD_API_EXPORT uint8_t *chip_payload(chip_t *chip);
BOARD_API_EXPORT uint8_t *chip_reply(chip_t *chip);
BOARD_API_EXPORT uint8_t *chip_answer(chip_t *chip);

/* Do what is asked; bytes of the reply. */
BOARD_API_EXPORT uint32_t chip_call(chip_t *chip, uint32_t operation, uint32_t length);

/* Registers of the IMU that the program's board sets: 0x19 to 0x1C, one byte each. */
BOARD_API_EXPORT uint32_t chip_imu_settings(chip_t *chip);

/* Of CHIP_VERSION. */
BOARD_API_EXPORT uint32_t chip_version(void);

/* In a process of its own: let a crash of the program print its backtrace on stderr. */
BOARD_API_EXPORT void chip_catch_signals(void);

#endif
