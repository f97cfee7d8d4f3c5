#include "firmware.h"

#include <string.h>

#include "board.h"
#include "clock.h"
#include "commands.h"
#include "firmware_state.h"
#include "period.h"
#include "session.h"
#include "telemetry.h"

/* The supply is measured at 5 Hz and the rangers are sounded at 20 Hz, each with the phase of its
 * stream at its default rate: a loud echo is gone after 38 ms. */
#define POWER_PERIODS 20u
#define POWER_PHASE 5u
#define RANGE_PERIODS 5u
#define RANGE_PHASE 4u
#define LOAD_PERIODS 10u

static firmware_t device;
static inbox_t inbox; /* outside: interrupts write to it */

const firmware_t *firmware_state(void)
{
    return &device;
}

void firmware_uart_received(const uint8_t *data, size_t length, uint32_t arrived_us)
{
    inbox_put_bytes(&inbox, data, length, arrived_us);
}

void firmware_can_received(const sp_can_frame_t *frame, uint32_t arrived_us)
{
    inbox_put_frame(&inbox, frame, arrived_us);
}

void firmware_boot(void)
{
    const board_identity_t *const identity = board_identity();
    stored_t stored[PARAMETERS];
    memset(&device, 0, sizeof device);
    inbox_clear(&inbox);
    device.now_us = device.due_us = (int64_t)board_now_us();
    device.load_at_us = device.now_us;
    device.load_busy_us = board_busy_us();
    flash_store_load(stored);
    parameters_start(&device.parameters, identity->node, stored);
    control_start(&device.control, &device.parameters);
    readings_start(&device.readings, &device.parameters);
    line_start(&device.line, identity->node, identity->can);
    schedule_reset(&device.schedule);
    board_motors(0, 0);
}

/* ---- the control period -------------------------------------------------------------------- */

static void read_power(void)
{
    board_power_t power;
    board_power(&power);
    control_power(&device.control, &power);
}

static void carry_on_saving(void)
{
    if (flash_store_step(&device.flash)) {
        parameters_saved(&device.parameters, device.saving);
        log_add(&device.control.log, SP_LOG_LEVEL_INFO, "parameters saved");
        commands_answer(&device, &device.save_reply, device.now_us);
    }
}

static void tell(void)
{
    for (unsigned i = 0; i < STREAMS; i++) {
        if (schedule_due(&device.schedule, (stream_t)i, device.tick, device.ticks)) {
            telemetry_send(&device, (stream_t)i);
        }
    }
    const log_line_t *const line = log_take(&device.control.log, device.now_us);
    if (line != NULL) {
        const sp_log_text_t text = {line->level, line->text.bytes, line->text.length};
        line_send(&device.line, SP_TYPE_LOG_TEXT, (uint32_t)device.now_us,
            sp_log_text_encode(&text, line_payload(&device.line), SP_PAYLOAD_MAX));
    }
}

static bool due(uint32_t periods, uint32_t phase)
{
    return due_every(periods, phase, device.tick, device.ticks);
}

static void period(void)
{
    board_watchdog_feed();
    session_tick(&device);
    readings_begin(&device.readings);
    const bool sounded = device.agreed && due(RANGE_PERIODS, RANGE_PHASE);
    const motors_t motors = control_tick(&device.control, device.tick, device.now_us,
        &device.readings, sounded ? readings_around(&device.readings) : NULL);
    board_motors(motors.left, motors.right);
    carry_on_saving();
    /* The supply is looked after whether or not anybody is told. */
    if (due(POWER_PERIODS, POWER_PHASE)
        || schedule_due(&device.schedule, STREAM_POWER, device.tick, device.ticks)) {
        read_power();
    }
    if (due(LOAD_PERIODS, 0)) {
        telemetry_measure_load(&device);
    }
    if (device.agreed) {
        tell();
    } else if (due(PERIODS_PER_SECOND, 0)) {
        session_hello(&device, device.now_us);
    }
}

/* Periods that were missed are not made up for, what they would have measured being gone; but what
 * was due in one of them is due now. */
static void run_period_if_due(void)
{
    if (device.now_us < device.due_us) {
        return;
    }
    const uint32_t missed = (uint32_t)(device.now_us - device.due_us) / PERIOD_US;
    device.ticks = missed + 1u;
    device.tick += device.ticked ? device.ticks : missed;
    device.ticked = true;
    device.due_us += (int64_t)device.ticks * PERIOD_US;
    period();
}

/* ---- the loop ------------------------------------------------------------------------------ */

static void receive(void)
{
    sp_frame_t frame;
    uint32_t arrived_us;
    while (line_receive(&device.line, &inbox, &frame, &arrived_us)) {
        session_receive(&device, &frame, extend_us(device.now_us, arrived_us));
    }
}

static void reboot_if_wanted(void)
{
    if (device.reboot_wanted && line_idle(&device.line)) { /* its ack has left */
        board_motors(0, 0);
        if (device.factory_reset) {
            flash_store_erase();
        }
        device.reboot_wanted = false;
        board_reboot();
    }
}

void firmware_poll(void)
{
    device.now_us = extend_us(device.now_us, board_now_us());
    receive();
    run_period_if_due();
    line_pump(&device.line);
    reboot_if_wanted();
}
