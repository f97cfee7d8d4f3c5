/* All functions that the firmware's core needs from a board: the core includes no vendor header and
 * uses no register. A board is one folder (board_host, board_f429, board_f405_qemu, or your own
 * folder) that defines all these functions. The interrupts of the board call the functions of
 * firmware.h that are marked for interrupts.
 *
 * All functions are called from the main loop, never from an interrupt. They must not wait, except
 * board_idle() and board_reboot(). The argument `board` is the pointer that was passed to
 * firmware_boot(): a program with one device passes NULL, and its functions ignore it; a program
 * with several devices passes one object per device. All times are from one free-running
 * microsecond counter, which begins near 0 at boot and wraps at 32 bits. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

typedef struct board board_t;       /* defined by a board that needs one */
typedef struct firmware firmware_t; /* the state of one device: firmware_state.h */

/* ---- the chip ------------------------------------------------------------------------------- */

/* Start clocks, pins, timers and interrupts, with the motors off. main() calls it once, as its
 * first call. `firmware` receives the data from interrupts. A board that gets its identity from
 * outside (the emulated board) waits for the identity here. */
void board_start(firmware_t *firmware);

/* Return the microseconds since boot; the value wraps. */
uint32_t board_now_us(board_t *board);

/* Return the microseconds since boot in which the processor did not sleep in board_idle(); the
 * value wraps. */
uint32_t board_busy_us(board_t *board);

/* Sleep until the next interrupt, at most a millisecond. Called by main(). */
void board_idle(void);

/* Feed the watchdog, which resets the chip after 100 ms without a feed. Called once per control
 * period. */
void board_watchdog_feed(board_t *board);

/* Reset the chip with the cause "software"; all queued bytes have already been sent. On a chip the
 * function does not return. On the host board it returns, and the test then calls
 * firmware_boot(). */
void board_reboot(board_t *board);

/* ---- identity, constant from board_start() on ----------------------------------------------- */

/* No crystal and no external clock: the chip runs from its internal oscillator (accurate to 1 %),
 * and CAN is off. */
#define BOARD_TROUBLE_CLOCK 1u
/* Parameters and key cannot be saved. */
#define BOARD_TROUBLE_FLASH 2u
/* The UART is connected to a network: its user may be far from the robot, so no key can be set. */
#define BOARD_TROUBLE_REMOTE 4u

/* Record that the fault handler stores in memory that a reset does not clear. */
typedef struct {
    uint32_t pc;   /* address of the instruction that faulted */
    uint32_t lr;   /* return address of its function */
    uint32_t cfsr; /* kind of fault: PM0214, section 4.4.10 */
    uint32_t uptime_us;
} board_crash_t;

typedef struct {
    uint8_t uid[12];     /* the chip's 96-bit unique id */
    uint32_t boot_id;    /* random, new at each boot, not 0 */
    uint8_t reset_cause; /* SP_RESET_CAUSE_* */
    uint8_t node;        /* node id, 1..15, from a jumper or a constant */
    bool can;            /* the host link is the CAN bus instead of the UART */
    uint16_t capabilities; /* SP_CAPABILITY_*: connected parts. Encoders and IMU are required. The
                              core ignores ranges and contacts of other parts. */
    uint8_t troubles;      /* BOARD_TROUBLE_*, found at the start */
    const board_crash_t *crash; /* record of the previous boot if the reset cause is "crash"; else
                                   NULL */
    const char *name;    /* name of board and firmware, shown by the host; ASCII, at most 60 B */
} board_identity_t;

const board_identity_t *board_identity(board_t *board);

/* ---- the line to the host ------------------------------------------------------------------- */

/* UART, sending only. For received bytes, the interrupt calls firmware_uart_received() in
 * firmware.h. */

/* Return the number of bytes that can be queued now. The queue should have at least 512 bytes,
 * because a frame has up to 256. */
size_t board_uart_room(board_t *board);

/* Queue a frame or a part of a frame. The core never passes more bytes than board_uart_room()
 * returned. */
void board_uart_write(board_t *board, const uint8_t *data, size_t length);

/* Return the microseconds until the transmission of a byte that is queued now begins; 0 if the UART
 * is idle. The core uses it for a frame's leading zero and for the sending stamp of a time reply.
 * At 921 600 baud each queued byte takes 10.85 us. */
uint32_t board_uart_wait_us(board_t *board);

/* CAN, sending only. For received frames, the interrupt calls firmware_can_received(). */

/* Pass a frame to the controller; return false if no mailbox is free (the core then tries again).
 * Frames must be sent in the order in which they are passed (bxCAN: TXFP in MCR). */
bool board_can_write(board_t *board, const sp_can_frame_t *frame);

/* State of the CAN bus; all 0 without a bus. The board must recover from bus-off by itself. */
typedef struct {
    uint8_t send_errors; /* CAN error counters: from 96 warning, from 128 error passive, above 255
                            bus-off */
    uint8_t receive_errors;
    bool off;      /* bus-off now */
    uint16_t offs; /* number of bus-off events since boot; wraps */
} board_can_health_t;
void board_can_health(board_t *board, board_can_health_t *out);

