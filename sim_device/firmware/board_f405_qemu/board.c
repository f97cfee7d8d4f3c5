/* Board functions for the STM32F405 that QEMU 7.2 emulates (machine netduinoplus2). QEMU emulates
 * some of the chip's peripherals: USART1 is the link to the host, USART2 the link to the plant,
 * TIM2 counts microseconds, SysTick counts milliseconds. QEMU does not emulate unique id, random
 * numbers, reset causes, watchdog, flash, DMA and CAN. The link to the plant or this file replaces
 * them, except for CAN. */
#include <string.h>

#include "board.h"
#include "cortex_m4.h"
#include "firmware.h"
#include "plant_link.h"
#include "startup.h"
#include "stm32f4.h"

#define CORE_HZ 168000000u
#define PERIOD_US 10000u
/* Time from a request for readings to the control period that uses them. The request is sent two
 * milliseconds after the previous period, which has set the duties. The duties do not change until
 * the next period, so the plant can advance to it at once. The readings are then exact for the
 * start of that period, and a busy computer has 8 ms to deliver them. */
#define LEAD_US 8000u
#define WATCHDOG_MS 100u
#define BOOT_AGAIN_US 50000u
/* Typical time to erase a sector with 32-bit parallelism (STM32F42x data sheet, flash programming).
 */
#define ERASE_US 250000u
#define WRITE_WORD_US 16u

static firmware_t *device;         /* gets the data from the interrupts */
static volatile uint32_t unfed_ms; /* ms in which the program ran but did not feed the watchdog */
static uint32_t asked_for_us;      /* control period of the last request for readings */
static int16_t duty_left, duty_right;
static bool drivers_on;
static uint32_t slept_us;
static uint32_t flash_began_us, flash_takes_us;

void usart1_handler(void);
void usart2_handler(void);
void systick_handler(void);

/* ---- time ----------------------------------------------------------------------------------- */

uint32_t board_now_us(board_t *board) { return uptime_us(); }

uint32_t board_busy_us(board_t *board) { return uptime_us() - slept_us; }

void board_idle(void) {
    while (plant_hang) { /* requested by a fault: hang until the watchdog resets the chip */
    }
    if (plant_crash) {
        __asm volatile("udf #0"); /* requested by a fault: an invalid instruction */
    }
    const uint32_t state = irq_save(); /* the time of the interrupt is not sleep time */
    const uint32_t from_us = uptime_us();
    wait_for_interrupt();
    slept_us += uptime_us() - from_us;
    irq_restore(state);
}

static void request(uint32_t now_us, uint32_t sample_us) {
    uint8_t payload[19];
    const size_t unused = startup_stack_free();
    uint8_t *end = put_u32(put_u32(put_u32(payload, now_us), sample_us), plant_newest_us());
    end = put_u16(put_u16(end, (uint16_t)duty_left), (uint16_t)duty_right);
    end = put_u16(end, unused > 0xFFFFu ? 0xFFFFu : (uint16_t)unused);
    *end = drivers_on;
    plant_send(PLANT_REQUEST, payload, sizeof payload);
}

static void reset_for(uint8_t cause) {
    plant_send(PLANT_RESET, &cause, 1);
    system_reset();
}

/* Called each millisecond. The watchdog counts only SysTick interrupts. On a busy computer the
 * emulator loses SysTicks; otherwise the watchdog would then reset a program that has not hung.
 * Requests for readings continue while the program hangs, because the plant continues. */
void systick_handler(void) {
    if (!plant_known) {
        return;
    }
    if (++unfed_ms > WATCHDOG_MS) {
        reset_for(SP_RESET_CAUSE_WATCHDOG);
    }
    const uint32_t now_us = uptime_us();
    /* Computed from differences, so that a wrap of the counter does not change the periods. */
    const uint32_t periods = (now_us + LEAD_US - asked_for_us) / PERIOD_US;
    if (periods != 0) {
        asked_for_us += periods * PERIOD_US;
        request(now_us, asked_for_us);
    }
}

void board_watchdog_feed(board_t *board) { unfed_ms = 0; }

void board_reboot(board_t *board) { reset_for(SP_RESET_CAUSE_SOFTWARE); }

/* ---- start ---------------------------------------------------------------------------------- */

static void uart_start(usart_regs_t *uart, unsigned irq) {
    uart->brr = 84000000u / 921600u; /* without effect in the emulator */
    uart->cr1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE | USART_CR1_RXNEIE;
    nvic_enable(irq, 4);
}

void board_start(firmware_t *firmware) {
    device = firmware;
    RCC->apb1enr |= RCC_APB1_TIM2 | RCC_APB1_USART2;
    RCC->apb2enr |= RCC_APB2_USART1;
    TIM2->psc = 999u; /* QEMU clocks its timers with 1 GHz, the chip with 84 MHz */
    TIM2->arr = 0xFFFFFFFFu;
    TIM2->egr = TIM_EGR_UG;
    TIM2->cr1 = TIM_CR1_CEN;
    plant_begin();
    plant_identity.capabilities = SP_CAPABILITY_ENCODERS | SP_CAPABILITY_IMU |
                                  SP_CAPABILITY_ULTRASONIC | SP_CAPABILITY_INFRARED |
                                  SP_CAPABILITY_BUMPER | SP_CAPABILITY_CLIFF;
    plant_identity.name = "firmware on an emulated STM32F405";
    uart_start(USART1, IRQ_USART1);
    uart_start(USART2, IRQ_USART2);
    SCB->shpr[SCB_SHPR_SYSTICK] = PRIORITY(8);
    SYSTICK->load = CORE_HZ / 1000u - 1u;
    SYSTICK->val = 0;
    SYSTICK->ctrl = SYSTICK_CLKSOURCE | SYSTICK_TICKINT | SYSTICK_ENABLE;
    const uint8_t version = PLANT_LINK_VERSION;
    uint32_t asked_us = uptime_us();
    plant_send(PLANT_BOOT, &version, 1);
    const board_crash_t *const crash = startup_take_crash();
    while (!plant_known) {
        wait_for_interrupt();
        if (uptime_us() - asked_us > BOOT_AGAIN_US) {
            asked_us = uptime_us();
            plant_send(PLANT_BOOT, &version, 1);
        }
    }
    if (crash != NULL) { /* the emulator has detected a reset without a message */
        plant_identity.crash = crash;
        plant_identity.reset_cause = SP_RESET_CAUSE_CRASH;
    }
    /* Wait for the first readings, because the checks need valid readings. */
    for (plant_readings_t now = {0}; now.power.sampled_us == 0; plant_readings(&now)) {
        unfed_ms = 0;
        wait_for_interrupt();
    }
    unfed_ms = 0;
}

