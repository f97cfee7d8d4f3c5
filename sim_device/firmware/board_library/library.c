/* The firmware as a shared library: sweepctl_firmware() returns the description of the firmware. */
#include "board_api.h"
#include "firmware_state.h"

static void view(const firmware_t *firmware, firmware_view_t *out)
{
    out->due_us = firmware->due_us;
    out->session_id = firmware->session_id;
    out->faults = control_faults(&firmware->control);
    out->state = (uint8_t)firmware->control.state;
    out->stop_cause = firmware->control.latch.cause;
    out->negotiated = firmware->negotiated;
    out->keyed = firmware->line.authentication.keyed;
}

const firmware_library_t *sweepctl_firmware(void)
{
    static const firmware_library_t library = {
        .magic = BOARD_API_MAGIC,
        .version = BOARD_API_VERSION,
        .size = sizeof(firmware_library_t),
        .sizes = BOARD_API_SIZES_NOW,
        .state_size = sizeof(firmware_t),
        .imu_per_g = BOARD_IMU_PER_G,
        .imu_per_deg_s = BOARD_IMU_PER_DEG_S,
        .boot = firmware_boot,
        .poll = firmware_poll,
        .uart_received = firmware_uart_received,
        .can_received = firmware_can_received,
        .view = view,
    };
    return &library;
}
