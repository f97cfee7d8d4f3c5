/* From reset to main(): floating point unit, initialised data, zeroed data.
 * The addresses come from sections.ld. */
#include "startup.h"

#include <stddef.h>
#include <stdint.h>

#include "cortex_m4.h"

extern uint32_t ld_data_start[], ld_data_end[], ld_data_load[];
extern uint32_t ld_bss_start[], ld_bss_end[];
extern uint32_t ld_stack_bottom[];

#define STACK_MARK 0xA5A5A5A5u
#define STACK_ABOVE 64u /* bytes that this function itself may still use */

/* The linker's symbols are addresses and nothing more: numbers, so that they can be compared. */
static void fill(uintptr_t from, uintptr_t end, uint32_t value) {
    for (uintptr_t at = from; at < end; at += sizeof value) {
        *(uint32_t *)at = value;
    }
}

void reset_handler(void) {
    SCB_CPACR |= SCB_CPACR_FPU_FULL; /* before the first function that may use it */
    barrier();
    const uint32_t *from = ld_data_load;
    for (uintptr_t at = (uintptr_t)ld_data_start; at < (uintptr_t)ld_data_end; at += sizeof *from) {
        *(uint32_t *)at = *from++;
    }
    fill((uintptr_t)ld_bss_start, (uintptr_t)ld_bss_end, 0);
    /* Below our own frame nothing is in use yet: mark it, so that its use can be measured. */
    const uint32_t here = 0;
    fill((uintptr_t)ld_stack_bottom, (uintptr_t)&here - STACK_ABOVE, STACK_MARK);
    (void)main();
    system_reset();
}

/* A fault, or an interrupt that nobody asked for: outputs must not stay as they are until the
 * watchdog comes, so the chip begins anew at once. */
void fault_handler(void) { system_reset(); }

size_t startup_stack_free(void) {
    const uint32_t *at = ld_stack_bottom;
    while (*at == STACK_MARK) {
        at++;
    }
    return (size_t)(at - ld_stack_bottom) * sizeof *at;
}
