/* Vector table (RM0090 section 12.2, table 61) with the interrupts of this board. Any other
 * interrupt calls the fault handler (vectors.h). */
#include "stm32f4.h"
#include "vectors.h"

void usart1_handler(void);
void usart2_handler(void);

VECTORS = {
    PROCESSOR_VECTORS,
    [AT(IRQ_USART1)] = {.handler = usart1_handler},
    [AT(IRQ_USART2)] = {.handler = usart2_handler},
    [AT(IRQ_COUNT - 1)] = {.handler = fault_handler},
};
