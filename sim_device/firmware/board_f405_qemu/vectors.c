/* RM0090 section 12.2, table 62: only what this board uses; anything else is a fault. */
#include "startup.h"
#include "stm32f4.h"

extern uint32_t ld_stack_top[];
void usart1_handler(void);
void usart2_handler(void);
void systick_handler(void);

typedef union {
    uint32_t *stack;   // cppcheck-suppress unusedStructMember ; the processor reads it
    handler_t handler; // cppcheck-suppress unusedStructMember
} vector_t;

#define EXCEPTIONS 16
#define AT(irq) (EXCEPTIONS + (irq))

__attribute__((section(".vectors"), used)) static const vector_t vectors[] = {
    [0] = {.stack = ld_stack_top},
    [1] = {.handler = reset_handler},
    [2] = {.handler = fault_handler},
    [3] = {.handler = fault_handler},
    [4] = {.handler = fault_handler},
    [5] = {.handler = fault_handler},
    [6] = {.handler = fault_handler},
    [11] = {.handler = fault_handler},
    [12] = {.handler = fault_handler},
    [14] = {.handler = fault_handler},
    [15] = {.handler = systick_handler},
    [AT(IRQ_USART1)] = {.handler = usart1_handler},
    [AT(IRQ_USART2)] = {.handler = usart2_handler},
};
