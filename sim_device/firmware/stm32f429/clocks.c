/* Clocks, pins, reset cause, boot id. */
#include "cortex_m4.h"
#include "f429.h"
#include "stm32f4.h"

#define HSE_TURNS 200000u /* iterations of a loop of about ten cycles at 16 MHz: 0.1 s */

static bool wait_until(const volatile uint32_t *at, uint32_t mask, uint32_t value) {
    for (uint32_t i = 0; i < HSE_TURNS; i++) {
        if ((*at & mask) == value) {
            return true;
        }
    }
    return false;
}

/* Peripherals of the drivers on the buses APB1 and APB2. */
#define USED_APB1                                                                                \
    (LINK_UART_APB1 | RCC_APB1_TIM2 | RCC_APB1_TIM3 | RCC_APB1_TIM4 | RCC_APB1_TIM5 |            \
     RCC_APB1_I2C1 | RCC_APB1_CAN1)
#define USED_APB2 (LINK_UART_APB2 | RCC_APB2_TIM1 | RCC_APB2_ADC1)

/* Reset the peripherals, because they ignore some writes while they are active. They are active if
 * the program was started without a reset (startup.c). The reset also stops the motors' PWM. */
static void reset_peripherals(void) {
    RCC->apb1rstr = USED_APB1;
    RCC->apb2rstr = USED_APB2;
    barrier();
    RCC->apb1rstr = 0;
    RCC->apb2rstr = 0;
}

/* Start the clock of 168 MHz: (crystal / M = 1 MHz) x 336 / 2; the buses run at 42 and 84 MHz. If
 * the external clock fails, the PLL runs from the internal oscillator of 16 MHz, which is accurate
 * to 1 %. This is enough for a UART, but not for CAN: each node may have an error of at most 0.36
 * %, because a resynchronisation jump of one quantum (of 14) must correct ten bits (32.7.7). */
bool clocks_start(void) {
    RCC->ahb1enr |= RCC_AHB1_CRC | RCC_AHB1_DMA1 | RCC_AHB1_DMA2;
    for (unsigned port = PORT_A; port <= PORT_G; port++) {
        RCC->ahb1enr |= RCC_AHB1_GPIO(port);
    }
    RCC->ahb2enr |= RCC_AHB2_RNG;
    RCC->apb1enr |= USED_APB1 | RCC_APB1_PWR;
    RCC->apb2enr |= USED_APB2 | RCC_APB2_SYSCFG;
    reset_peripherals();
    /* 5.1.4, 6.3.1, 6.3.2: the PLL and the HSE must be off while their settings change. After a reset
     * they are off; a debugger or the ROM bootloader may have started them. */
    RCC->cr |= RCC_CR_HSION;
    (void)wait_until(&RCC->cr, RCC_CR_HSIRDY, RCC_CR_HSIRDY);
    RCC->cfgr &= ~RCC_CFGR_SW_MASK; /* SW only: without their dividers, the buses would be too fast
                                       until the chip has left the PLL */
    (void)wait_until(&RCC->cfgr, RCC_CFGR_SWS_MASK, 0u);
    RCC->cfgr = 0;
    RCC->cr &= ~(RCC_CR_PLLON | RCC_CR_CSSON | RCC_CR_HSEON);
    (void)wait_until(&RCC->cr, RCC_CR_PLLRDY | RCC_CR_HSERDY, 0u);
    RCC->cr &= ~RCC_CR_HSEBYP;
    PWR->cr |= PWR_CR_VOS_SCALE_1; /* 5.5.1 and 3.5.1: needed above 144 MHz */
#if BOARD_HSE_BYPASS
    RCC->cr |= RCC_CR_HSEBYP; /* 6.3.1: while HSEON is off */
#endif
    RCC->cr |= RCC_CR_HSEON;
    const bool crystal = wait_until(&RCC->cr, RCC_CR_HSERDY, RCC_CR_HSERDY);
    const uint32_t divider = crystal ? BOARD_HSE_MHZ : 16u;
    RCC->pllcfgr = (RCC->pllcfgr & 0xF0000000u) | /* 6.3.2: reserved bits keep their reset value */
                   divider | 336u << 6 | 7u << 24 | /* P is 00: divide by two */
                   (crystal ? RCC_PLLCFGR_SRC_HSE : 0u);
    RCC->cr |= RCC_CR_PLLON;
    /* 3.5.1, table 12: five wait states at 168 MHz and 3.3 V. The caches are empty
     * (startup.c). */
    FLASH->acr = FLASH_ACR_LATENCY_5 | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    RCC->cfgr = RCC_CFGR_PPRE1_DIV4 | RCC_CFGR_PPRE2_DIV2;
    const bool locked = wait_until(&RCC->cr, RCC_CR_PLLRDY, RCC_CR_PLLRDY);
    /* 5.1.4, 5.5.2: the regulator begins to set the voltage for 168 MHz when the PLL is on. */
    const bool powered = wait_until(&PWR->csr, PWR_CSR_VOSRDY, PWR_CSR_VOSRDY);
    if (locked && powered) {
        RCC->cfgr |= RCC_CFGR_SW_PLL;
        (void)wait_until(&RCC->cfgr, RCC_CFGR_SWS_MASK, RCC_CFGR_SWS_PLL);
    }
    if (crystal) {
        /* 6.2.7: if the external clock fails later, the processor takes an NMI. Its vector is the fault
         * handler, whose reset turns the motors off; the chip then starts from the internal
         * oscillator. */
        RCC->cr |= RCC_CR_CSSON;
    }
    TIM2->psc = TIMER_APB1_HZ / 1000000u - 1u;
    TIM2->arr = 0xFFFFFFFFu;
    TIM2->egr = TIM_EGR_UG;
    TIM2->cr1 = TIM_CR1_CEN;
    return crystal && locked && powered;
}

