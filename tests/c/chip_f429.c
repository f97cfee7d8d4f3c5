/* The STM32F429's drivers on this computer. Registers are plain memory at the chip's addresses, and
 * each check imitates the hardware. No output if all checks pass. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "cortex_m4.h"
#include "f429.h"
#include "firmware.h"
#include "register_watch.h"
#include "startup.h"

#define CHECK(condition)                                                                    \
    do {                                                                                    \
        if (!(condition)) {                                                                 \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                 \
            exit(1);                                                                        \
        }                                                                                   \
    } while (0)

void exti9_5_handler(void);
void i2c1_event_handler(void);
void i2c1_error_handler(void);
void dma1_stream0_handler(void);
void can1_rx0_handler(void);
void can1_tx_handler(void);
void can1_sce_handler(void);
void flash_handler(void);
void link_uart_handler(void);
void link_sent_handler(void);
void tim5_handler(void);
void systick_handler(void);

/* ---- the processor, and the core ------------------------------------------------------------ */

static uint32_t clock_us;
static unsigned masked;
static void (*before_masking)(void); /* an interrupt that comes just before masking */
static void (*as_unmasked)(void);    /* a masked interrupt that runs after unmasking */
static uint8_t received[64];
static size_t received_length;
static uint32_t received_us;

static void (*as_time_passes)(void);
uint32_t uptime_us(void)
{
    if (as_time_passes != NULL) {
        as_time_passes();
    }
    return clock_us++;
}

uint32_t irq_save(void)
{
    void (*const interrupt)(void) = before_masking;
    before_masking = NULL;
    if (interrupt != NULL && masked == 0) {
        interrupt();
    }
    return masked++;
}

void irq_restore(uint32_t before)
{
    void (*const interrupt)(void) = as_unmasked;
    masked = before;
    if (masked == 0 && interrupt != NULL) {
        as_unmasked = NULL;
        interrupt();
    }
}

const board_crash_t *startup_take_crash(void) { return NULL; }

static uint32_t sleep_us;
void wait_for_interrupt(void) { clock_us += sleep_us; }
void barrier(void) {}

void firmware_uart_received(
    firmware_t *firmware, const uint8_t *data, size_t length, uint32_t arrived_us)
{
    memcpy(received + received_length, data, length);
    received_length += length;
    received_us = arrived_us;
}

static unsigned can_received, can_lost;
void firmware_can_received(
    firmware_t *firmware, const sp_can_frame_t *frame, uint32_t arrived_us)
{
    can_received++;
}

void firmware_can_lost(firmware_t *firmware) { can_lost++; }

static void map(uintptr_t address, size_t size)
{
    void *const at = mmap((void *)address, size, PROT_READ | PROT_WRITE,
        MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED_NOREPLACE, -1, 0);
    CHECK(at == (void *)address);
}

static void chip_begins(uint16_t flash_kib)
{
    memset((void *)0x40000000u, 0, 0x30000);
    *(volatile uint16_t *)0x1FFF7A22u = flash_kib;
    RCC->cr = RCC_CR_HSIRDY | RCC_CR_HSERDY | RCC_CR_PLLRDY;
    PWR->csr = PWR_CSR_VOSRDY;
    RCC->pllcfgr = 0x24003010u; /* reset value */
}

/* ---- start ---------------------------------------------------------------------------------- */

/* Without an external clock there is no CAN, whatever the pin reads. The identity reports it. */
static void no_crystal_no_bus(void)
{
    chip_begins(2048);
    RCC->cr = RCC_CR_HSIRDY | RCC_CR_PLLRDY;
    board_start(NULL); /* the pin that selects CAN reads low */
    CHECK(!board_identity(NULL)->can);
    CHECK(board_identity(NULL)->troubles == BOARD_TROUBLE_CLOCK);
    CHECK((RCC->pllcfgr & (RCC_PLLCFGR_SRC_HSE | 0x3Fu)) == 16u);
    CHECK(RCC->pllcfgr >> 28 == 2u);
    CHECK((RCC->cr & RCC_CR_CSSON) == 0);
    CHECK(CAN1->btr == 0 && LINK_UART->brr != 0);
}

