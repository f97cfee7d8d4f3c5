/* The functions that the firmware's core needs of a board, and nothing else: the core includes no
 * vendor header and knows no register. A board is one folder (board_host, board_f429,
 * board_f405_qemu, yours) that defines every function here. Its interrupts call the functions of
 * firmware.h that are marked for interrupts.
 *
 * All functions are called from the main loop, never from an interrupt. None of them waits, except
 * board_idle() and board_reboot(). Each gets the board that firmware_boot() was given: a program
 * with one device passes NULL, and its functions ignore it; a program with several devices passes
 * each its own. Times come from one free-running microsecond counter that begins near 0 at boot and
 * wraps at 32 bits.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

typedef struct board board_t;       /* defined by a board that needs one */
typedef struct firmware firmware_t; /* the state of one device: firmware_state.h */

/* ---- the chip ------------------------------------------------------------------------------- */

/* Start clocks, pins, timers and interrupts; motors off. main() calls it once, first of all.
 * `firmware` takes the data that interrupts receive. A board that gets its identity from outside
 * (the emulated one) waits for it here. */
void board_start(firmware_t *firmware);

/* Microseconds since boot; wraps. */
uint32_t board_now_us(board_t *board);

/* Microseconds since boot in which the processor did not sleep in board_idle(); wraps. */
uint32_t board_busy_us(board_t *board);

/* Sleep until the next interrupt, at most a millisecond. Called by main(). */
void board_idle(void);

/* Feed the watchdog: after 100 ms without it the chip resets. Called once a control period. */
void board_watchdog_feed(board_t *board);

/* Reset the chip with cause "software"; the queued bytes have left. It does not return on a chip.
 * The host's board returns: its test then calls firmware_boot(). */
void board_reboot(board_t *board);

/* ---- identity, constant from board_start() on ----------------------------------------------- */

/* No crystal and no external clock: the chip runs from its own oscillator, accurate to 1 %, and CAN
 * is off. */
#define BOARD_TROUBLE_CLOCK 1u
/* Nothing can be saved. */
#define BOARD_TROUBLE_FLASH 2u
/* The UART leads to a network: its host need not stand beside the robot, so no key can be set. */
#define BOARD_TROUBLE_REMOTE 4u

/* Record that a fault handler keeps in memory across a reset. */
typedef struct {
    uint32_t pc;   /* the instruction that faulted */
    uint32_t lr;   /* return address of its function */
    uint32_t cfsr; /* kind of fault: PM0214, section 4.4.10 */
    uint32_t uptime_us;
} board_crash_t;

typedef struct {
    uint8_t uid[12];     /* the chip's 96-bit unique id */
    uint32_t boot_id;    /* random, new at each boot, not 0 */
    uint8_t reset_cause; /* SP_RESET_CAUSE_* */
    uint8_t node;        /* 1..15, by a jumper or a constant */
    bool can;            /* the host is on the CAN bus, not on the UART */
    uint16_t capabilities; /* SP_CAPABILITY_*: connected parts */
    uint8_t troubles;      /* BOARD_TROUBLE_*, found at the start */
    const board_crash_t *crash; /* of the previous boot, with reset cause "crash"; else NULL */
    const char *name;    /* of board and firmware, as the host shows it; ASCII, at most 60 B */
} board_identity_t;

const board_identity_t *board_identity(board_t *board);

/* ---- the line to the host ------------------------------------------------------------------- */

/* UART. Receiving: from the interrupt, by firmware_uart_received() in firmware.h. */

/* Number of bytes that can be queued now. The queue should hold at least 512: a frame has up to
 * 256. */
size_t board_uart_room(board_t *board);

/* Queue a frame, or most of one; never called with more bytes than there is room for. */
void board_uart_write(board_t *board, const uint8_t *data, size_t length);

/* Microseconds until a byte queued now would begin to leave; 0 on an idle line. The core uses it
 * for a frame's leading zero and for the sending stamp of a time reply. At 921 600 baud a waiting
 * byte is 10.85 us. */
uint32_t board_uart_wait_us(board_t *board);

/* CAN. Receiving: from the interrupt, by firmware_can_received(). */

/* Pass a frame to the controller; false if no mailbox is free (the core then tries again). Frames
 * leave in the order in which they were passed (bxCAN: TXFP in MCR). */
bool board_can_write(board_t *board, const sp_can_frame_t *frame);

