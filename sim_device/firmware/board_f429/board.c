/* Start, sleep and end of the board with an STM32F429. */
#include "board.h"

#include "cortex_m4.h"
#include "f429.h"
#include "stm32f4.h"

#define DRAIN_US 50000u /* a full queue at 921 600 baud takes 11 ms */
/* 21.3, table 107: 32 kHz / 4, 800 counts: 0.1 s, by the LSI's tolerance 0.07 to 0.19 s. */
#define WATCHDOG_COUNTS 800u

void systick_handler(void);

firmware_t *device;

static board_identity_t identity;
static uint32_t slept_us;

static void watchdog_start(void) {
    IWDG->kr = IWDG_KEY_START;
    IWDG->kr = IWDG_KEY_WRITE;
    IWDG->pr = 0;
    IWDG->rlr = WATCHDOG_COUNTS;
    IWDG->kr = IWDG_KEY_FEED;
}

void board_start(firmware_t *firmware) {
    device = firmware;
    clocks_start();
    motors_start(); /* first of all: the bridges' inputs are low */
    identity.reset_cause = reset_cause();
    for (unsigned i = 0; i < sizeof identity.uid; i++) {
        identity.uid[i] = (uint8_t)(DEVICE_UID[i / 4u] >> (8u * (i % 4u)));
    }
    identity.boot_id = boot_id(identity.uid);
    identity.node = BOARD_NODE;
    identity.name = "firmware on an STM32F429";
    pin_input(PORT_G, 0, PULL_UP);
    encoders_start();
    imu_start();
    sonar_start();
    analog_start();
    identity.can = !pin_read(PORT_G, 0);
    if (identity.can) {
        can_start(identity.node);
    } else {
        uart_start();
    }
    SCB->shpr[SCB_SHPR_SYSTICK] = PRIORITY(LEVEL_TICK);
    SYSTICK->load = CORE_HZ / 1000u - 1u;
    SYSTICK->val = 0;
    SYSTICK->ctrl = SYSTICK_CLKSOURCE | SYSTICK_TICKINT | SYSTICK_ENABLE;
    watchdog_start();
}

const board_identity_t *board_identity(board_t *board) { return &identity; }

void systick_handler(void) {
    imu_millisecond(uptime_us());
    sonar_millisecond();
}

uint32_t board_now_us(board_t *board) { return uptime_us(); }

uint32_t board_busy_us(board_t *board) { return uptime_us() - slept_us; }

void board_idle(void) {
    const uint32_t from_us = uptime_us();
    wait_for_interrupt();
    slept_us += uptime_us() - from_us;
}

void board_watchdog_feed(board_t *board) { IWDG->kr = IWDG_KEY_FEED; }

void board_reboot(board_t *board) {
    board_motors(board, 0, 0);
    board_watchdog_feed(board);
    const uint32_t from_us = uptime_us();
    while (!identity.can && !uart_drained() && uptime_us() - from_us < DRAIN_US) {
    }
    system_reset();
}