static void the_bus_where_the_clock_is_good(void)
{
    chip_begins(2048);
    RCC->cfgr = 0xFFF0u | RCC_CFGR_SW_PLL; /* a debugger has started the PLL */
    board_start(NULL);
    CHECK(board_identity(NULL)->can && board_identity(NULL)->troubles == 0);
    CHECK((RCC->pllcfgr & (RCC_PLLCFGR_SRC_HSE | 0x3Fu)) == (RCC_PLLCFGR_SRC_HSE | BOARD_HSE_MHZ));
    CHECK(((RCC->cr & RCC_CR_HSEBYP) != 0) == BOARD_HSE_BYPASS);
    CHECK(RCC->cfgr == (RCC_CFGR_PPRE1_DIV4 | RCC_CFGR_PPRE2_DIV2 | RCC_CFGR_SW_PLL));
    CHECK((RCC->cr & RCC_CR_CSSON) != 0); /* a failing crystal resets the chip */
    CHECK((DBGMCU_APB1_FZ & DBGMCU_APB1_FZ_IWDG) != 0);
    CHECK((GPIO(PORT_A)->moder >> 24 & 3u) == 1u); /* PA12 is an output: ES0206 */
}

/* The PLL is not used while the regulator's voltage is too low for it. */
static void no_voltage_no_pll(void)
{
    chip_begins(2048);
    PWR->csr = 0;
    CHECK(!clocks_start());
    CHECK((RCC->cfgr & RCC_CFGR_SW_MASK) == 0);
}

/* The clock control of a chip that the previous program has left at 168 MHz. */
#define DIVIDERS (RCC_CFGR_PPRE1_DIV4 | RCC_CFGR_PPRE2_DIV2)
static uint32_t reset_apb1, reset_apb2;
static uint32_t clock_source;
static unsigned times_at_the_internal_clock;

static void clock_control_follows(uintptr_t address, bool write)
{
    const uint32_t source = RCC->cfgr & RCC_CFGR_SW_MASK;
    if (source == RCC_CFGR_SW_PLL || clock_source == RCC_CFGR_SW_PLL) {
        CHECK((RCC->cfgr & DIVIDERS) == DIVIDERS && (RCC->cr & RCC_CR_PLLRDY) != 0);
        CHECK((FLASH->acr & FLASH_ACR_LATENCY_5) == FLASH_ACR_LATENCY_5);
        CHECK((PWR->csr & PWR_CSR_VOSRDY) != 0);
    }
    times_at_the_internal_clock += source == 0 && clock_source != 0;
    clock_source = source;
    RCC->cfgr = (RCC->cfgr & ~RCC_CFGR_SWS_MASK) | source << 2;
    /* A peripheral has its clock during its reset. */
    CHECK((RCC->apb1rstr & ~RCC->apb1enr) == 0 && (RCC->apb2rstr & ~RCC->apb2enr) == 0);
    reset_apb1 |= RCC->apb1rstr;
    reset_apb2 |= RCC->apb2rstr;
    const uint32_t on = RCC->cr & (RCC_CR_HSION | RCC_CR_HSEON | RCC_CR_PLLON);
    const uint32_t ready = RCC_CR_HSIRDY | RCC_CR_HSERDY | RCC_CR_PLLRDY;
    RCC->cr = (RCC->cr & ~ready) | on << 1;
    PWR->csr = (on & RCC_CR_PLLON) != 0 ? PWR_CSR_VOSRDY : 0u;
}

/* A debugger has started the program without a reset. All peripherals of the drivers are reset. The
 * buses are never faster than allowed: they keep their dividers while the PLL is in use. */
static void a_start_without_a_reset(void)
{
    chip_begins(2048);
    RCC->cr = RCC_CR_HSION | RCC_CR_HSIRDY | RCC_CR_HSEON | RCC_CR_HSERDY | RCC_CR_PLLON | RCC_CR_PLLRDY;
    RCC->cfgr = DIVIDERS | RCC_CFGR_SW_PLL | RCC_CFGR_SWS_PLL;
    FLASH->acr = FLASH_ACR_LATENCY_5;
    clock_source = RCC_CFGR_SW_PLL;
    if (!watch_registers((uintptr_t)RCC, clock_control_follows)) {
        return;
    }
    const bool precise = clocks_start();
    (void)watch_registers((uintptr_t)RCC, NULL);
    CHECK(precise && times_at_the_internal_clock == 1);
    CHECK(RCC->cfgr == (DIVIDERS | RCC_CFGR_SW_PLL | RCC_CFGR_SWS_PLL));
    CHECK(reset_apb1 == (RCC->apb1enr & ~RCC_APB1_PWR));
    CHECK(reset_apb2 == (RCC->apb2enr & ~RCC_APB2_SYSCFG));
    CHECK(RCC->apb1rstr == 0 && RCC->apb2rstr == 0);
}

/* ---- flash ---------------------------------------------------------------------------------- */

