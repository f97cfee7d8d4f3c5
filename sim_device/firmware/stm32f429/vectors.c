/* Vector table (RM0090 section 12.2, table 62, F42x) with the interrupts of these boards. Any other
 * interrupt calls the fault handler (vectors.h). */
#include "f429.h"
#include "vectors.h"

void flash_handler(void);
void dma1_stream0_handler(void);
void can1_rx0_handler(void);
void can1_tx_handler(void);
void can1_sce_handler(void);
void exti9_5_handler(void);
void i2c1_event_handler(void);
void i2c1_error_handler(void);
void link_uart_handler(void);
void tim5_handler(void);
void link_received_handler(void);
void link_sent_handler(void);

VECTORS = {
    PROCESSOR_VECTORS,
    [AT(IRQ_FLASH)] = {.handler = flash_handler},
    [AT(IRQ_DMA1_STREAM0)] = {.handler = dma1_stream0_handler},
    [AT(IRQ_CAN1_TX)] = {.handler = can1_tx_handler},
    [AT(IRQ_CAN1_SCE)] = {.handler = can1_sce_handler},
    [AT(IRQ_CAN1_RX0)] = {.handler = can1_rx0_handler},
    [AT(IRQ_EXTI9_5)] = {.handler = exti9_5_handler},
    [AT(IRQ_I2C1_EV)] = {.handler = i2c1_event_handler},
    [AT(IRQ_I2C1_ER)] = {.handler = i2c1_error_handler},
    [AT(LINK_UART_IRQ)] = {.handler = link_uart_handler},
    [AT(IRQ_TIM5)] = {.handler = tim5_handler},
    [AT(LINK_RX_IRQ)] = {.handler = link_received_handler},
    [AT(LINK_TX_IRQ)] = {.handler = link_sent_handler},
    [AT(IRQ_COUNT - 1)] = {.handler = fault_handler},
};
