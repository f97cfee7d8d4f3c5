/* Registers of the STM32F4 that the boards use. Source: ST RM0090, reference manual of
 * STM32F405/415, F407/417, F427/437 and F429/439. The comment of each block has the section number
 * in this manual. Base addresses: section 2.3, table 1. */
#ifndef STM32F4_H
#define STM32F4_H

#include <stdint.h>

typedef volatile uint32_t reg_t;

/* 6.3 RCC registers of the F42x. The F405 (section 7.3) has equal bits for the functions used here.
 */
typedef struct {
    reg_t cr, pllcfgr, cfgr, cir;
    reg_t ahb1rstr, ahb2rstr, ahb3rstr, reserved_0;
    reg_t apb1rstr, apb2rstr, reserved_1[2];
    reg_t ahb1enr, ahb2enr, ahb3enr, reserved_2;
    reg_t apb1enr, apb2enr, reserved_3[2];
    reg_t ahb1lpenr, ahb2lpenr, ahb3lpenr, reserved_4;
    reg_t apb1lpenr, apb2lpenr, reserved_5[2];
    reg_t bdcr, csr;
} rcc_regs_t;
#define RCC ((rcc_regs_t *)0x40023800u)
#define RCC_CR_HSION (1u << 0)
#define RCC_CR_HSIRDY (1u << 1)
#define RCC_CR_HSEON (1u << 16)
#define RCC_CR_HSERDY (1u << 17)
#define RCC_CR_HSEBYP (1u << 18)
#define RCC_CR_CSSON (1u << 19)
#define RCC_CR_PLLON (1u << 24)
#define RCC_CR_PLLRDY (1u << 25)
#define RCC_PLLCFGR_SRC_HSE (1u << 22)
#define RCC_CFGR_SW_MASK 3u
#define RCC_CFGR_SW_PLL 2u
#define RCC_CFGR_SWS_MASK (3u << 2)
#define RCC_CFGR_SWS_PLL (2u << 2)
#define RCC_CFGR_PPRE1_DIV4 (5u << 10)
#define RCC_CFGR_PPRE2_DIV2 (4u << 13)
/* Clock enable registers (ENR), and reset registers (RSTR) for the peripherals that are reset. */
#define RCC_AHB1_GPIO(port) (1u << (port)) /* port A is 0 */
#define RCC_AHB1_CRC (1u << 12)
#define RCC_AHB1_DMA1 (1u << 21)
#define RCC_AHB1_DMA2 (1u << 22)
#define RCC_AHB2_RNG (1u << 6)
#define RCC_APB1_TIM2 (1u << 0)
#define RCC_APB1_TIM3 (1u << 1)
#define RCC_APB1_TIM4 (1u << 2)
#define RCC_APB1_TIM5 (1u << 3)
#define RCC_APB1_USART2 (1u << 17)
#define RCC_APB1_USART3 (1u << 18)
#define RCC_APB1_I2C1 (1u << 21)
#define RCC_APB1_CAN1 (1u << 25)
#define RCC_APB1_PWR (1u << 28)
#define RCC_APB2_TIM1 (1u << 0)
#define RCC_APB2_USART1 (1u << 4)
#define RCC_APB2_ADC1 (1u << 8)
#define RCC_APB2_SYSCFG (1u << 14)
#define RCC_CSR_RMVF (1u << 24)
#define RCC_CSR_BORRSTF (1u << 25)
#define RCC_CSR_PINRSTF (1u << 26)
#define RCC_CSR_PORRSTF (1u << 27)
#define RCC_CSR_SFTRSTF (1u << 28)
#define RCC_CSR_IWDGRSTF (1u << 29)
#define RCC_CSR_WWDGRSTF (1u << 30)
#define RCC_CSR_LPWRRSTF (1u << 31)

/* 5.5 PWR registers. */
typedef struct {
    reg_t cr, csr;
} pwr_regs_t;
#define PWR ((pwr_regs_t *)0x40007000u)
#define PWR_CR_VOS_SCALE_1 (3u << 14)
#define PWR_CSR_VOSRDY (1u << 14)