static void parameters_lie_in_the_second_bank(void)
{
    chip_begins(2048);
    CHECK(flash_can_save());
    CHECK(board_flash_page(NULL, 0) == (const uint8_t *)0x08100000u);
    CHECK(board_flash_page(NULL, 1) == (const uint8_t *)0x08104000u);
    chip_begins(1024);
    FLASH->optcr = FLASH_OPTCR_DB1M;
    CHECK(flash_can_save());
    CHECK(board_flash_page(NULL, 0) == (const uint8_t *)0x08080000u);
    FLASH->acr = FLASH_ACR_DCEN;
    board_flash_erase(NULL, 1);
    CHECK((FLASH->acr & FLASH_ACR_DCEN) == 0);
    CHECK(board_flash_busy(NULL) && (FLASH->cr & FLASH_CR_SNB(31)) == FLASH_CR_SNB(17));
    FLASH->sr = FLASH_SR_EOP;
    flash_handler();
    CHECK(!board_flash_busy(NULL) && FLASH->acr == FLASH_ACR_DCEN);
    static const uint8_t words[12] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    board_flash_write(NULL, 0, 8, words, sizeof words);
    for (unsigned i = 0; i < 3; i++) {
        CHECK(board_flash_busy(NULL) && FLASH->acr == 0);
        FLASH->sr = FLASH_SR_EOP;
        flash_handler();
    }
    CHECK(FLASH->acr == FLASH_ACR_DCEN);
    CHECK(!board_flash_busy(NULL) && memcmp((void *)0x08080008u, words, sizeof words) == 0);
}

#define CACHES (FLASH_ACR_ICEN | FLASH_ACR_DCEN)
#define CACHE_RESETS (FLASH_ACR_ICRST | FLASH_ACR_DCRST)
static bool caches_empty;

static void caches_follow(uintptr_t address, bool write)
{
    const uint32_t acr = FLASH->acr;
    CHECK((acr & CACHE_RESETS) == 0 || (acr & CACHES) == 0);
    CHECK((acr & FLASH_ACR_LATENCY_5) == FLASH_ACR_LATENCY_5);
    caches_empty = caches_empty || (acr & CACHE_RESETS) == CACHE_RESETS;
}

/* The previous program runs at 168 MHz. Its wait states stay, and a cache is off while it is emptied. */
static void caches_are_emptied_while_they_are_off(void)
{
    chip_begins(2048);
    FLASH->acr = FLASH_ACR_LATENCY_5 | FLASH_ACR_PRFTEN | CACHES;
    if (!watch_registers((uintptr_t)FLASH, caches_follow)) {
        return;
    }
    flash_empty_caches();
    (void)watch_registers((uintptr_t)FLASH, NULL);
    CHECK(caches_empty && FLASH->acr == (FLASH_ACR_LATENCY_5 | FLASH_ACR_PRFTEN));
}

/* The interrupt of the flash: pending while EOP is set, and until its handler begins. */
static bool flash_pending;

static void nvic_follows(uintptr_t address, bool write)
{
    const uint32_t flash = 1u << IRQ_FLASH;
    if (FLASH->sr == (FLASH_SR_EOP | FLASH_SR_ERRORS)) {
        FLASH->sr = 0; /* the driver has cleared the flags by writing ones */
    }
    if ((NVIC->icpr[0] & flash) != 0) {
        flash_pending = false;
    }
    NVIC->icpr[0] = 0;
    flash_pending = flash_pending || (FLASH->sr & FLASH_SR_EOP) != 0;
    if ((NVIC->iser[0] & flash) != 0 && flash_pending) {
        flash_pending = false;
        flash_handler();
    }
}

/* A debugger has halted the previous program between the end of an operation and its interrupt, and
 * has started the program without a reset. The old interrupt does not end the new operation. */
static void the_interrupt_of_an_old_operation_is_dropped(void)
{
    chip_begins(2048);
    memset(NVIC, 0, sizeof *NVIC);
    FLASH->sr = FLASH_SR_EOP;
    FLASH->cr = FLASH_CR_SER | FLASH_CR_EOPIE;
    FLASH->acr = FLASH_ACR_DCEN;
    flash_pending = true;
    if (!watch_registers((uintptr_t)NVIC, nvic_follows)) {
        return;
    }
    board_flash_erase(NULL, 0);
    (void)watch_registers((uintptr_t)NVIC, NULL);
    CHECK((NVIC->iser[0] & 1u << IRQ_FLASH) != 0 && !flash_pending);
    CHECK((FLASH->acr & FLASH_ACR_DCEN) == 0); /* the handler would set it */
    CHECK(board_flash_busy(NULL));
    FLASH->sr = FLASH_SR_EOP;
    flash_handler();
    CHECK(!board_flash_busy(NULL));
}

/* With one bank, nothing is erased while the program runs from it. The identity reports it. */
static void one_bank_saves_nothing(void)
{
    chip_begins(1024);
    CHECK(!flash_can_save());
    FLASH->cr = FLASH_CR_LOCK;
    board_flash_erase(NULL, 0);
    CHECK(!board_flash_busy(NULL) && FLASH->cr == FLASH_CR_LOCK);
    board_start(NULL);
    CHECK(board_identity(NULL)->troubles == BOARD_TROUBLE_FLASH);
}