/* State of the bus; all 0 without one. The board recovers from bus-off by itself. */
typedef struct {
    uint8_t send_errors; /* the protocol's error counters: 96 warn, 128 passive, 255 and more bus-off */
    uint8_t receive_errors;
    bool off;      /* bus-off now */
    uint16_t offs; /* number of bus-offs since boot; wraps */
} board_can_health_t;
void board_can_health(board_t *board, board_can_health_t *out);

/* ---- motors --------------------------------------------------------------------------------- */

#define BOARD_DUTY_ONE 10000

/* Set the duty of left and right, -BOARD_DUTY_ONE .. BOARD_DUTY_ONE, forward positive; 0 brakes
 * (both ends of the motor connected). It holds until the next call. */
void board_motors(board_t *board, int16_t left, int16_t right);

/* Enable or disable both bridges (EN pins). Disabled, both ends of each motor are open, whatever
 * the duties are. Disabled from board_start() on; called each control period. */
void board_drivers(board_t *board, bool enabled);

/* ---- sensors -------------------------------------------------------------------------------- */

/* Each function returns its newest reading at once, with the time of the measurement. The board
 * samples by itself: the IMU when its data is ready, the echo by a timer's capture. */

/* Counts after x4 of both wheels, rising forward, with any value at boot; they wrap. Read each
 * control period. */
typedef struct {
    uint16_t left;
    uint16_t right;
    uint32_t sampled_us;
} board_encoders_t;
void board_encoders(board_t *board, board_encoders_t *out);

/* Scale of the IMU's counts as the board configures its chip: counts per g, per degree a second and
 * per kelvin, and the temperature at a count of 0. A board with another chip or another range
 * defines its own. By default an MPU6050 at +-2 g and +-250 deg/s. */
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

/* Counts of the IMU, 100 Hz or faster, 44 Hz filter or narrower; x forward, y left, z up. Read each
 * control period. */
typedef struct {
    int16_t accel_x, accel_y, accel_z;
    int16_t temperature;
    int16_t gyro_x, gyro_y, gyro_z;
    uint32_t sampled_us;
} board_imu_t;
void board_imu(board_t *board, board_imu_t *out);

#define BOARD_NO_RANGE 0xFFFFu

/* Ranges from the sensors' faces; read at 20 Hz. A read may start the next measurement. The ultrasonic
 * sensor measures at its own pace, so its range has its own time: that of the pulse. */
typedef struct {
    uint16_t ultrasonic_mm;      /* BOARD_NO_RANGE: no echo */
    uint16_t infrared_left_dmm;  /* tenths of a millimetre; BOARD_NO_RANGE: out of range */
    uint16_t infrared_right_dmm; /* likewise */
    uint32_t sampled_us;         /* of both infrared ranges */
    uint32_t ultrasonic_us;      /* when the pulse left that gave the range, or that had no echo */
} board_ranges_t;
void board_ranges(board_t *board, board_ranges_t *out);

/* SP_CONTACT_*: present state of bumper switches and cliff sensor; read each control period. */
uint8_t board_contacts(board_t *board);

/* Supply; read at 5 Hz. Currents are magnitudes. */
typedef struct {
    uint16_t battery_mv;
    uint16_t logic_mv;
    uint16_t motor_left_ma;
    uint16_t motor_right_ma;
    uint32_t sampled_us;
} board_power_t;
void board_power(board_t *board, board_power_t *out);

/* ---- two pages of flash --------------------------------------------------------------------- */

/* The core keeps the parameters in them, so that after a loss of supply either the old or the new
 * ones are complete (flash_store.c). Erasing and writing run by themselves, or board_flash_busy()
 * continues them; the control loop must not stop for them. */
#define BOARD_FLASH_PAGES 2u
#define BOARD_FLASH_PAGE_SIZE 1024u /* used part of each page; the sector may be larger */

/* Return the memory-mapped page; erased bytes read 0xFF. Not valid while busy. */
const uint8_t *board_flash_page(board_t *board, unsigned page);
/* Begin to erase a page. */
void board_flash_erase(board_t *board, unsigned page);
/* Begin to write words that were erased. Offset and length are multiples of 4; the data must stay
 * valid until the write is done. */
void board_flash_write(board_t *board, unsigned page, size_t offset, const uint8_t *data, size_t length);
/* Return whether erasing or writing is in progress; called once a control period meanwhile. */
bool board_flash_busy(board_t *board);

#endif
