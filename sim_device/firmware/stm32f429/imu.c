/* Driver of the MPU6050 on I2C1 at 400 kHz. The interrupt of its data-ready pin stores the time of
 * a sample and starts the transfer of 14 bytes from register 0x3B. Interrupts and DMA do the
 * transfer; the program never waits for a bus that hangs. A transfer that is not complete after two
 * milliseconds is aborted, the bus is released, and the sensor is configured again. RM0090 section
 * 27 (I2C1_RX is DMA1 stream 0 channel 1, table 42); registers of the sensor: InvenSense
 * RM-MPU-6000A. */
#include "cortex_m4.h"
#include "f429.h"
#include "stm32f4.h"

#define ADDRESS 0x68u
#define REG_DATA 0x3Bu
#define REG_WHO_AM_I 0x75u
#define WHO_AM_I 0x68u /* value of an MPU6050; its successors have other scales and registers */
#define WHO_AM_I_BYTES 2u /* 27.3.8: LAST needs at least two bytes */
#define REG_INT_STATUS_CLEARED_BY_ANY_READ 0x10u
#define BYTES 14u
#define BUS_HZ 400000u
#define DATA_READY 5u /* PB5 */
#define PATIENCE_US 2000u
#define PIN_SILENT_US 15000u /* after this time the pin counts as not connected: poll every ten
                                milliseconds */
#define PERIOD_US 10000u
#define TURNS 100u
#define RETRY_US 100000u /* after a failure, so that a missing sensor costs no time */

typedef enum { REST, WRITING, VALUE, READING, BROKEN } phase_t;

void exti9_5_handler(void);
void i2c1_event_handler(void);
void i2c1_error_handler(void);
void dma1_stream0_handler(void);

static volatile phase_t phase;
static volatile uint32_t began_us, stamp_us, ready_us;
static volatile bool failed, identified;
static uint8_t data[BYTES];
static board_imu_t newest;
static bool given_up;

/* Settings as register and value: awake, clock from the gyro's oscillator; 100 Hz; filter 44/42 Hz;
 * 250 deg/s; 2 g; pin high until any read; data-ready signal on the pin. */
static const uint8_t settings[][2] = {{0x6B, 0x01}, {0x19, 9}, {0x1A, 3}, {0x1B, 0}, {0x1C, 0},
    {0x37, REG_INT_STATUS_CLEARED_BY_ANY_READ | 0x20u}, {0x38, 1}};
static volatile unsigned setting; /* index of the next setting to write; SETTINGS: all are written
                                     */
#define SETTINGS (sizeof settings / sizeof settings[0])

static void bus_start(void) {
    I2C1->cr1 = I2C_CR1_SWRST;
    I2C1->cr1 = 0;
    I2C1->cr2 = APB1_HZ / 1000000u | I2C_CR2_ITERREN | I2C_CR2_ITEVTEN;
    I2C1->ccr = I2C_CCR_FAST | APB1_HZ / (3u * BUS_HZ); /* clock low for two thirds */
    I2C1->trise = APB1_HZ / 1000000u * 300u / 1000u + 1u;
    I2C1->cr1 = I2C_CR1_PE;
}

static void write_for_half_a_clock(unsigned port, unsigned pin, bool high) {
    pin_write(port, pin, high);
    const uint32_t from_us = uptime_us();
    while (uptime_us() - from_us < 5u) {
    }
}

/* Release the bus. After an interrupted transfer, the sensor may hold SDA low: for a bit that it
 * sends, or as its acknowledgement. So send up to nine clock pulses (UM10204, 3.1.16), each with a
 * STOP. The sensor takes the first STOP during which it does not hold SDA low; more pulses would
 * only begin its next byte. This takes up to 0.2 ms in the SysTick interrupt, only after a
 * failure. */