/* 3.9 FLASH registers. */
typedef struct {
    reg_t acr, keyr, optkeyr, sr, cr, optcr;
} flash_regs_t;
#define FLASH ((flash_regs_t *)0x40023C00u)
#define FLASH_ACR_LATENCY_5 5u
#define FLASH_ACR_PRFTEN (1u << 8)
#define FLASH_ACR_ICEN (1u << 9)
#define FLASH_ACR_DCEN (1u << 10)
#define FLASH_ACR_ICRST (1u << 11)
#define FLASH_ACR_DCRST (1u << 12)
#define FLASH_KEY_1 0x45670123u
#define FLASH_KEY_2 0xCDEF89ABu
#define FLASH_SR_EOP (1u << 0)
#define FLASH_SR_ERRORS 0x000000F2u /* OPERR, WRPERR, PGAERR, PGPERR, PGSERR */
#define FLASH_SR_BSY (1u << 16)
#define FLASH_CR_PG (1u << 0)
#define FLASH_CR_SER (1u << 1)
#define FLASH_CR_SNB(code) ((uint32_t)(code) << 3)
#define FLASH_CR_PSIZE_32 (2u << 8)
#define FLASH_CR_STRT (1u << 16)
#define FLASH_CR_EOPIE (1u << 24)
#define FLASH_CR_ERRIE (1u << 25)
#define FLASH_CR_LOCK (1u << 31)
#define FLASH_OPTCR_DB1M (1u << 30)

/* Disable the instruction cache and the data cache, and empty them (3.9.1 and 3.9.2: this requires
 * ICEN = 0 and DCEN = 0). The wait states do not change, so any clock may be in use. */
static inline void flash_empty_caches(void) {
    FLASH->acr &= ~(FLASH_ACR_ICEN | FLASH_ACR_DCEN);
    FLASH->acr |= FLASH_ACR_ICRST | FLASH_ACR_DCRST;
    FLASH->acr &= ~(FLASH_ACR_ICRST | FLASH_ACR_DCRST);
}

/* 4.4 CRC registers. */
typedef struct {
    reg_t dr, idr, cr;
} crc_regs_t;
#define CRC ((crc_regs_t *)0x40023000u)
#define CRC_CR_RESET 1u

/* 8.4 GPIO registers. */
typedef struct {
    reg_t moder, otyper, ospeedr, pupdr, idr, odr, bsrr, lckr, afr[2];
} gpio_regs_t;
#define GPIO(port) ((gpio_regs_t *)(0x40020000u + 0x400u * (uint32_t)(port)))

/* 9.3 SYSCFG registers of the F42x, equal to 9.2 for the registers used here. */
typedef struct {
    reg_t memrmp, pmc, exticr[4];
} syscfg_regs_t;
#define SYSCFG ((syscfg_regs_t *)0x40013800u)

/* 12.3 EXTI registers. */
typedef struct {
    reg_t imr, emr, rtsr, ftsr, swier, pr;
} exti_regs_t;
#define EXTI ((exti_regs_t *)0x40013C00u)

/* 10.5 DMA registers. */
typedef struct {
    reg_t cr, ndtr, par, m0ar, m1ar, fcr;
} dma_stream_t;
typedef struct {
    reg_t isr[2], ifcr[2]; /* low (streams 0 to 3), high (4 to 7) */
    dma_stream_t stream[8];
} dma_regs_t;
#define DMA1 ((dma_regs_t *)0x40026000u)
#define DMA2 ((dma_regs_t *)0x40026400u)
#define DMA_CR_EN (1u << 0)
#define DMA_CR_TEIE (1u << 2)
#define DMA_CR_HTIE (1u << 3)
#define DMA_CR_TCIE (1u << 4)
#define DMA_CR_DIR_TO_PERIPHERAL (1u << 6)
#define DMA_CR_CIRC (1u << 8)
#define DMA_CR_MINC (1u << 10)
#define DMA_CR_PSIZE_16 (1u << 11)
#define DMA_CR_MSIZE_16 (1u << 13)
#define DMA_CR_PL_HIGH (2u << 16)
#define DMA_CR_CHSEL(channel) ((uint32_t)(channel) << 25)
/* Bit numbers of one stream's flags: FEIF 0, DMEIF 2, TEIF 3, HTIF 4, TCIF 5. */
#define DMA_FLAG_TE (1u << 3)
#define DMA_FLAG_HT (1u << 4)
#define DMA_FLAG_TC (1u << 5)
#define DMA_FLAGS_ALL 0x3Du
/* 10.5.3, 10.5.4: number of the first flag bit of a stream in its register (low or high). */
#define DMA_FLAGS_AT(stream) (6u * ((stream) % 2u) + 16u * ((stream) / 2u % 2u))

static inline void dma_clear_flags(dma_regs_t *dma, unsigned stream) {
    dma->ifcr[stream / 4u] = DMA_FLAGS_ALL << DMA_FLAGS_AT(stream);
}

