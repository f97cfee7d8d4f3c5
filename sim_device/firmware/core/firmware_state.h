/* The complete state of the firmware in one struct, for the files of the core and for tests. */
#ifndef FIRMWARE_STATE_H
#define FIRMWARE_STATE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware.h"

#include "command_log.h"
#include "control.h"
#include "flash_store.h"
#include "freshness.h"
#include "line.h"
#include "parameters.h"
#include "payloads.h"
#include "readings.h"
#include "schedule.h"

#define FIRMWARE_VERSION_MAJOR 0
#define FIRMWARE_VERSION_MINOR 2
#define FIRMWARE_VERSION_PATCH 0

struct firmware {
    board_t *board;
    int64_t now_us; /* uptime */
    int64_t due_us; /* time of the next control period */
    uint32_t tick;  /* number of the period */
    uint32_t ticks; /* number of periods since the last executed period; more than 1 if some were
                       missed */
    bool ticked;    /* a period has been executed */

    line_t line;
    payloads_t payloads;
    schedule_t schedule;
    command_log_t commands;
    parameters_t parameters;
    control_t control;
    readings_t readings;

    bool off_bus; /* on CAN without a crystal: it neither receives nor sends */

    /* ---- session -------------------------------------------------------------------------------- */
    uint32_t session_id; /* 0: no session */
    bool negotiated;
    bool status_wanted; /* a STOP_ALL has arrived: send the status in the next period */
    int64_t received_us; /* arrival of the host's last valid frame */
    bool unknown_hello;
    int64_t unknown_hello_us; /* time of the last hello to a host with an unknown session */
    freshness_t freshness;

    /* ---- parameters being saved ----------------------------------------------------------------- */
    flash_store_t flash;
    stored_t saving[FLASH_VALUES];
    reply_t save_reply; /* sent after the save */

    /* ---- an accepted reboot --------------------------------------------------------------------- */
    bool reboot_wanted;
    bool factory_reset;

    /* ---- telemetry ------------------------------------------------------------------------------ */
    uint16_t stale; /* number of rejected setpoints */
    uint8_t load_percent;
    uint32_t load_busy_us; /* last measurement */
    int64_t load_at_us;
    bool imu_sent;
    uint32_t imu_sent_us; /* stamp of the newest sample that was sent */

    /* Must be the last field. A boot zeroes all fields above. It only empties the inbox, because
     * interrupts may write to the inbox at any time. */
    inbox_t inbox;
};

#endif