static void bus_free(void) {
    pin_write(IMU_SCL, true);
    pin_write(IMU_SDA, true);
    pin_open_drain(IMU_SCL);
    pin_open_drain(IMU_SDA);
    for (unsigned i = 0; i < 9u; i++) {
        write_for_half_a_clock(IMU_SCL, false);
        write_for_half_a_clock(IMU_SDA, false);
        write_for_half_a_clock(IMU_SCL, true);
        write_for_half_a_clock(IMU_SDA, true);
        if (pin_read(IMU_SDA)) {
            break;
        }
    }
    pin_alternate(IMU_SCL, 4, PULL_UP, true);
    pin_alternate(IMU_SDA, 4, PULL_UP, true);
}

void imu_start(void) {
    pin_alternate(IMU_SCL, 4, PULL_UP, true);
    pin_alternate(IMU_SDA, 4, PULL_UP, true);
    pin_input(PORT_B, DATA_READY, PULL_DOWN);
    bus_free();
    bus_start();
    DMA1->stream[0].par = (uint32_t)(uintptr_t)&I2C1->dr;
    DMA1->stream[0].m0ar = (uint32_t)(uintptr_t)data;
    SYSCFG->exticr[1] = (SYSCFG->exticr[1] & ~0xF0u) | 1u << 4; /* EXTI5 from port B */
    EXTI->rtsr |= 1u << DATA_READY;
    EXTI->imr |= 1u << DATA_READY;
    nvic_enable(IRQ_I2C1_EV, LEVEL_IMU);
    nvic_enable(IRQ_I2C1_ER, LEVEL_IMU);
    nvic_enable(IRQ_DMA1_STREAM0, LEVEL_IMU);
    nvic_enable(IRQ_EXTI9_5, LEVEL_IMU);
}

static void begin(uint32_t now_us, phase_t first) {
    began_us = now_us;
    phase = first;
    I2C1->cr1 |= I2C_CR1_ACK | I2C_CR1_START;
}

void exti9_5_handler(void) {
    EXTI->pr = 1u << DATA_READY;
    ready_us = uptime_us();
    /* 27.6.1: no write to CR1 before the last STOP was sent. The poll below then reads the sample. */
    if (phase == REST && identified && setting == SETTINGS && (I2C1->cr1 & I2C_CR1_STOP) == 0) {
        stamp_us = ready_us;
        begin(ready_us, WRITING);
    }
}

static uint8_t next_register(void) {
    if (!identified) {
        return REG_WHO_AM_I;
    }
    return setting < SETTINGS ? settings[setting][0] : REG_DATA;
}

/* Event interrupt. Events are masked while DMA reads, so each event occurs once. */
void i2c1_event_handler(void) {
    const uint32_t flags = I2C1->sr1;
    if ((flags & I2C_SR1_SB) != 0) {
        I2C1->dr = ADDRESS << 1 | (phase == READING ? 1u : 0u);
    } else if ((flags & I2C_SR1_ADDR) != 0 && phase == READING) {
        I2C1->cr2 = (I2C1->cr2 & ~I2C_CR2_ITEVTEN) | I2C_CR2_DMAEN | I2C_CR2_LAST;
        DMA1->ifcr[0] = DMA_FLAGS_ALL;
        DMA1->stream[0].ndtr = identified ? BYTES : WHO_AM_I_BYTES;
        DMA1->stream[0].cr = DMA_CR_CHSEL(1) | DMA_CR_MINC | DMA_CR_TCIE | DMA_CR_EN;
        (void)I2C1->sr2; /* clears ADDR: the data bytes follow */
    } else if ((flags & I2C_SR1_ADDR) != 0) {
        (void)I2C1->sr2;
        I2C1->dr = next_register();
    } else if ((flags & I2C_SR1_BTF) != 0 && phase == WRITING && identified && setting < SETTINGS) {
        phase = VALUE; /* the register number has been sent */
        I2C1->dr = settings[setting][1];
    } else if ((flags & I2C_SR1_BTF) != 0 && phase == VALUE) {
        I2C1->cr1 |= I2C_CR1_STOP;
        setting++;
        phase = REST;
    } else if ((flags & I2C_SR1_BTF) != 0 && phase == WRITING) {
        phase = READING;
        I2C1->cr1 |= I2C_CR1_START;
    } else if (uptime_us() - began_us > PATIENCE_US) {
        /* BTF stays set until the START or STOP is on the bus (27.6.6). On a blocked bus this
         * interrupt would repeat for ever. */
        I2C1->cr2 &= ~I2C_CR2_ITEVTEN;
        failed = true;
    }
}

