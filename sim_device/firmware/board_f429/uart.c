/* USART1 by DMA: a ring that fills by itself, told of at half, full and idle line; a queue that
 * leaves in one transfer for each contiguous part. RM0090 sections 10 and 30; streams and channels
 * in table 43: USART1_RX is DMA2 stream 2 channel 4, USART1_TX stream 7 channel 4. */
#include <string.h>

#include "cortex_m4.h"
#include "f429.h"
#include "firmware.h"
#include "stm32f4.h"

#define RX_SIZE 256u
#define TX_SIZE 1024u /* a power of two: places are taken modulo it */
#define BYTE_NS (10u * 1000000u / (BOARD_BAUD / 1000u))
#define RX_FLAGS(flags) ((flags) << 16) /* stream 2 in the low registers */
#define TX_FLAGS(flags) ((flags) << 22) /* stream 7 in the high ones */

void usart1_handler(void);
void dma2_stream2_handler(void);
void dma2_stream7_handler(void);

static uint8_t rx[RX_SIZE];
static uint32_t rx_taken;
static uint8_t tx[TX_SIZE];
static volatile uint32_t tx_put, tx_sent; /* bytes ever; their difference waits or is under way */
static volatile uint32_t tx_under_way;

void uart_start(void) {
    pin_alternate(PORT_A, 9, 7, PULL_NONE, false);
    pin_alternate(PORT_A, 10, 7, PULL_UP, false);
    USART1->brr = (APB2_HZ + BOARD_BAUD / 2u) / BOARD_BAUD;
    USART1->cr3 = USART_CR3_DMAR | USART_CR3_DMAT;
    USART1->cr1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE | USART_CR1_IDLEIE;
    dma_stream_t *const in = &DMA2->stream[2];
    in->par = (uint32_t)(uintptr_t)&USART1->dr;
    in->m0ar = (uint32_t)(uintptr_t)rx;
    in->ndtr = RX_SIZE;
    in->cr = DMA_CR_CHSEL(4) | DMA_CR_MINC | DMA_CR_CIRC | DMA_CR_PL_HIGH | DMA_CR_HTIE |
             DMA_CR_TCIE | DMA_CR_EN;
    DMA2->stream[7].par = (uint32_t)(uintptr_t)&USART1->dr;
    nvic_enable(IRQ_USART1, LEVEL_LINE); /* all three on one level: none interrupts another */
    nvic_enable(IRQ_DMA2_STREAM2, LEVEL_LINE);
    nvic_enable(IRQ_DMA2_STREAM7, LEVEL_LINE);
}

/* ---- in ------------------------------------------------------------------------------------ */

static void take(uint32_t arrived_us) {
    const uint32_t filled = RX_SIZE - DMA2->stream[2].ndtr;
    if (filled < rx_taken) {
        firmware_uart_received(device, &rx[rx_taken], RX_SIZE - rx_taken, arrived_us);
        rx_taken = 0;
    }
    if (filled > rx_taken) {
        firmware_uart_received(device, &rx[rx_taken], filled - rx_taken, arrived_us);
    }
    rx_taken = filled % RX_SIZE;
}

void usart1_handler(void) {
    const uint32_t flags = USART1->sr;
    if ((flags & (USART_SR_IDLE | USART_SR_ERRORS)) != 0) {
        (void)USART1->dr; /* 30.6.1: reading both clears them; the DMA has had the byte itself */
    }
    if ((flags & USART_SR_IDLE) != 0) {
        take(uptime_us() - (BYTE_NS + 999u) / 1000u); /* the line has been idle for a byte */
    }
}

void dma2_stream2_handler(void) {
    DMA2->ifcr[0] = RX_FLAGS(DMA_FLAGS_ALL);
    take(uptime_us());
}

/* ---- out ----------------------------------------------------------------------------------- */

/* With interrupts off, or in the stream's own. */
static void send_more(void) {
    const uint32_t waiting = tx_put - tx_sent;
    if (tx_under_way != 0 || waiting == 0) {
        return;
    }
    const uint32_t from = tx_sent % TX_SIZE;
    const uint32_t contiguous = TX_SIZE - from;
    tx_under_way = waiting < contiguous ? waiting : contiguous;
    dma_stream_t *const out = &DMA2->stream[7];
    DMA2->ifcr[1] = TX_FLAGS(DMA_FLAGS_ALL);
    out->m0ar = (uint32_t)(uintptr_t)&tx[from];
    out->ndtr = tx_under_way;
    USART1->sr = ~USART_SR_TC; /* 30.3.13: before the stream is enabled */
    out->cr = DMA_CR_CHSEL(4) | DMA_CR_MINC | DMA_CR_DIR_TO_PERIPHERAL | DMA_CR_TCIE |
              DMA_CR_TEIE | DMA_CR_EN;
}

void dma2_stream7_handler(void) {
    DMA2->ifcr[1] = TX_FLAGS(DMA_FLAGS_ALL);
    tx_sent += tx_under_way;
    tx_under_way = 0;
    send_more();
}

size_t board_uart_room(board_t *board) { return TX_SIZE - (tx_put - tx_sent); }

void board_uart_write(board_t *board, const uint8_t *data, size_t length) {
    const uint32_t at = tx_put % TX_SIZE;
    const size_t first = length < TX_SIZE - at ? length : TX_SIZE - at;
    memcpy(&tx[at], data, first);
    memcpy(tx, data + first, length - first);
    const uint32_t state = irq_save();
    tx_put += (uint32_t)length;
    send_more();
    irq_restore(state);
}

bool uart_drained(void) { return tx_put == tx_sent && (USART1->sr & USART_SR_TC) != 0; }

uint32_t board_uart_wait_us(board_t *board) {
    const uint32_t state = irq_save();
    const uint32_t left = tx_under_way != 0 ? DMA2->stream[7].ndtr : 0;
    const uint32_t waiting = tx_put - tx_sent - tx_under_way + left;
    irq_restore(state);
    if (waiting == 0 && (USART1->sr & USART_SR_TC) != 0) {
        return 0;
    }
    return (waiting + 1u) * BYTE_NS / 1000u; /* and the one in the shift register */
}