const board_identity_t *board_identity(board_t *board) { return &plant_identity; }

/* ---- the line to the host ------------------------------------------------------------------- */

void usart1_handler(void) {
    while ((USART1->sr & USART_SR_RXNE) != 0) {
        const uint8_t byte = (uint8_t)USART1->dr;
        firmware_uart_received(device, &byte, 1, uptime_us());
    }
}

void usart2_handler(void) {
    while ((USART2->sr & USART_SR_RXNE) != 0) {
        plant_received((uint8_t)USART2->dr);
    }
}

/* QEMU sends each byte at once; the emulator (sim_device/line/line.py) models the link's timing. */
size_t board_uart_room(board_t *board) { return 512; }

void board_uart_write(board_t *board, const uint8_t *data, size_t length) {
    for (size_t i = 0; i < length; i++) {
        while ((USART1->sr & USART_SR_TXE) == 0) {
        }
        USART1->dr = data[i];
    }
}

uint32_t board_uart_wait_us(board_t *board) { return 0; }

/* QEMU's F405 has no CAN. identity.can is false, so the core does not use CAN. */
void board_can_health(board_t *board, board_can_health_t *out) {
    memset(out, 0, sizeof *out);
}

bool board_can_write(board_t *board, const sp_can_frame_t *frame) {
    (void)frame;
    return true;
}

/* ---- motors and sensors --------------------------------------------------------------------- */

static void send_motors(void) {
    uint8_t payload[9];
    uint8_t *end = put_u32(payload, uptime_us());
    end = put_u16(put_u16(end, (uint16_t)duty_left), (uint16_t)duty_right);
    *end = drivers_on;
    plant_send(PLANT_MOTORS, payload, sizeof payload);
}

void board_motors(board_t *board, int16_t left, int16_t right) {
    if (left != duty_left || right != duty_right) {
        duty_left = left;
        duty_right = right;
        send_motors();
    }
}

void board_drivers(board_t *board, bool enabled) {
    if (enabled != drivers_on) {
        drivers_on = enabled;
        send_motors();
    }
}

void board_encoders(board_t *board, board_encoders_t *out) {
    plant_readings_t now;
    plant_readings(&now);
    *out = now.encoders;
}

void board_imu(board_t *board, board_imu_t *out) {
    plant_readings_t now;
    plant_readings(&now);
    *out = now.imu;
}

void board_ranges(board_t *board, board_ranges_t *out) {
    plant_readings_t now;
    plant_readings(&now);
    *out = now.ranges;
}

uint8_t board_contacts(board_t *board) {
    plant_readings_t now;
    plant_readings(&now);
    return now.contacts;
}

void board_power(board_t *board, board_power_t *out) {
    plant_readings_t now;
    plant_readings(&now);
    *out = now.power;
}

/* ---- flash: a copy here, the pages themselves at the other end ------------------------------ */

const uint8_t *board_flash_page(board_t *board, unsigned page) { return plant_pages[page]; }

static void flash_takes(uint32_t duration_us) {
    flash_began_us = uptime_us();
    flash_takes_us = duration_us;
}

void board_flash_erase(board_t *board, unsigned page) {
    const uint8_t number = (uint8_t)page;
    memset(plant_pages[page], 0xFF, BOARD_FLASH_PAGE_SIZE);
    plant_send(PLANT_ERASE, &number, 1);
    flash_takes(ERASE_US);
}

static void write_chunk(unsigned page, size_t offset, const uint8_t *data, size_t length) {
    uint8_t payload[3u + PLANT_CHUNK];
    uint8_t *const to = &plant_pages[page][offset];
    for (size_t i = 0; i < length; i++) {
        to[i] &= data[i]; /* as in real flash, a write only clears bits */
    }
    payload[0] = (uint8_t)page;
    memcpy(put_u16(payload + 1, (uint16_t)offset), to, length);
    plant_send(PLANT_WRITE, payload, 3u + length);
}

void board_flash_write(board_t *board, unsigned page, size_t offset, const uint8_t *data, size_t length) {
    flash_takes(WRITE_WORD_US * (uint32_t)(length / 4u));
    while (length > PLANT_CHUNK) {
        write_chunk(page, offset, data, PLANT_CHUNK);
        offset += PLANT_CHUNK;
        data += PLANT_CHUNK;
        length -= PLANT_CHUNK;
    }
    write_chunk(page, offset, data, length);
}

bool board_flash_busy(board_t *board) {
    if (flash_takes_us != 0 && uptime_us() - flash_began_us >= flash_takes_us) {
        flash_takes_us = 0;
    }
    return flash_takes_us != 0;
}
