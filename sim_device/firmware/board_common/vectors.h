#ifndef VECTORS_H
#define VECTORS_H

/* A vector table: first the processor's exceptions (PM0214 section 2.3), which are equal on every
 * board, then the board's interrupts. */
#include <stdint.h>

#include "startup.h"

extern uint32_t ld_stack_top[];
void systick_handler(void);

typedef union {
    uint32_t *stack;   // cppcheck-suppress unusedStructMember ; the processor reads it
    handler_t handler; // cppcheck-suppress unusedStructMember
} vector_t;

#define EXCEPTIONS 16
#define AT(irq) (EXCEPTIONS + (irq))
#define VECTORS __attribute__((section(".vectors"), used)) static const vector_t vectors[]

/* Entries without a handler are zero. If such an interrupt occurs, the processor executes nothing:
 * bit 0 of the address (Thumb) is zero (PM0214 2.3.4), so it takes a fault (INVSTATE), which calls
 * the fault handler. Each board defines the last entry, IRQ_COUNT - 1. Otherwise the processor would
 * read the code after a shorter table as addresses. */
#define PROCESSOR_VECTORS                \
    [0] = {.stack = ld_stack_top},       \
    [1] = {.handler = reset_handler},    \
    [2] = {.handler = fault_handler},    \
    [3] = {.handler = fault_handler},    \
    [4] = {.handler = fault_handler},    \
    [5] = {.handler = fault_handler},    \
    [6] = {.handler = fault_handler},    \
    [11] = {.handler = fault_handler},   \
    [12] = {.handler = fault_handler},   \
    [14] = {.handler = fault_handler},   \
    [15] = {.handler = systick_handler}

#endif
