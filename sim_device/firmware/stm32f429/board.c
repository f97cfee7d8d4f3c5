/* Start, sleep and reset of a board with an STM32F429. */
#include "board.h"

#include "cortex_m4.h"
#include "f429.h"
#include "startup.h"
#include "stm32f4.h"

#define DRAIN_US 50000u /* a full queue at 921 600 baud takes 11 ms */
/* Watchdog timeout (21.3, table 107): 800 counts at 32 kHz / 4 are 0.1 s; 0.07 to 0.19 s with the
 * tolerance of the LSI oscillator. */
#define WATCHDOG_COUNTS 800u

void systick_handler(void);

firmware_t *device;

static board_identity_t identity;
static uint32_t slept_us;

#define UNUSABLE PORT_A, 12

/* Start the watchdog. It stops while a debugger has halted the program (38.16.4), and the motors
 * then keep their last duty. So debug with the wheels off the floor. */
static void watchdog_start(void) {
    DBGMCU_APB1_FZ |= DBGMCU_APB1_FZ_IWDG;
    IWDG->kr = IWDG_KEY_START;
    IWDG->kr = IWDG_KEY_WRITE;
    IWDG->pr = 0;
    IWDG->rlr = WATCHDOG_COUNTS;
    IWDG->kr = IWDG_KEY_FEED;
}

void board_start(firmware_t *firmware) {
    device = firmware;
    const bool precise = clocks_start();
    motors_start(); /* first, so that the bridges' inputs are low */
    /* ES0206, "PA12 GPIO limitation" (revisions before 3): a signal at PA12 can corrupt data that
     * is read from flash. So the pin is an output and low, and nothing may be connected to it. */
    pin_write(UNUSABLE, false);
    pin_output(UNUSABLE);
    identity.reset_cause = reset_cause();
    identity.crash = startup_take_crash();
    if (identity.reset_cause != SP_RESET_CAUSE_SOFTWARE) {
        identity.crash = NULL; /* the record is older: a later reset had another cause */
    } else if (identity.crash != NULL) {
        identity.reset_cause = SP_RESET_CAUSE_CRASH;
    }
    for (unsigned i = 0; i < sizeof identity.uid; i++) {
        identity.uid[i] = (uint8_t)(DEVICE_UID[i / 4u] >> (8u * (i % 4u)));
    }
    identity.boot_id = boot_id(identity.uid);
    identity.node = BOARD_NODE;
    identity.name = BOARD_NAME;
    identity.capabilities = BOARD_CAPABILITIES;
    identity.troubles = (uint8_t)((precise ? 0u : BOARD_TROUBLE_CLOCK) |
                                  (flash_can_save() ? 0u : BOARD_TROUBLE_FLASH));
    pin_input(CAN_SELECT, PULL_UP);
    encoders_start();
    imu_start();
    sonar_start();
    analog_start();
    /* With an inaccurate clock (1 %) the chip would disturb the bus, so CAN stays off. */
    identity.can = precise && !pin_read(CAN_SELECT);
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
    imu_millisecond();
    analog_millisecond();
    sonar_millisecond();
    uart_clear_overrun();
}

uint32_t board_now_us(board_t *board) { return uptime_us(); }

uint32_t board_busy_us(board_t *board) { return uptime_us() - slept_us; }

/* Sleep with interrupts masked. An interrupt ends the sleep and its handler runs afterwards (PM0214
 * 2.5.2), so the handler's time does not count as sleep. */
void board_idle(void) {
    const uint32_t state = irq_save();
    const uint32_t from_us = uptime_us();
    wait_for_interrupt();
    slept_us += uptime_us() - from_us;
    irq_restore(state);
}

void board_watchdog_feed(board_t *board) { IWDG->kr = IWDG_KEY_FEED; }

void board_reboot(board_t *board) {
    board_motors(board, 0, 0);
    board_watchdog_feed(board);
    const uint32_t from_us = uptime_us();
    while (!(identity.can ? can_drained() : uart_drained()) && uptime_us() - from_us < DRAIN_US) {
    }
    system_reset();
}
