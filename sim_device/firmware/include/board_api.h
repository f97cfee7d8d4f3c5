/* The functions of board.h as a table, and a firmware as a shared library.
 *
 * A program with one board links the functions of board.h directly. A program that runs several
 * devices, or that loads a firmware library, gives each device a table and a context instead
 * (board_library/board.c). The caller and the library are compiled separately, so each checks the
 * version and the sizes of the structures before the first call. */
#ifndef BOARD_API_H
#define BOARD_API_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board.h"
#include "firmware.h"

/* Version of the binary interface. It increases with each incompatible change of a structure or
 * function in this file, in board.h or in firmware.h. */
#define BOARD_API_VERSION 1u
#define BOARD_API_MAGIC 0x49504142u /* "BAPI" in memory */

#if defined(_WIN32)
#define BOARD_API_EXPORT __declspec(dllexport)
#else
#define BOARD_API_EXPORT __attribute__((visibility("default")))
#endif

/* Table of the functions of board.h, with the meaning described there. board_start() and
 * board_idle() are omitted, because the program that loads the library has the main loop. */
typedef struct {
    uint32_t (*now_us)(void *context);
    uint32_t (*busy_us)(void *context);
    void (*watchdog_feed)(void *context);
    void (*reboot)(void *context); /* returns; the caller then boots the device again */
    const board_identity_t *(*identity)(void *context);
    size_t (*uart_room)(void *context);
    void (*uart_write)(void *context, const uint8_t *data, size_t length);
    uint32_t (*uart_wait_us)(void *context);
    bool (*can_write)(void *context, const sp_can_frame_t *frame);
    void (*can_health)(void *context, board_can_health_t *out);
    void (*motors)(void *context, int16_t left, int16_t right);
    void (*drivers)(void *context, bool enabled);
    void (*encoders)(void *context, board_encoders_t *out);
    void (*imu)(void *context, board_imu_t *out);
    void (*ranges)(void *context, board_ranges_t *out);
    uint8_t (*contacts)(void *context);
    void (*power)(void *context, board_power_t *out);
    const uint8_t *(*flash_page)(void *context, unsigned page);
    void (*flash_erase)(void *context, unsigned page);
    void (*flash_write)(
        void *context, unsigned page, size_t offset, const uint8_t *data, size_t length);
    bool (*flash_busy)(void *context);
} board_api_t;

/* A board of a library: the argument `board` of the functions of board.h. */
struct board {
    const board_api_t *api;
    void *context;
};

/* Present state of a device, for tests and displays. */
typedef struct {
    int64_t due_us;      /* uptime of the next control period */
    uint32_t session_id; /* 0: no session */
    uint16_t faults;     /* SP_FAULT_* */
    uint8_t state;       /* stopped, idle, velocity, bring-up, onboard, running, paused */
    uint8_t stop_cause;  /* SP_STOP_CAUSE_* */
    uint8_t negotiated;
    uint8_t keyed; /* it accepts only signed commands */
} firmware_view_t;

/* Number of structures that caller and library share; the array `sizes` has their sizes in
 * bytes. */
#define BOARD_API_SIZES 11u
#define BOARD_API_SIZES_NOW \
    { \
        (uint16_t)sizeof(board_api_t), (uint16_t)sizeof(struct board), \
            (uint16_t)sizeof(board_identity_t), (uint16_t)sizeof(board_crash_t), \
            (uint16_t)sizeof(sp_can_frame_t), (uint16_t)sizeof(board_can_health_t), \
            (uint16_t)sizeof(board_encoders_t), (uint16_t)sizeof(board_imu_t), \
            (uint16_t)sizeof(board_ranges_t), (uint16_t)sizeof(board_power_t), \
            (uint16_t)sizeof(firmware_view_t) \
    }

/* Description of a firmware library. The first four fields never change their place. */
typedef struct {
    uint32_t magic;   /* BOARD_API_MAGIC */
    uint32_t version; /* BOARD_API_VERSION */
    uint32_t size;    /* size of this structure */
    uint16_t sizes[BOARD_API_SIZES];

    size_t state_size; /* size of firmware_t, the memory of each device; it must be zero before the
                          first boot */
    float imu_per_g;   /* scale of the IMU's counts for which the firmware is built */
    float imu_per_deg_s;

    void (*boot)(firmware_t *firmware, board_t *board);
    void (*poll)(firmware_t *firmware);
    void (*uart_received)(
        firmware_t *firmware, const uint8_t *data, size_t length, uint32_t arrived_us);
    void (*can_received)(
        firmware_t *firmware, const sp_can_frame_t *frame, uint32_t arrived_us);
    void (*view)(const firmware_t *firmware, firmware_view_t *out);
} firmware_library_t;

/* Name of the only symbol that a library exports. */
#define FIRMWARE_LIBRARY_SYMBOL "sweepctl_firmware"
BOARD_API_EXPORT const firmware_library_t *sweepctl_firmware(void);

#endif
