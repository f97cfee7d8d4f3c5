/* Driver of the serial link with DMA (RM0090 sections 10 and 30). DMA fills the receive ring
 * buffer. An interrupt occurs when the buffer is half full, when it is full, and when the UART is
 * idle. DMA sends each contiguous part of the send queue in one transfer. */
#include <string.h>

#include "cortex_m4.h"
#include "f429.h"
#include "firmware.h"
#include "stm32f4.h"

#define RX_SIZE 256u
#define TX_SIZE 1024u /* a power of two, so that indices stay correct when the counts wrap */
#define BYTE_NS (10u * 1000000u / (BOARD_BAUD / 1000u))
#define IN (&LINK_DMA->stream[LINK_RX_STREAM])
#define OUT (&LINK_DMA->stream[LINK_TX_STREAM])

/* A receiver samples the middle of each bit, so the baud rates of both ends may differ by 3 % over
 * ten bits. Each end may use half of this tolerance. */
_Static_assert(BOARD_BAUD * 1000u < LINK_UART_HZ / ((LINK_UART_HZ + BOARD_BAUD / 2u) / BOARD_BAUD) * 1015u &&
                   BOARD_BAUD * 1000u > LINK_UART_HZ / ((LINK_UART_HZ + BOARD_BAUD / 2u) / BOARD_BAUD) * 985u,
               "this UART cannot make BOARD_BAUD to 1.5 %");

void link_uart_handler(void);
void link_received_handler(void);
void link_sent_handler(void);

static uint8_t rx[RX_SIZE];
static uint32_t rx_taken;
static uint8_t tx[TX_SIZE];
static volatile uint32_t tx_put, tx_sent; /* bytes since boot: queued and sent */
static volatile uint32_t tx_under_way;
static volatile uint32_t sent_us; /* time at which DMA wrote the last byte to the UART */

void uart_start(void) {
    pin_alternate(LINK_TX, 7, PULL_NONE, false);
    pin_alternate(LINK_RX, 7, PULL_UP, false);
    LINK_UART->brr = (LINK_UART_HZ + BOARD_BAUD / 2u) / BOARD_BAUD;
    LINK_UART->cr3 = USART_CR3_DMAR | USART_CR3_DMAT;
    LINK_UART->cr1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE | USART_CR1_IDLEIE;
    dma_stream_t *const in = IN;
    in->par = (uint32_t)(uintptr_t)&LINK_UART->dr;
    in->m0ar = (uint32_t)(uintptr_t)rx;
    in->ndtr = RX_SIZE;
    in->cr = DMA_CR_CHSEL(LINK_DMA_CHANNEL) | DMA_CR_MINC | DMA_CR_CIRC | DMA_CR_PL_HIGH | DMA_CR_HTIE |
             DMA_CR_TCIE | DMA_CR_EN;
    OUT->par = (uint32_t)(uintptr_t)&LINK_UART->dr;
    nvic_enable(LINK_UART_IRQ, LEVEL_LINK); /* one priority level for all three, so that they do not
                                               interrupt each other */
    nvic_enable(LINK_RX_IRQ, LEVEL_LINK);
    nvic_enable(LINK_TX_IRQ, LEVEL_LINK);
}

/* ---- receiving ------------------------------------------------------------------------------ */

static void take(uint32_t arrived_us) {
    const uint32_t filled = RX_SIZE - IN->ndtr;
    if (filled < rx_taken) {
        firmware_uart_received(device, &rx[rx_taken], RX_SIZE - rx_taken, arrived_us);
        rx_taken = 0;
    }
    if (filled > rx_taken) {
        firmware_uart_received(device, &rx[rx_taken], filled - rx_taken, arrived_us);
    }
    rx_taken = filled % RX_SIZE;
}

void link_uart_handler(void) {
    const uint32_t flags = LINK_UART->sr;
    if ((flags & (USART_SR_IDLE | USART_SR_ERRORS)) != 0) {
        (void)LINK_UART->dr; /* 30.6.1: reading SR and then DR clears the flags; DMA has already
                                read the byte */
    }
    if ((flags & USART_SR_IDLE) != 0) {
        take(uptime_us() - (BYTE_NS + 999u) / 1000u); /* the UART has been idle for the duration of
                                                         one byte */
    }
}

/* Clear an overrun; called once per millisecond. An overrun has no interrupt here, and while ORE is
 * set, no byte arrives: there is no DMA request, and the UART does not become idle again. 30.6.1:
 * reading SR and then DR clears the flag. */
void uart_clear_overrun(void) {
    if ((LINK_UART->sr & USART_SR_ORE) != 0) {
        (void)LINK_UART->dr;
    }
}

void link_received_handler(void) {
    dma_clear_flags(LINK_DMA, LINK_RX_STREAM);
    take(uptime_us());
}

/* ---- sending -------------------------------------------------------------------------------- */

/* Start the next DMA transfer. Called with interrupts masked, or in the stream's interrupt. */
static void send_more(void) {
    const uint32_t waiting = tx_put - tx_sent;
    if (tx_under_way != 0 || waiting == 0) {
        return;
    }
    const uint32_t from = tx_sent % TX_SIZE;
    const uint32_t contiguous = TX_SIZE - from;
    tx_under_way = waiting < contiguous ? waiting : contiguous;
    dma_stream_t *const out = OUT;
    dma_clear_flags(LINK_DMA, LINK_TX_STREAM);
    out->m0ar = (uint32_t)(uintptr_t)&tx[from];
    out->ndtr = tx_under_way;
    LINK_UART->sr = ~USART_SR_TC; /* 30.3.13: clear TC before the stream is enabled */
    out->cr = DMA_CR_CHSEL(LINK_DMA_CHANNEL) | DMA_CR_MINC | DMA_CR_DIR_TO_PERIPHERAL | DMA_CR_TCIE |
              DMA_CR_TEIE | DMA_CR_EN;
}

void link_sent_handler(void) {
    dma_clear_flags(LINK_DMA, LINK_TX_STREAM);
    sent_us = uptime_us();
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

/* Return true if the last byte has been sent. TC alone does not show this: if the byte before a
 * transfer ends between the clear of TC and the first write of DMA, TC stays set during the whole
 * transfer (30.3.2). After the last write, the data register and the shift register hold at most two
 * bytes. */
static bool idle(void) {
    return (LINK_UART->sr & USART_SR_TC) != 0 && uptime_us() - sent_us > 2u * BYTE_NS / 1000u;
}

bool uart_drained(void) { return tx_put == tx_sent && idle(); }

uint32_t board_uart_wait_us(board_t *board) {
    const uint32_t state = irq_save();
    const uint32_t left = tx_under_way != 0 ? OUT->ndtr : 0;
    const uint32_t waiting = tx_put - tx_sent - tx_under_way + left;
    irq_restore(state);
    if (waiting == 0 && idle()) {
        return 0;
    }
    return (waiting + 1u) * BYTE_NS / 1000u; /* plus the byte in the shift register */
}
