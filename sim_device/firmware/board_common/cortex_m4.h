/* Registers of the Cortex-M4 processor that the boards use. Source: ST PM0214, STM32 Cortex-M4
 * programming manual. The comment of each block has the section number in this manual. */
#ifndef CORTEX_M4_H
#define CORTEX_M4_H

#include <stdint.h>

/* 4.5 SysTick timer. */
typedef struct {
    volatile uint32_t ctrl;
    volatile uint32_t load;
    volatile uint32_t val;
    volatile uint32_t calib;
} systick_regs_t;
#define SYSTICK ((systick_regs_t *)0xE000E010u)
#define SYSTICK_ENABLE (1u << 0)
#define SYSTICK_TICKINT (1u << 1)
#define SYSTICK_CLKSOURCE (1u << 2)

/* 4.3 Nested vectored interrupt controller. */
typedef struct {
    volatile uint32_t iser[8];
    uint32_t reserved_0[24];
    volatile uint32_t icer[8];
    uint32_t reserved_1[24];
    volatile uint32_t ispr[8];
    uint32_t reserved_2[24];
    volatile uint32_t icpr[8];
    uint32_t reserved_3[24];
    volatile uint32_t iabr[8];
    uint32_t reserved_4[56];
    volatile uint8_t ip[240];
} nvic_regs_t;
#define NVIC ((nvic_regs_t *)0xE000E100u)

/* 4.4 System control block. */
typedef struct {
    volatile uint32_t cpuid;
    volatile uint32_t icsr;
    volatile uint32_t vtor;
    volatile uint32_t aircr;
    volatile uint32_t scr;
    volatile uint32_t ccr;
    volatile uint8_t shpr[12];
    volatile uint32_t shcsr;
    volatile uint32_t cfsr;
    volatile uint32_t hfsr;
} scb_regs_t;
#define SCB ((scb_regs_t *)0xE000ED00u)
#define SCB_ICSR_PENDSTCLR (1u << 25)
#define SCB_CFSR_STKERR (1u << 12) /* the stack could not be written on entry to the handler */
#define SCB_CFSR_MSTKERR (1u << 4)
#define SCB_AIRCR_VECTKEY (0x05FAu << 16)
#define SCB_AIRCR_SYSRESETREQ (1u << 2)
#define SCB_SHPR_SYSTICK 11 /* byte of SHPR3 with the priority of exception 15 */

/* 4.6 Floating point unit: coprocessor access control. */
#define SCB_CPACR (*(volatile uint32_t *)0xE000ED88u)
#define SCB_CPACR_FPU_FULL (0xFu << 20)

/* The STM32F4 has sixteen priority levels (4.3.7: only bits 7:4 are used). An interrupt with a
 * lower number can interrupt a handler with a higher number. */
#define PRIORITY(level) ((uint8_t)((level) << 4))

/* Enable an interrupt. A request that is still pending from before, although its flag has been
 * cleared, is dropped first. No request of a set flag is lost: while the peripheral asserts its
 * interrupt line, the interrupt stays pending (4.3.9). */
static inline void nvic_enable(unsigned irq, unsigned level) {
    NVIC->ip[irq] = PRIORITY(level);
    NVIC->icpr[irq / 32u] = 1u << (irq % 32u);
    NVIC->iser[irq / 32u] = 1u << (irq % 32u);
}

#if defined(__arm__)
static inline uint32_t irq_save(void) {
    uint32_t primask;
    __asm volatile("mrs %0, primask\n\tcpsid i" : "=r"(primask)::"memory");
    return primask;
}

static inline void irq_restore(uint32_t primask) {
    __asm volatile("msr primask, %0" ::"r"(primask) : "memory");
}

/* Return the number of the exception whose handler runs; 0: none (PM0214 2.1.3, IPSR). */
static inline uint32_t active_exception(void) {
    uint32_t ipsr;
    __asm volatile("mrs %0, ipsr" : "=r"(ipsr));
    return ipsr;
}

static inline void wait_for_interrupt(void) { __asm volatile("wfi" ::: "memory"); }

static inline void barrier(void) { __asm volatile("dsb\n\tisb" ::: "memory"); }

#else
/* In a test on a computer, tests/c/chip_f429.c defines these functions. */
uint32_t irq_save(void);
void irq_restore(uint32_t primask);
void wait_for_interrupt(void);
void barrier(void);
#endif

/* This function does not return. */
static inline void system_reset(void) {
    barrier();
    SCB->aircr = SCB_AIRCR_VECTKEY | SCB_AIRCR_SYSRESETREQ;
    for (;;) {
        barrier();
    }
}

#endif