/* ---- motors --------------------------------------------------------------------------------- */

#define BOARD_DUTY_ONE 10000

/* Set the duties of the left and right motor, -BOARD_DUTY_ONE .. BOARD_DUTY_ONE, forward positive.
 * 0 brakes (both ends of the motor connected). The duties are valid until the next call. */
void board_motors(board_t *board, int16_t left, int16_t right);

/* Enable or disable both motor bridges (EN pins). If disabled, both ends of each motor are open for
 * any duty. The bridges are disabled after board_start(). Called in each control period. */
void board_drivers(board_t *board, bool enabled);

/* ---- sensors -------------------------------------------------------------------------------- */

/* Each function returns its newest reading without waiting, with the time of the measurement. The
 * board samples independently of these calls: the IMU when its data is ready, the echo with a timer
 * capture. */

/* Encoder counts of both wheels after x4 decoding. They increase in forward motion, wrap, and may
 * have any value at boot. Read in each control period. */
typedef struct {
    uint16_t left;
    uint16_t right;
    uint32_t sampled_us;
} board_encoders_t;
void board_encoders(board_t *board, board_encoders_t *out);

/* Scale of the IMU's counts: counts per g, per deg/s and per kelvin, and the temperature at a count
 * of 0. The default is an MPU6050 at +-2 g and +-250 deg/s. A board with another chip or range must
 * define its own scale. */
#ifndef BOARD_IMU_PER_G
#define BOARD_IMU_PER_G 16384.0f
#endif
#ifndef BOARD_IMU_PER_DEG_S
#define BOARD_IMU_PER_DEG_S 131.0f
#endif
#ifndef BOARD_IMU_PER_K
#define BOARD_IMU_PER_K 340.0f
#endif
#ifndef BOARD_IMU_ZERO_DEG_C
#define BOARD_IMU_ZERO_DEG_C 36.53f
#endif

/* Counts of the IMU, sampled at 100 Hz or faster with a filter bandwidth of at most 44 Hz; x
 * forward, y left, z up. Read in each control period. */
typedef struct {
    int16_t accel_x, accel_y, accel_z;
    int16_t temperature;
    int16_t gyro_x, gyro_y, gyro_z;
    uint32_t sampled_us;
} board_imu_t;
void board_imu(board_t *board, board_imu_t *out);

#define BOARD_NO_RANGE 0xFFFFu

/* Ranges, measured from the sensors' faces; read at 20 Hz. A read may start the next measurement.
 * The ultrasonic sensor has its own measurement cycle, so its range has a separate time: the time
 * of the pulse. */
typedef struct {
    uint16_t ultrasonic_mm;      /* BOARD_NO_RANGE: no echo */
    uint16_t infrared_left_dmm;  /* tenths of a millimetre; BOARD_NO_RANGE: out of range */
    uint16_t infrared_right_dmm; /* tenths of a millimetre; BOARD_NO_RANGE: out of range */
    uint32_t sampled_us;         /* time of both infrared ranges */
    uint32_t ultrasonic_us;      /* time of the ultrasonic pulse for this range, or without an echo
                                    */
} board_ranges_t;
void board_ranges(board_t *board, board_ranges_t *out);

/* Return the present state of bumper switches and cliff sensor as SP_CONTACT_*; read in each
 * control period. */
uint8_t board_contacts(board_t *board);

/* Supply voltages and absolute motor currents; read at 5 Hz. */
typedef struct {
    uint16_t battery_mv;
    uint16_t logic_mv;
    uint16_t motor_left_ma;
    uint16_t motor_right_ma;
    uint32_t sampled_us;
} board_power_t;
void board_power(board_t *board, board_power_t *out);

/* ---- two pages of flash --------------------------------------------------------------------- */

/* The core stores the parameters in two pages, so that after a loss of supply either the old or the
 * new parameters are complete (flash_store.c). Erasing and writing run in the background, or
 * board_flash_busy() continues them. They must not block the control loop. */
#define BOARD_FLASH_PAGES 2u
#define BOARD_FLASH_PAGE_SIZE 1024u /* used part of each page; the sector may be larger */

/* Return the memory-mapped page; erased bytes read as 0xFF. The page is not valid while the flash
 * is busy. */
const uint8_t *board_flash_page(board_t *board, unsigned page);
/* Start to erase a page. */
void board_flash_erase(board_t *board, unsigned page);
/* Start to write erased words. Offset and length are multiples of 4. The data stays valid until the
 * write is complete. */
void board_flash_write(board_t *board, unsigned page, size_t offset, const uint8_t *data, size_t length);
/* Return whether erasing or writing is in progress. Called once per control period until it is
 * complete. */
bool board_flash_busy(board_t *board);

#endif
