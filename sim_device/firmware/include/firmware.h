/* What a board calls: the firmware's core from outside. No heap and no variables of its own: all
 * state of a device is in one firmware_t, which the caller owns. It is zero before its first boot.
 */
#ifndef FIRMWARE_H
#define FIRMWARE_H

#include <stddef.h>
#include <stdint.h>

#include "board.h"

/* ---- from the main loop (main.c does it) --------------------------------------------------- */

/* Begin anew: latched, idle, nothing known. After board_start(); on the host as often as wanted. */
void firmware_boot(firmware_t *firmware, board_t *board);

/* Do what is due: take what has come, run the control loop if its period is over, send. To be
 * called at least once a millisecond; between two calls board_idle() may sleep. */
void firmware_poll(firmware_t *firmware);

/* ---- from interrupts ----------------------------------------------------------------------- */

/* Bytes from the UART and the moment at which they had arrived: of one byte from the receive
 * interrupt, or of a block from the DMA ring at half, full or idle line. It copies and returns:
 * about 20 cycles a byte. A frame's arrival is the moment of its closing zero: on an idle-line
 * interrupt pass the time of the interrupt less the idle character (one byte's time).
 * Not to be called from two interrupts that can interrupt each other. */
void firmware_uart_received(
    firmware_t *firmware, const uint8_t *data, size_t length, uint32_t arrived_us);

/* A data frame with an 11-bit identifier from the CAN controller's FIFO interrupt. */
void firmware_can_received(
    firmware_t *firmware, const sp_can_frame_t *frame, uint32_t arrived_us);

#endif