/* 13.13 ADC registers. */
typedef struct {
    reg_t sr, cr1, cr2, smpr1, smpr2, jofr[4], htr, ltr, sqr[3], jsqr, jdr[4], dr;
} adc_regs_t;
#define ADC1 ((adc_regs_t *)0x40012000u)
#define ADC_CCR (*(reg_t *)0x40012304u)
#define ADC_CCR_PRESCALE_4 (1u << 16)
#define ADC_SR_OVR (1u << 5)
#define ADC_CR1_SCAN (1u << 8)
#define ADC_CR2_ADON (1u << 0)
#define ADC_CR2_CONT (1u << 1)
#define ADC_CR2_DMA (1u << 8)
#define ADC_CR2_DDS (1u << 9)
#define ADC_CR2_SWSTART (1u << 30)
#define ADC_SAMPLE_144 6u

/* 17.4 registers of TIM1 and TIM8, 18.4 registers of TIM2 to TIM5 (without rcr and bdtr). */
typedef struct {
    reg_t cr1, cr2, smcr, dier, sr, egr, ccmr[2], ccer, cnt, psc, arr, rcr, ccr[4], bdtr;
} tim_regs_t;
#define TIM1 ((tim_regs_t *)0x40010000u)
#define TIM2 ((tim_regs_t *)0x40000000u)
#define TIM3 ((tim_regs_t *)0x40000400u)
#define TIM4 ((tim_regs_t *)0x40000800u)
#define TIM5 ((tim_regs_t *)0x40000C00u)
#define TIM_CR1_CEN (1u << 0)
#define TIM_CR1_ARPE (1u << 7)
#define TIM_CR1_CKD_4 (2u << 8) /* filters run with a quarter of the timer's clock */
#define TIM_EGR_UG (1u << 0)
#define TIM_DIER_CCIE(channel) (1u << (channel)) /* channels count from 1 */
#define TIM_SR_CCIF(channel) (1u << (channel))
#define TIM_CCER_CCE(channel) (1u << (4u * ((channel) - 1u)))
#define TIM_CCER_CCP(channel) (2u << (4u * ((channel) - 1u)))
#define TIM_SMCR_ENCODER_BOTH 3u
#define TIM_BDTR_MOE (1u << 15)
#define TIM_BDTR_OSSR (1u << 11)
#define TIM_BDTR_OSSI (1u << 10)

/* 21.4 IWDG registers. */
typedef struct {
    reg_t kr, pr, rlr, sr;
} iwdg_regs_t;
#define IWDG ((iwdg_regs_t *)0x40003000u)
#define IWDG_KEY_START 0xCCCCu
#define IWDG_KEY_WRITE 0x5555u
#define IWDG_KEY_FEED 0xAAAAu

/* 24.4 RNG registers. */
typedef struct {
    reg_t cr, sr, dr;
} rng_regs_t;
#define RNG ((rng_regs_t *)0x50060800u)
#define RNG_CR_EN (1u << 2)
#define RNG_SR_DRDY (1u << 0)
#define RNG_SR_FAULTS ((1u << 1) | (1u << 2))

/* 27.6 I2C registers. */
typedef struct {
    reg_t cr1, cr2, oar1, oar2, dr, sr1, sr2, ccr, trise, fltr;
} i2c_regs_t;
#define I2C1 ((i2c_regs_t *)0x40005400u)
#define I2C_CR1_PE (1u << 0)
#define I2C_CR1_START (1u << 8)
#define I2C_CR1_STOP (1u << 9)
#define I2C_CR1_ACK (1u << 10)
#define I2C_CR1_SWRST (1u << 15)
#define I2C_CR2_ITERREN (1u << 8)
#define I2C_CR2_ITEVTEN (1u << 9)
#define I2C_CR2_ITBUFEN (1u << 10)
#define I2C_CR2_DMAEN (1u << 11)
#define I2C_CR2_LAST (1u << 12)
#define I2C_SR1_SB (1u << 0)
#define I2C_SR1_ADDR (1u << 1)
#define I2C_SR1_BTF (1u << 2)
#define I2C_SR1_TXE (1u << 7)
#define I2C_SR1_BERR (1u << 8)
#define I2C_SR1_ERRORS 0x0000DF00u
#define I2C_CCR_FAST (1u << 15)