/* Return the cause of the last reset. 7.3.21 (F405), 6.3.21 (F42x): the flag PIN is set together
 * with every other cause, and BOR together with POR. */
uint8_t reset_cause(void) {
    const uint32_t flags = RCC->csr;
    RCC->csr |= RCC_CSR_RMVF;
    if ((flags & (RCC_CSR_IWDGRSTF | RCC_CSR_WWDGRSTF)) != 0) {
        return SP_RESET_CAUSE_WATCHDOG;
    }
    if ((flags & RCC_CSR_SFTRSTF) != 0) {
        return SP_RESET_CAUSE_SOFTWARE;
    }
    if ((flags & RCC_CSR_PORRSTF) != 0) {
        return SP_RESET_CAUSE_POWER_ON;
    }
    return (flags & RCC_CSR_BORRSTF) != 0 ? SP_RESET_CAUSE_BROWN_OUT : SP_RESET_CAUSE_PIN;
}

/* Return a boot id from the random number generator (24.3.1: the first number must not be used). If
 * the generator fails, use a counter in memory that the startup code does not clear; each boot
 * increments it. */
uint32_t boot_id(const uint8_t uid[12]) {
    static uint32_t boots __attribute__((section(".noinit")));
    boots++;
    RNG->cr = RNG_CR_EN;
    uint32_t drawn[2] = {0, 0};
    for (unsigned i = 0; i < 2u; i++) {
        if (wait_until(&RNG->sr, RNG_SR_DRDY | RNG_SR_FAULTS, RNG_SR_DRDY)) {
            drawn[i] = RNG->dr;
        }
    }
    if (drawn[1] != 0 && drawn[1] != drawn[0]) {
        return drawn[1];
    }
    const uint8_t count[4] = {
        (uint8_t)boots, (uint8_t)(boots >> 8), (uint8_t)(boots >> 16), (uint8_t)(boots >> 24)};
    const uint32_t mixed = sp_crc32_update(sp_crc32_update(0, uid, 12), count, sizeof count);
    return mixed != 0 ? mixed : 1u;
}

/* ---- pins: 8.4; two bits per pin in moder, ospeedr, pupdr, four in afr ---------------------- */

enum { MODE_INPUT, MODE_OUTPUT, MODE_ALTERNATE, MODE_ANALOG };

static void set_two_bits(reg_t *reg, unsigned pin, uint32_t value) {
    *reg = (*reg & ~(3u << (2u * pin))) | value << (2u * pin);
}

void pin_input(unsigned port, unsigned pin, pull_t pull) {
    set_two_bits(&GPIO(port)->pupdr, pin, pull);
    set_two_bits(&GPIO(port)->moder, pin, MODE_INPUT);
}

void pin_output(unsigned port, unsigned pin) { set_two_bits(&GPIO(port)->moder, pin, MODE_OUTPUT); }

void pin_alternate(unsigned port, unsigned pin, unsigned function, pull_t pull, bool open_drain) {
    gpio_regs_t *const gpio = GPIO(port);
    const unsigned shift = 4u * (pin % 8u);
    gpio->afr[pin / 8u] = (gpio->afr[pin / 8u] & ~(15u << shift)) | (uint32_t)function << shift;
    gpio->otyper = (gpio->otyper & ~(1u << pin)) | (open_drain ? 1u << pin : 0u);
    set_two_bits(&gpio->pupdr, pin, pull);
    set_two_bits(&gpio->ospeedr, pin, 1u); /* medium: 25 MHz */
    set_two_bits(&gpio->moder, pin, MODE_ALTERNATE);
}

void pin_analog(unsigned port, unsigned pin) { set_two_bits(&GPIO(port)->moder, pin, MODE_ANALOG); }

void pin_open_drain(unsigned port, unsigned pin) {
    GPIO(port)->otyper |= 1u << pin;
    set_two_bits(&GPIO(port)->moder, pin, MODE_OUTPUT);
}

void pin_write(unsigned port, unsigned pin, bool high) {
    GPIO(port)->bsrr = high ? 1u << pin : 1u << (pin + 16u);
}

bool pin_read(unsigned port, unsigned pin) { return (GPIO(port)->idr >> pin & 1u) != 0; }
