/* RM0090 section 12.2, table 62: only the interrupts of this board; any other is a fault. */
#include "stm32f4.h"
#include "vectors.h"

void usart1_handler(void);
void usart2_handler(void);

VECTORS = {
    PROCESSOR_VECTORS,
    [AT(IRQ_USART1)] = {.handler = usart1_handler},
    [AT(IRQ_USART2)] = {.handler = usart2_handler},
};