/* ---- IMU ------------------------------------------------------------------------------------ */

static void event(uint32_t flag)
{
    I2C1->sr1 = flag;
    i2c1_event_handler();
}

static bool started(void)
{
    const bool so = (I2C1->cr1 & I2C_CR1_START) != 0;
    I2C1->cr1 &= ~I2C_CR1_START;
    return so;
}

/* Return the register that a transfer requests; the transfer is in progress. */
static uint8_t asked_for(void)
{
    CHECK(started());
    I2C1->cr1 &= ~I2C_CR1_STOP; /* the last stop has been sent */
    event(I2C_SR1_SB);
    CHECK(I2C1->dr == 0x68u << 1);
    event(I2C_SR1_ADDR);
    return (uint8_t)I2C1->dr;
}

/* Finish a read with these bytes. */
static void answers(const uint8_t *bytes, size_t length)
{
    event(I2C_SR1_BTF);
    CHECK(started());
    event(I2C_SR1_SB);
    CHECK(I2C1->dr == (0x68u << 1 | 1u));
    event(I2C_SR1_ADDR);
    CHECK(DMA1->stream[0].ndtr == length);
    memcpy((void *)(uintptr_t)DMA1->stream[0].m0ar, bytes, length);
    dma1_stream0_handler();
}

static void millisecond(void)
{
    clock_us += 1000;
    I2C1->cr1 &= ~I2C_CR1_STOP; /* the last stop has been sent: it takes 5 us */
    imu_millisecond();
}

/* A sensor of another kind is never read, because its scales differ. */
static void another_sensor_is_not_taken(void)
{
    static const uint8_t other[2] = {0x70, 0};
    millisecond();
    for (unsigned i = 0; i < 3; i++) {
        CHECK(asked_for() == 0x75);
        answers(other, 2);
        for (unsigned passed = 0; passed < 98; passed++) {
            millisecond();
            CHECK((I2C1->cr1 & I2C_CR1_START) == 0); /* no readings are requested */
        }
        for (unsigned passed = 0; passed < 5 && (I2C1->cr1 & I2C_CR1_START) == 0; passed++) {
            millisecond();
        }
    }
}

/* The sensor answers with its identity, and the driver writes the settings. */
static void settings_are_written(void)
{
    static const uint8_t ours[2] = {0x68, 0};
    answers(ours, 2);
    for (unsigned i = 0; i < 7; i++) {
        CHECK((I2C1->cr1 & I2C_CR1_STOP) != 0);
        imu_millisecond();
        CHECK(!started()); /* the stop is not yet sent */
        millisecond();
        (void)asked_for();
        event(I2C_SR1_BTF);
        CHECK(!started());
        event(I2C_SR1_BTF);
    }
}

static void the_sensor_is_set_up(void)
{
    CHECK(asked_for() == 0x75);
    settings_are_written();
}

/* The last stop has been sent, and the pin reports a new sample. */
static void data_ready(void)
{
    I2C1->cr1 &= ~I2C_CR1_STOP;
    exti9_5_handler();
}

static const uint8_t level[14] = {0, 1, 0, 2, 0x40, 0, 0, 3, 0, 4, 0, 5, 0, 6};

static void a_sample_is_stamped_by_its_pin(void)
{
    board_imu_t imu;
    CHECK((I2C1->cr1 & I2C_CR1_STOP) != 0);
    exti9_5_handler();
    CHECK(!started()); /* the stop is not yet sent */
    clock_us = 500000;
    data_ready();
    CHECK(asked_for() == 0x3B);
    answers(level, sizeof level);
    board_imu(NULL, &imu);
    CHECK(imu.sampled_us == 500000 && imu.accel_z == 16384 && imu.gyro_z == 6);
}

/* The pin's interrupt comes during the tick, before the part with interrupts off. Its transfer has
 * just begun and is not late. */
static void a_sample_that_begins_under_the_tick_goes_on(void)
{
    board_imu_t imu;
    clock_us += 9000;
    before_masking = data_ready;
    const uint32_t from_us = clock_us;
    imu_millisecond();
    CHECK(asked_for() == 0x3B);
    answers(level, sizeof level);
    board_imu(NULL, &imu);
    CHECK(imu.sampled_us == from_us);
}

