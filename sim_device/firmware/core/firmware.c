#include <stddef.h>
#include <string.h>

#include "clock.h"
#include "commands.h"
#include "firmware_state.h"
#include "period.h"
#include "session.h"
#include "telemetry.h"

/* Periods and phases of the supply (5 Hz) and range (20 Hz) measurements. The phase is the phase of
 * the stream at the default rate. An echo has decayed after 38 ms, before the next range
 * measurement. */
#define POWER_PERIODS 20u
#define POWER_PHASE ((uint32_t)STREAM_POWER % POWER_PERIODS)
#define RANGE_PERIODS 5u
#define RANGE_PHASE ((uint32_t)STREAM_RANGE % RANGE_PERIODS)
#define LOAD_PERIODS 10u
/* Maximum number of frames that one poll processes. A control period that becomes due in a flood of
 * frames then waits for at most this number of frames. */
#define FRAMES_PER_POLL 16u

void firmware_uart_received(
    firmware_t *firmware, const uint8_t *data, size_t length, uint32_t arrived_us)
{
    inbox_put_bytes(&firmware->inbox, data, length, arrived_us);
}

void firmware_can_received(
    firmware_t *firmware, const sp_can_frame_t *frame, uint32_t arrived_us)
{
    inbox_put_frame(&firmware->inbox, frame, arrived_us);
}

void firmware_can_lost(firmware_t *firmware)
{
    inbox_drop(&firmware->inbox, 1);
}

void firmware_boot(firmware_t *firmware, board_t *board)
{
    const board_identity_t *const identity = board_identity(board);
    stored_t stored[FLASH_VALUES];
    memset(firmware, 0, offsetof(firmware_t, inbox));
    inbox_clear(&firmware->inbox);
    firmware->board = board;
    firmware->now_us = firmware->due_us = (int64_t)board_now_us(firmware->board);
    firmware->load_at_us = firmware->now_us;
    firmware->load_busy_us = board_busy_us(board);
    flash_store_load(board, stored);
    parameters_start(&firmware->parameters, identity->node, stored);
    control_start(&firmware->control, &firmware->parameters);
    readings_start(&firmware->readings, board, &firmware->parameters);
    line_start(&firmware->line, board, identity->node, identity->can);
    commands_use_key(firmware, stored);
    schedule_reset(&firmware->schedule);
    if (identity->troubles & BOARD_TROUBLE_CLOCK) {
        firmware->control.health.bits = SP_FAULT_CLOCK;
        firmware->off_bus = identity->can;
    }
    board_motors(firmware->board, 0, 0);
    board_drivers(firmware->board, false);
}

/* ---- the control period --------------------------------------------------------------------- */

static void read_power(firmware_t *firmware)
{
    board_power_t power;
    board_power(firmware->board, &power);
    control_power(&firmware->control, &power);
}

static void continue_save(firmware_t *firmware)
{
    const flash_result_t result = flash_store_step(&firmware->flash, firmware->board);
    if (result != FLASH_NOTHING) {
        commands_saved(firmware, result == FLASH_SAVED);
    }
}

/* `stopped`: a STOP_ALL has arrived, so the status is sent in this period. */
static void send_telemetry(firmware_t *firmware, bool stopped)
{
    for (unsigned i = 0; i < STREAMS; i++) {
        if ((i == STREAM_STATUS && stopped)
            || schedule_due(&firmware->schedule, (stream_t)i, firmware->tick, firmware->ticks)) {
            telemetry_send(firmware, (stream_t)i);
        }
    }
    if (due_every(PERIODS_PER_SECOND, 0, firmware->tick, firmware->ticks)) {
        session_imu_info(firmware, firmware->now_us);
    }
    const log_line_t *const line = log_take(&firmware->control.log, firmware->now_us);
    if (line != NULL) {
        const sp_log_text_t text = {line->level, line->text.bytes, line->text.length};
        line_stream(&firmware->line, SP_TYPE_LOG_TEXT, (uint32_t)firmware->now_us,
            sp_log_text_encode(&text, line_payload(&firmware->line), SP_PAYLOAD_MAX));
    }
}

static bool due(const firmware_t *firmware, uint32_t periods, uint32_t phase)
{
    return due_every(periods, phase, firmware->tick, firmware->ticks);
}

static void period(firmware_t *firmware)
{
    board_watchdog_feed(firmware->board);
    session_tick(firmware);
    readings_begin(&firmware->readings);
    const bool sounded = firmware->negotiated && due(firmware, RANGE_PERIODS, RANGE_PHASE);
    const motors_t motors = control_tick(&firmware->control, firmware->tick, firmware->ticks,
        firmware->now_us, &firmware->readings,
        sounded ? readings_around(&firmware->readings) : NULL);
    board_motors(firmware->board, motors.left, motors.right);
    board_drivers(firmware->board, motors.drivers);
    continue_save(firmware);
    /* The supply is measured even if no stream reports it. */
    if (due(firmware, POWER_PERIODS, POWER_PHASE)) {
        read_power(firmware);
        control_check_power(&firmware->control);
    } else if (schedule_due(&firmware->schedule, STREAM_POWER, firmware->tick, firmware->ticks)) {
        read_power(firmware);
    }
    if (due(firmware, LOAD_PERIODS, 0)) {
        telemetry_measure_load(firmware);
    }
    const bool stopped = firmware->status_wanted;
    firmware->status_wanted = false;
    if (firmware->negotiated) {
        send_telemetry(firmware, stopped);
        return;
    }
    if (stopped) {
        telemetry_send(firmware, STREAM_STATUS);
    }
    if (due(firmware, PERIODS_PER_SECOND, 0)) {
        session_hello(firmware, firmware->now_us);
    }
}

/* Missed control periods are not repeated, because their measurements would be late. Work that was
 * due in a missed period is done now. */
static void run_period_if_due(firmware_t *firmware)
{
    if (firmware->now_us < firmware->due_us) {
        return;
    }
    const uint32_t missed = (uint32_t)(firmware->now_us - firmware->due_us) / PERIOD_US;
    firmware->ticks = missed + 1u;
    firmware->tick += firmware->ticked ? firmware->ticks : missed;
    firmware->ticked = true;
    firmware->due_us += (int64_t)firmware->ticks * PERIOD_US;
    period(firmware);
}

/* ---- the loop ------------------------------------------------------------------------------- */

static void receive(firmware_t *firmware)
{
    sp_frame_t frame;
    uint32_t arrived_us;
    for (unsigned i = 0; i < FRAMES_PER_POLL
         && line_receive(&firmware->line, &firmware->inbox, &frame, &arrived_us); i++) {
        session_receive(firmware, &frame, extend_us(firmware->now_us, arrived_us));
    }
}

static void reboot_if_wanted(firmware_t *firmware)
{
    if (firmware->reboot_wanted && line_idle(&firmware->line)) { /* the acknowledgement has been
                                                                    sent */
        board_motors(firmware->board, 0, 0);
        board_drivers(firmware->board, false);
        if (firmware->factory_reset) {
            flash_store_erase(firmware->board);
        }
        firmware->reboot_wanted = false;
        board_reboot(firmware->board);
    }
}

void firmware_poll(firmware_t *firmware)
{
    firmware->now_us = extend_us(firmware->now_us, board_now_us(firmware->board));
    if (!firmware->off_bus) {
        receive(firmware);
    }
    run_period_if_due(firmware);
    if (!firmware->off_bus) {
        line_pump(&firmware->line);
    }
    reboot_if_wanted(firmware);
}
