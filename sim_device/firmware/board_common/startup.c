/* Startup code from reset to main(): floating point unit, initialised data, zeroed data. The linker
 * script sections.ld defines the addresses.
 *
 * A debugger (gdb's `load` and `continue`) or the chip's serial bootloader can start the program
 * without a reset. Interrupts and DMA of the previous program are then still active. */
#include "startup.h"

#include <stddef.h>
#include <stdint.h>

#include "cortex_m4.h"
#include "stm32f4.h"

extern uint32_t ld_data_start[], ld_data_end[], ld_data_load[];
extern uint32_t ld_bss_start[], ld_bss_end[];
extern uint32_t ld_stack_bottom[];
extern uint32_t ld_vectors[];

#define STACK_MARK 0xA5A5A5A5u
#define STACK_ABOVE 64u /* bytes that this function may still use */

/* The symbols of the linker are only addresses. This function uses them as numbers, so that it can
 * compare them. */
static void fill(uintptr_t from, uintptr_t end, uint32_t value) {
    for (uintptr_t at = from; at < end; at += sizeof value) {
        *(uint32_t *)at = value;
    }
}

/* Stop everything of the previous program that can change variables or call a handler. Without
 * this, for example, the ADC's DMA stream would continue to write to its old buffer. After a reset,
 * all of it is already stopped.
 *
 * The caches of the flash may contain lines of the previous program, which a debugger has replaced
 * in the flash. They are emptied first, because the code and the initial values of the variables
 * are read through them. The board's clock driver enables them again. */
static void stop_previous_program(void) {
    flash_empty_caches();
    RCC->ahb1rstr = RCC_AHB1_DMA1 | RCC_AHB1_DMA2;
    SYSTICK->ctrl = 0;
    SCB->icsr = SCB_ICSR_PENDSTCLR;
    for (unsigned i = 0; i < sizeof NVIC->icer / sizeof NVIC->icer[0]; i++) {
        NVIC->icer[i] = 0xFFFFFFFFu;
        NVIC->icpr[i] = 0xFFFFFFFFu;
    }
    RCC->ahb1rstr = 0;
    barrier();
}

/* A debugger sets only the program counter. So mask interrupts and empty the stack. */
__attribute__((naked)) void reset_handler(void) {
    __asm volatile("cpsid i\n\t"
                   "ldr r0, =ld_stack_top\n\t"
                   "msr msp, r0\n\t"
                   "b start_program");
}

void start_program(void) {
    if (active_exception() != 0) {
        /* A debugger has stopped the previous program in an interrupt handler. The processor would
         * mask interrupts of equal or lower priority until the handler returns. */
        system_reset();
    }
    stop_previous_program();
    SCB_CPACR |= SCB_CPACR_FPU_FULL; /* before the first function that uses floating point */
    /* If the chip's serial bootloader has started the program, the bootloader's vectors are in use.
     */
    SCB->vtor = (uint32_t)(uintptr_t)ld_vectors;
    barrier();
    const uint32_t *from = ld_data_load;
    for (uintptr_t at = (uintptr_t)ld_data_start; at < (uintptr_t)ld_data_end; at += sizeof *from) {
        *(uint32_t *)at = *from++;
    }
    fill((uintptr_t)ld_bss_start, (uintptr_t)ld_bss_end, 0);
    irq_restore(0); /* unmask */
    /* The stack below this frame is unused. Fill it with a pattern, so that its use can be
     * measured. */
    const uint32_t here = 0;
    fill((uintptr_t)ld_stack_bottom, (uintptr_t)&here - STACK_ABOVE, STACK_MARK);
    (void)main();
    system_reset();
}

/* Memory that the startup code does not clear. Its content is random at power-on, so a check word
 * shows whether it is valid. */
static struct {
    board_crash_t record;
    uint32_t check;
} kept __attribute__((section(".noinit")));
static board_crash_t taken;

static uint32_t check_of(const board_crash_t *record) {
    return ~(record->pc ^ record->lr << 1 ^ record->cfsr << 2 ^ record->uptime_us << 3 ^ 0xC4A54u);
}

/* `stack` points to r0 to r3, r12, lr, pc and xpsr, which the processor has stored (PM0214, section
 * 2.3.7). */
static void keep_crash(const uint32_t *stack) __attribute__((used));
static void keep_crash(const uint32_t *stack) {
    const uint32_t cfsr = SCB->cfsr;
    /* After a stack overflow, the stored registers are not valid, and only the kind of fault is
     * known. */
    const bool stacked = (cfsr & (SCB_CFSR_STKERR | SCB_CFSR_MSTKERR)) == 0;
    kept.record.pc = stacked ? stack[6] : 0;
    kept.record.lr = stacked ? stack[5] : 0;
    kept.record.cfsr = cfsr;
    kept.record.uptime_us = board_now_us(NULL);
    kept.check = check_of(&kept.record);
    system_reset();
}

/* Handler of processor faults and unexpected interrupts. It stores a crash record and resets the
 * chip at once, because the outputs must not keep their state until the watchdog resets the chip. C
 * code cannot run on an overflowed stack. So the handler first moves the stack pointer to the top
 * of the stack, unless the stored registers are there. */
__attribute__((naked)) void fault_handler(void) {
    __asm volatile("tst lr, #4\n\t"
                   "ite eq\n\t"
                   "mrseq r0, msp\n\t"
                   "mrsne r0, psp\n\t"
                   "ldr r1, =ld_stack_top\n\t"
                   "sub r2, r1, #256\n\t"
                   "cmp r0, r2\n\t"
                   "it lo\n\t"
                   "msrlo msp, r1\n\t"
                   "b keep_crash");
}

const board_crash_t *startup_take_crash(void) {
    const bool whole = kept.check == check_of(&kept.record);
    taken = kept.record;
    kept.check = ~check_of(&kept.record);
    return whole ? &taken : NULL;
}

size_t startup_stack_free(void) {
    const uint32_t *at = ld_stack_bottom;
    while (*at == STACK_MARK) {
        at++;
    }
    return (size_t)(at - ld_stack_bottom) * sizeof *at;
}