/* The sensor holds SDA low, so the STOP is never sent. The bus is freed after two milliseconds. */
static void a_stop_that_is_never_sent_is_found(void)
{
    clock_us += 9000;
    data_ready();
    CHECK(asked_for() == 0x3B);
    answers(level, sizeof level);
    CHECK((I2C1->cr1 & I2C_CR1_STOP) != 0);
    for (unsigned passed = 0; passed < 3; passed++) {
        clock_us += 1000;
        imu_millisecond();
    }
    CHECK((I2C1->cr1 & I2C_CR1_STOP) == 0); /* the peripheral was reset */
    for (unsigned passed = 0; passed < 105 && !started(); passed++) {
        millisecond();
    }
    I2C1->cr1 |= I2C_CR1_START;
    CHECK(asked_for() == 0x75);
    settings_are_written();
}

/* BTF stays set on a blocked bus. The handler masks its interrupt, so that others can run. */
static void an_event_that_repeats_is_masked(void)
{
    clock_us += 9000;
    data_ready();
    CHECK(asked_for() == 0x3B);
    event(I2C_SR1_BTF);
    CHECK(started());
    event(I2C_SR1_BTF);
    CHECK((I2C1->cr2 & I2C_CR2_ITEVTEN) != 0);
    clock_us += 3000;
    event(I2C_SR1_BTF);
    CHECK((I2C1->cr2 & I2C_CR2_ITEVTEN) == 0);
    millisecond();
    CHECK((I2C1->cr2 & I2C_CR2_ITEVTEN) != 0); /* the driver is set up again */
    for (unsigned passed = 0; passed < 105 && !started(); passed++) {
        millisecond();
    }
    I2C1->cr1 |= I2C_CR1_START;
    CHECK(asked_for() == 0x75);
    settings_are_written();
}

static void only_a_bus_error_is_spurious(void)
{
    board_imu_t imu;
    clock_us += 9000;
    data_ready();
    CHECK(asked_for() == 0x3B);
    I2C1->sr1 = I2C_SR1_BERR;
    i2c1_error_handler();
    CHECK((I2C1->cr1 & I2C_CR1_STOP) == 0 && I2C1->sr1 == (uint32_t)~I2C_SR1_BERR);
    answers(level, sizeof level);
    const uint32_t from_us = clock_us;
    board_imu(NULL, &imu);
    CHECK(from_us - imu.sampled_us < 100);
    clock_us += 9000;
    data_ready();
    CHECK(asked_for() == 0x3B);
    I2C1->sr1 = 1u << 10; /* no acknowledge: there is no sensor */
    i2c1_error_handler();
    millisecond();
    for (unsigned passed = 0; passed < 105 && !started(); passed++) {
        millisecond();
    }
    I2C1->cr1 |= I2C_CR1_START;
    CHECK(asked_for() == 0x75); /* the sensor is set up again */
}

/* A bus that hangs is reset after two milliseconds. */
static void a_bus_that_hangs_is_freed(void)
{
    clock_us += 3000;
    imu_millisecond();
    unsigned passed = 0;
    while (passed < 200 && !started()) {
        millisecond();
        passed++;
    }
    CHECK(passed > 90 && passed < 110);
}

/* A sensor whose transfer was interrupted, on the pins as GPIO. It receives or sends the bits of
 * bytes; `bit` 8 is the acknowledgement. Each test begins with the clock high. */
static struct {
    bool sends, stopped, holds;
    unsigned bit;
    bool scl, sda; /* levels of the master */
} sensor;

static unsigned mask(unsigned port, unsigned pin) { return 1u << pin; }

static void sensor_drives(void)
{
    sensor.holds = !sensor.stopped && sensor.sends != (sensor.bit == 8);
}

static void sensor_follows(void)
{
    gpio_regs_t *const port = GPIO(PORT_B);
    const bool line = sensor.sda && !sensor.holds;
    const bool was_high = sensor.scl;
    sensor.scl = port->bsrr == mask(IMU_SCL) || (sensor.scl && port->bsrr != mask(IMU_SCL) << 16);
    sensor.sda = port->bsrr == mask(IMU_SDA) || (sensor.sda && port->bsrr != mask(IMU_SDA) << 16);
    if (was_high && !sensor.scl) {
        sensor.bit = (sensor.bit + 1) % 9;
        sensor_drives();
    } else if (was_high && !line && sensor.sda && !sensor.holds) {
        sensor.stopped = true; /* a STOP: SDA rises while SCL is high */
        sensor_drives();
    } else if (!was_high && sensor.scl && sensor.sends && sensor.bit == 8 && sensor.sda) {
        sensor.stopped = true; /* no acknowledgement */
        sensor_drives();
    }
    port->idr = (sensor.scl ? mask(IMU_SCL) : 0u) | (sensor.sda && !sensor.holds ? mask(IMU_SDA) : 0u);
}