/* 30.6 USART registers. */
typedef struct {
    reg_t sr, dr, brr, cr1, cr2, cr3, gtpr;
} usart_regs_t;
#define USART1 ((usart_regs_t *)0x40011000u)
#define USART2 ((usart_regs_t *)0x40004400u)
#define USART3 ((usart_regs_t *)0x40004800u)
#define USART_SR_ERRORS 0x0000000Fu /* parity, framing, noise, overrun */
#define USART_SR_ORE (1u << 3)
#define USART_SR_IDLE (1u << 4)
#define USART_SR_RXNE (1u << 5)
#define USART_SR_TC (1u << 6)
#define USART_SR_TXE (1u << 7)
#define USART_CR1_RE (1u << 2)
#define USART_CR1_TE (1u << 3)
#define USART_CR1_IDLEIE (1u << 4)
#define USART_CR1_RXNEIE (1u << 5)
#define USART_CR1_TXEIE (1u << 7)
#define USART_CR1_UE (1u << 13)
#define USART_CR3_DMAR (1u << 6)
#define USART_CR3_DMAT (1u << 7)

/* 32.9 bxCAN registers. */
typedef struct {
    reg_t ir, dtr, dlr, dhr;
} can_mailbox_t;
typedef struct {
    reg_t mcr, msr, tsr, rfr[2], ier, esr, btr;
    uint32_t reserved_0[88];
    can_mailbox_t tx[3], rx[2];
    uint32_t reserved_1[12];
    reg_t fmr, fm1r;
    uint32_t reserved_2;
    reg_t fs1r;
    uint32_t reserved_3;
    reg_t ffa1r;
    uint32_t reserved_4;
    reg_t fa1r;
    uint32_t reserved_5[8];
    struct {
        reg_t fr1, fr2;
    } filter[28];
} can_regs_t;
#define CAN1 ((can_regs_t *)0x40006400u)
#define CAN_MCR_INRQ (1u << 0)
#define CAN_MCR_SLEEP (1u << 1)
#define CAN_MCR_TXFP (1u << 2)
#define CAN_MCR_AWUM (1u << 5)
#define CAN_MCR_ABOM (1u << 6)
#define CAN_MSR_INAK (1u << 0)
#define CAN_MSR_ERRI (1u << 2)
#define CAN_MAILBOXES 3u
#define CAN_TSR_TME(mailbox) (1u << (26u + (mailbox)))
#define CAN_TSR_RQCP(mailbox) (1u << (8u * (mailbox)))
#define CAN_TSR_ABRQ(mailbox) (1u << (8u * (mailbox) + 7u))
#define CAN_RFR_FMP_MASK 3u
#define CAN_RFR_FOVR (1u << 4)
#define CAN_RFR_RFOM (1u << 5)
#define CAN_IER_TMEIE (1u << 0)
#define CAN_IER_FMPIE0 (1u << 1)
#define CAN_IER_BOFIE (1u << 10)
#define CAN_IER_ERRIE (1u << 15)
#define CAN_ESR_EWGF (1u << 0)
#define CAN_ESR_EPVF (1u << 1)
#define CAN_ESR_BOFF (1u << 2)
#define CAN_ESR_TEC(esr) ((esr) >> 16 & 0xFFu)
#define CAN_ESR_REC(esr) ((esr) >> 24)
#define CAN_IR_TXRQ 1u
#define CAN_IR_RTR (1u << 1)
#define CAN_IR_IDE (1u << 2)
#define CAN_IR_STID_SHIFT 21
#define CAN_FMR_FINIT 1u

/* 38.16.4, 38.16.5 Debug MCU freeze registers. */
#define DBGMCU_APB1_FZ (*(reg_t *)0xE0042008u)
#define DBGMCU_APB1_FZ_IWDG (1u << 12)

/* 39.2 Flash size, KiB. */
#define FLASH_KIB (*(const volatile uint16_t *)0x1FFF7A22u)

/* 39.1 Unique device identifier, 96 bits. */
#define DEVICE_UID ((const volatile uint32_t *)0x1FFF7A10u)

/* 12.2, tables 61 and 62: positions in the vector table. */
enum {
    IRQ_FLASH = 4,
    IRQ_DMA1_STREAM0 = 11,
    IRQ_DMA1_STREAM1 = 12,
    IRQ_DMA1_STREAM3 = 14,
    IRQ_CAN1_TX = 19,
    IRQ_CAN1_RX0 = 20,
    IRQ_CAN1_SCE = 22,
    IRQ_EXTI9_5 = 23,
    IRQ_TIM2 = 28,
    IRQ_I2C1_EV = 31,
    IRQ_I2C1_ER = 32,
    IRQ_USART1 = 37,
    IRQ_USART2 = 38,
    IRQ_USART3 = 39,
    IRQ_TIM5 = 50,
    IRQ_DMA2_STREAM2 = 58,
    IRQ_DMA2_STREAM7 = 70,
    IRQ_COUNT = 91
};

#endif