/* Error interrupt. ES0206 (errata of the F42x), "Spurious bus error detection in Master mode": a
 * bus error during a transfer is ignored, and the transfer continues. The timeout detects a bus
 * that really hangs. */
void i2c1_error_handler(void) {
    const uint32_t flags = I2C1->sr1 & I2C_SR1_ERRORS;
    I2C1->sr1 = ~flags;
    if ((flags & ~I2C_SR1_BERR) == 0) {
        return;
    }
    I2C1->cr1 |= I2C_CR1_STOP;
    failed = true;
}

static int16_t at(unsigned place) { return (int16_t)(data[place] << 8 | data[place + 1u]); }

void dma1_stream0_handler(void) {
    DMA1->ifcr[0] = DMA_FLAGS_ALL;
    I2C1->cr1 |= I2C_CR1_STOP;
    I2C1->cr2 = (I2C1->cr2 & ~(I2C_CR2_DMAEN | I2C_CR2_LAST)) | I2C_CR2_ITEVTEN;
    phase = REST;
    if (!identified) {
        identified = data[0] == WHO_AM_I;
        failed = !identified;
        return;
    }
    newest.accel_x = at(0);
    newest.accel_y = at(2);
    newest.accel_z = at(4);
    newest.temperature = at(6);
    newest.gyro_x = at(8);
    newest.gyro_y = at(10);
    newest.gyro_z = at(12);
    newest.sampled_us = stamp_us;
}

static void restart(void) {
    DMA1->stream[0].cr = 0;
    for (unsigned i = 0; i < TURNS && (DMA1->stream[0].cr & DMA_CR_EN) != 0; i++) { /* 10.3.17 */
    }
    /* SWRST lasts until the bus is free (27.6.1), so that the peripheral does not hold a line low. PE
     * must not be cleared during a transfer. */
    I2C1->cr1 = I2C_CR1_SWRST;
    bus_free();
    failed = identified = false;
    setting = 0;
    bus_start();
    phase = REST;
}

/* Check timeouts and write the next setting; called once per millisecond. The handlers above have a
 * higher priority and can interrupt this function. So interrupts are masked while it reads the
 * clock, decides and starts a transfer. Otherwise the time could be older than the start of a
 * transfer in a handler, and the difference of both times would wrap. */
void imu_millisecond(void) {
    const uint32_t state = irq_save();
    const uint32_t now_us = uptime_us();
    const bool stopping = (I2C1->cr1 & I2C_CR1_STOP) != 0; /* cleared when the STOP is sent */
    const bool late = (phase != REST || stopping) && now_us - began_us > PATIENCE_US;
    const bool broken = failed || late;
    if (broken) {
        phase = BROKEN; /* handlers now start no transfer */
        I2C1->cr2 &= ~(I2C_CR2_ITERREN | I2C_CR2_ITEVTEN);
        given_up = true;
        began_us = now_us;
    } else if (phase != REST || stopping || (given_up && now_us - began_us < RETRY_US)) {
        /* A transfer is in progress, the last STOP is not sent yet, or the retry time is not over.
         * 27.6.1: do not write CR1 before the STOP is sent. */
    } else if (!identified || setting < SETTINGS) {
        given_up = false;
        begin(now_us, WRITING);
    } else if (now_us - ready_us > PIN_SILENT_US && now_us - began_us >= PERIOD_US) {
        stamp_us = now_us;
        begin(now_us, WRITING);
    }
    irq_restore(state);
    if (broken) {
        restart();
    }
}

void board_imu(board_t *board, board_imu_t *out) {
    const uint32_t state = irq_save();
    *out = newest;
    irq_restore(state);
}