static void an_interrupted_transfer_is_ended_in_every_bit(void)
{
    for (unsigned bit = 0; bit < 18; bit++) {
        chip_begins(2048);
        memset(&sensor, 0, sizeof sensor);
        sensor.scl = sensor.sda = true;
        sensor.sends = bit >= 9;
        sensor.bit = bit % 9;
        sensor_drives();
        as_time_passes = sensor_follows;
        imu_start();
        as_time_passes = NULL;
        CHECK(sensor.stopped && sensor.scl && sensor.sda && !sensor.holds);
        CHECK((I2C1->cr1 & I2C_CR1_PE) != 0);
    }
}

/* ---- ADC ------------------------------------------------------------------------------------ */

static void an_overrun_does_not_freeze_the_readings(void)
{
    chip_begins(2048);
    clock_us = 1000;
    analog_start();
    volatile dma_stream_t *const stream = &DMA2->stream[0];
    const uint32_t whole = stream->ndtr;
    stream->ndtr = whole - 100;
    clock_us = 2000;
    analog_millisecond();
    CHECK(analog_sampled_us() == 2000 - ANALOG_AGE_US);
    ADC1->sr = ADC_SR_OVR;
    ADC1->cr2 = 0;
    stream->cr = 0;
    analog_millisecond();
    CHECK(ADC1->sr == 0 && stream->ndtr == whole && (stream->cr & DMA_CR_EN) != 0);
    CHECK((ADC1->cr2 & (ADC_CR2_SWSTART | ADC_CR2_DMA | ADC_CR2_ADON))
        == (ADC_CR2_SWSTART | ADC_CR2_DMA | ADC_CR2_ADON));
    stream->ndtr = whole - 7;
    analog_millisecond();
    const uint32_t stamp_us = analog_sampled_us();
    clock_us += 50000; /* without new readings, the stamp stays */
    analog_millisecond();
    CHECK(analog_sampled_us() == stamp_us);
}

/* ---- ultrasonic ------------------------------------------------------------------------------ */

static void echo_ends(void)
{
    TIM5->sr = TIM_SR_CCIF(1) | TIM_SR_CCIF(2);
    tim5_handler();
}

/* A millimetre of range is 5.83 us of echo, there and back. The handler runs late. */
static void an_echo_has_the_time_of_its_pulse(void)
{
    board_ranges_t ranges;
    chip_begins(2048);
    sonar_start();
    clock_us = 500000;
    sonar_millisecond();
    TIM5->ccr[0] = 7000;
    TIM5->ccr[1] = 7000 + 5831;
    TIM5->cnt = 7000 + 5831 + 40;
    clock_us = 506000;
    echo_ends();
    board_ranges(NULL, &ranges);
    CHECK(ranges.ultrasonic_mm == 1000 && ranges.ultrasonic_us == 506000 - 5871);
    clock_us = 530000; /* the range stays, and so does its time */
    board_ranges(NULL, &ranges);
    CHECK(ranges.ultrasonic_mm == 1000 && ranges.ultrasonic_us == 506000 - 5871);
    TIM5->ccr[0] = 60000;
    TIM5->ccr[1] = TIM5->cnt = 98000; /* 38 ms: there was no echo */
    clock_us = 600000;
    echo_ends();
    board_ranges(NULL, &ranges);
    CHECK(ranges.ultrasonic_mm == BOARD_NO_RANGE && ranges.ultrasonic_us == 600000 - 38000);
    for (unsigned i = 0; i < 2u * 60u; i++) { /* and then the sensor is unplugged */
        clock_us = 600000 + 1000u * i;
        sonar_millisecond();
    }
    board_ranges(NULL, &ranges);
    CHECK(ranges.ultrasonic_mm == BOARD_NO_RANGE);
    CHECK(clock_us - ranges.ultrasonic_us < 121000 && clock_us - ranges.ultrasonic_us > 59000);
}

/* The echo has begun before the timer's start. Its end is no range, and no answer of the sensor. */
static void an_end_without_a_beginning_is_no_echo(void)
{
    board_ranges_t ranges;
    TIM5->ccr[0] = 100000;
    TIM5->ccr[1] = TIM5->cnt = 100000 + 5831;
    echo_ends();
    TIM5->ccr[1] = TIM5->cnt = 100000 + 2915; /* 0.5 m */
    TIM5->sr = TIM_SR_CCIF(2);
    tim5_handler();
    CHECK((TIM5->sr & TIM_SR_CCIF(2)) == 0);
    board_ranges(NULL, &ranges);
    CHECK(ranges.ultrasonic_mm == 1000);
    for (unsigned i = 0; i < 60u; i++) {
        sonar_millisecond();
    }
    TIM5->sr = TIM_SR_CCIF(2);
    tim5_handler();
    for (unsigned i = 0; i < 60u; i++) {
        sonar_millisecond();
    }
    board_ranges(NULL, &ranges);
    CHECK(ranges.ultrasonic_mm == BOARD_NO_RANGE);
}

