/* The functions of the core that a board calls. No heap and no variables of its own: the whole
 * state of a device is in one firmware_t, which the caller owns. It is zero before its first boot.
 */
#ifndef FIRMWARE_H
#define FIRMWARE_H

#include <stddef.h>
#include <stdint.h>

#include "board.h"

/* ---- from the main loop (main.c does it) ---------------------------------------------------- */

/* Restart: latched, idle, without a host. Call it after board_start(); on the host, any number of
 * times. */
void firmware_boot(firmware_t *firmware, board_t *board);

/* Do all due work: take received data, run the control loop if its period is over, send. Call it at
 * least once a millisecond; between two calls board_idle() may sleep. */
void firmware_poll(firmware_t *firmware);

/* ---- from interrupts ------------------------------------------------------------------------ */

/* Bytes from the UART and their arrival time: one byte from the receive interrupt, or a block from
 * the DMA ring at half, full or idle line. The function copies and returns: about 20 cycles a byte.
 * A frame's arrival is the time of its closing zero: on an idle-line interrupt pass the time of the
 * interrupt minus the idle character (one byte's time). Two interrupts that can interrupt each
 * other must not both call it. */
void firmware_uart_received(
    firmware_t *firmware, const uint8_t *data, size_t length, uint32_t arrived_us);

/* A data frame with an 11-bit identifier from the CAN controller's FIFO interrupt. */
void firmware_can_received(
    firmware_t *firmware, const sp_can_frame_t *frame, uint32_t arrived_us);

#endif
