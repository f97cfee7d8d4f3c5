/* From reset to main(): floating point unit, initialised data, zeroed data. The addresses come from
 * sections.ld. */
#include "startup.h"

#include <stddef.h>
#include <stdint.h>

#include "cortex_m4.h"

extern uint32_t ld_data_start[], ld_data_end[], ld_data_load[];
extern uint32_t ld_bss_start[], ld_bss_end[];
extern uint32_t ld_stack_bottom[];
extern uint32_t ld_vectors[];

#define STACK_MARK 0xA5A5A5A5u
#define STACK_ABOVE 64u /* bytes that this function itself may still use */

/* The linker's symbols are only addresses. Here they are numbers, so that they can be compared. */
static void fill(uintptr_t from, uintptr_t end, uint32_t value) {
    for (uintptr_t at = from; at < end; at += sizeof value) {
        *(uint32_t *)at = value;
    }
}

void reset_handler(void) {
    SCB_CPACR |= SCB_CPACR_FPU_FULL; /* before the first function that may use it */
    /* The chip's serial bootloader may have started the program: its own vectors are then in use. */
    SCB->vtor = (uint32_t)(uintptr_t)ld_vectors;
    barrier();
    const uint32_t *from = ld_data_load;
    for (uintptr_t at = (uintptr_t)ld_data_start; at < (uintptr_t)ld_data_end; at += sizeof *from) {
        *(uint32_t *)at = *from++;
    }
    fill((uintptr_t)ld_bss_start, (uintptr_t)ld_bss_end, 0);
    /* Below this frame the stack is unused: mark it, so that its use can be measured. */
    const uint32_t here = 0;
    fill((uintptr_t)ld_stack_bottom, (uintptr_t)&here - STACK_ABOVE, STACK_MARK);
    (void)main();
    system_reset();
}

/* Memory that no start clears. At power-on its content is random, so a check shows whether it is
 * valid. */
static struct {
    board_crash_t record;
    uint32_t check;
} kept __attribute__((section(".noinit")));
static board_crash_t taken;

static uint32_t check_of(const board_crash_t *record) {
    return ~(record->pc ^ record->lr << 1 ^ record->cfsr << 2 ^ record->uptime_us << 3 ^ 0xC4A54u);
}

/* `stack` is where the processor has put r0 to r3, r12, lr, pc and xpsr (PM0214, section 2.3.7). */
static void keep_crash(const uint32_t *stack) __attribute__((used));
static void keep_crash(const uint32_t *stack) {
    const uint32_t cfsr = SCB->cfsr;
    /* After a stack overflow the stacked registers are unreadable: only the kind of fault is known.
     */
    const bool stacked = (cfsr & (SCB_CFSR_STKERR | SCB_CFSR_MSTKERR)) == 0;
    kept.record.pc = stacked ? stack[6] : 0;
    kept.record.lr = stacked ? stack[5] : 0;
    kept.record.cfsr = cfsr;
    kept.record.uptime_us = board_now_us(NULL);
    kept.check = check_of(&kept.record);
    system_reset();
}

/* A fault, or an unexpected interrupt. The outputs must not keep their state until the watchdog
 * fires, so the chip records the place and resets at once. C code cannot run on an overflowed
 * stack: unless the frame lies at its very top, our own frame begins there. */
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
    kept.check = ~kept.check;
    return whole ? &taken : NULL;
}

size_t startup_stack_free(void) {
    const uint32_t *at = ld_stack_bottom;
    while (*at == STACK_MARK) {
        at++;
    }
    return (size_t)(at - ld_stack_bottom) * sizeof *at;
}