/* ---- CAN ------------------------------------------------------------------------------------ */

static bool offer(uint16_t id)
{
    const sp_can_frame_t frame = {.id = id, .length = 1, .data = {(uint8_t)id}};
    const bool taken = board_can_write(NULL, &frame);
    for (unsigned i = 0; i < CAN_MAILBOXES; i++) {
        if ((CAN1->tx[i].ir & CAN_IR_TXRQ) != 0) {
            CAN1->tsr &= ~CAN_TSR_TME(i);
        }
    }
    return taken;
}

static void sent(unsigned mailbox)
{
    CAN1->tx[mailbox].ir &= ~CAN_IR_TXRQ;
    CAN1->tsr = CAN_TSR_TME(mailbox);
    can1_tx_handler();
}

static void mailboxes_are_refilled_by_their_interrupt(void)
{
    chip_begins(2048);
    can_start(3);
    CHECK((CAN1->ier & CAN_IER_TMEIE) != 0);
    CAN1->tsr = CAN_TSR_TME(0) | CAN_TSR_TME(1) | CAN_TSR_TME(2);
    for (uint16_t id = 1; id <= 7; id++) {
        CHECK(offer(id));
    }
    CHECK(!offer(8));
    for (uint16_t i = 0; i < 4; i++) { /* the main loop is busy */
        const unsigned mailbox = i % CAN_MAILBOXES;
        CHECK(CAN1->tx[mailbox].ir >> CAN_IR_STID_SHIFT == i + 1u);
        sent(mailbox);
    }
    CHECK(CAN1->tx[0].ir >> CAN_IR_STID_SHIFT == 7 && CAN1->tx[0].dlr == 7);
    CHECK(!can_drained());
    CAN1->tsr |= CAN_TSR_TME(1) | CAN_TSR_TME(2);
    CHECK(!can_drained());
    CAN1->tsr |= CAN_TSR_TME(0);
    CHECK(can_drained());
    CAN1->tsr = 0;
    CHECK(offer(9) && !can_drained());
}

static void bus_off_is_counted_and_drops_what_is_old(void)
{
    board_can_health_t health;
    CAN1->tsr = 0;
    CHECK(offer(10) && offer(11));
    CAN1->esr = 0xFFu << 16 | 5u << 24 | CAN_ESR_BOFF;
    can1_sce_handler();
    CHECK((CAN1->tsr & CAN_TSR_ABRQ(0)) != 0 && (CAN1->tsr & CAN_TSR_ABRQ(2)) != 0);
    board_can_health(NULL, &health);
    CHECK(health.off && health.offs == 1 && health.send_errors == 255);
    CHECK(health.receive_errors == 5);
    CAN1->esr = 0;
    board_can_health(NULL, &health);
    CHECK(!health.off && health.offs == 1);
    sent(0);
    CHECK((CAN1->tx[0].ir & CAN_IR_TXRQ) == 0); /* frames 10 and 11 are dropped */
    CHECK((CAN1->mcr & CAN_MCR_ABOM) != 0);
}

/* The controller's FIFO was full when a frame arrived, so the frame is lost. */
static void an_overrun_of_the_fifo_is_counted(void)
{
    chip_begins(2048);
    can_received = can_lost = 0;
    CAN1->rfr[0] = 1u;
    can1_rx0_handler();
    CHECK(can_received == 1 && can_lost == 0);
    CAN1->rfr[0] = 3u | CAN_RFR_FOVR;
    can1_rx0_handler();
    CHECK(can_received == 2 && can_lost == 1);
    CHECK(CAN1->rfr[0] == (CAN_RFR_RFOM | CAN_RFR_FOVR)); /* releases the frame, clears the flag */
}

/* ---- encoders, serial link, sleep ------------------------------------------------------------ */

/* The filter is longer than the ringing of the motor bridges' edges. It is at most a tenth of the
 * time of an encoder level at top speed. */
static void encoders_are_filtered(void)
{
    chip_begins(2048);
    encoders_start();
    const tim_regs_t *const both[] = {TIM3, TIM4};
    for (unsigned i = 0; i < 2; i++) {
        CHECK((both[i]->ccmr[0] & 0xF0F0u) == 0xF0F0u);
        const uint32_t sampling_hz = TIMER_APB1_HZ / (1u << (both[i]->cr1 >> 8 & 3u)) / 32u;
        const uint32_t filter_ns = 8u * 1000000u / (sampling_hz / 1000u);
        CHECK(filter_ns > 5000 && filter_ns < 87000);
    }
}

static void bytes_of_the_ring_come_in_order(void)
{
    chip_begins(2048);
    uart_start();
    dma_stream_t *const in = &LINK_DMA->stream[LINK_RX_STREAM];
    uint8_t *const ring = (uint8_t *)(uintptr_t)in->m0ar;
    const uint32_t size = in->ndtr;
    ring[0] = 7;
    ring[1] = 8;
    in->ndtr = size - 2;
    LINK_UART->sr = USART_SR_IDLE;
    clock_us = 70000;
    link_uart_handler();
    CHECK(received_length == 2 && received[0] == 7 && received[1] == 8);
    CHECK(70000 - received_us < 20);
    received_length = 0;
    LINK_UART->sr = 0;
    link_uart_handler();
    CHECK(received_length == 0);
}

/* TC may be set from the byte before the transfer. The last two bytes then still need 22 us. */
static void a_stale_flag_does_not_end_a_transfer(void)
{
    static const uint8_t bytes[3] = {1, 2, 3};
    chip_begins(2048);
    uart_start();
    clock_us += 1000;
    LINK_UART->sr = USART_SR_TC;
    CHECK(board_uart_wait_us(NULL) == 0 && uart_drained());
    board_uart_write(NULL, bytes, sizeof bytes);
    LINK_UART->sr = USART_SR_TC;
    CHECK(board_uart_wait_us(NULL) > 0 && !uart_drained());
    LINK_DMA->stream[LINK_TX_STREAM].ndtr = 0;
    link_sent_handler();
    CHECK(board_uart_wait_us(NULL) > 0 && !uart_drained());
    clock_us += 25;
    CHECK(board_uart_wait_us(NULL) == 0 && uart_drained());
}

static bool status_read;
static unsigned data_reads;

static void uart_follows(uintptr_t address, bool write)
{
    if (address == (uintptr_t)&LINK_UART->dr) {
        data_reads++;
        LINK_UART->sr &= status_read ? ~USART_SR_ORE : ~0u;
    }
    status_read = address == (uintptr_t)&LINK_UART->sr;
}

/* No interrupt reports an overrun, and no byte arrives until the flag is cleared. Without an overrun,
 * the next byte in the data register belongs to DMA. */
static void an_overrun_is_cleared_by_the_tick(void)
{
    chip_begins(2048);
    uart_start();
    if (!watch_registers((uintptr_t)LINK_UART, uart_follows)) {
        return;
    }
    LINK_UART->sr = USART_SR_RXNE;
    data_reads = 0;
    systick_handler();
    CHECK(data_reads == 0);
    LINK_UART->sr = USART_SR_ORE;
    data_reads = 0;
    systick_handler();
    CHECK(data_reads == 1 && (LINK_UART->sr & USART_SR_ORE) == 0);
    (void)watch_registers((uintptr_t)LINK_UART, NULL);
}

static void an_interrupt(void) { clock_us += 400; }

/* Interrupt time counts as load, also if the interrupt ended a sleep. */
static void interrupts_count_as_load(void)
{
    const uint32_t before_us = board_busy_us(NULL);
    sleep_us = 1000;
    as_unmasked = an_interrupt;
    board_idle();
    const uint32_t busy_us = board_busy_us(NULL) - before_us;
    CHECK(busy_us >= 400 && busy_us < 410);
}

int main(void)
{
    map(0x40000000u, 0x30000);
    map(0x50060000u, 0x1000);
    map(0xE000E000u, 0x1000);
    map(0xE0042000u, 0x1000);
    map(0x1FFF7000u, 0x1000);
    map(0x08000000u, 0x200000);
    a_start_without_a_reset();
    no_crystal_no_bus();
    no_voltage_no_pll();
    the_bus_where_the_clock_is_good();
    another_sensor_is_not_taken();
    the_sensor_is_set_up();
    a_sample_is_stamped_by_its_pin();
    a_sample_that_begins_under_the_tick_goes_on();
    a_stop_that_is_never_sent_is_found();
    an_event_that_repeats_is_masked();
    only_a_bus_error_is_spurious();
    a_bus_that_hangs_is_freed();
    an_interrupted_transfer_is_ended_in_every_bit();
    parameters_lie_in_the_second_bank();
    caches_are_emptied_while_they_are_off();
    the_interrupt_of_an_old_operation_is_dropped();
    one_bank_saves_nothing();
    an_overrun_does_not_freeze_the_readings();
    an_echo_has_the_time_of_its_pulse();
    an_end_without_a_beginning_is_no_echo();
    mailboxes_are_refilled_by_their_interrupt();
    bus_off_is_counted_and_drops_what_is_old();
    an_overrun_of_the_fifo_is_counted();
    encoders_are_filtered();
    bytes_of_the_ring_come_in_order();
    a_stale_flag_does_not_end_a_transfer();
    an_overrun_is_cleared_by_the_tick();
    interrupts_count_as_load();
    return 0;
}
