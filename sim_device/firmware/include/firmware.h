/* The functions of the core that a board calls. The core uses no heap and has no variables: the
 * whole state of a device is in one firmware_t, which the caller owns. It must be zero before the
 * first boot. */
#ifndef FIRMWARE_H
#define FIRMWARE_H

#include <stddef.h>
#include <stdint.h>

#include "board.h"

/* ---- from the main loop (main.c does it) ---------------------------------------------------- */

/* Boot or reboot the device: the state is a latched stop without a host. Call it after
 * board_start(); a host program may call it several times. */
void firmware_boot(firmware_t *firmware, board_t *board);

/* Do all due work: process received data, run the control loop if its period is over, send data.
 * Call it at least once per millisecond; between two calls board_idle() may sleep. */
void firmware_poll(firmware_t *firmware);

/* ---- from interrupts ------------------------------------------------------------------------ */

/* Receive bytes from the UART with their arrival time: one byte from the receive interrupt, or a
 * block from a DMA ring buffer (half full, full or idle line). The function copies the bytes, in
 * about 20 cycles per byte. A frame's arrival is the time of its closing zero. So in an idle-line
 * interrupt, pass the time of the interrupt minus the idle character (the duration of one byte).
 * Two interrupts that can interrupt each other must not both call it. */
void firmware_uart_received(
    firmware_t *firmware, const uint8_t *data, size_t length, uint32_t arrived_us);

/* Receive a data frame with an 11-bit identifier, from the CAN controller's FIFO interrupt. */
void firmware_can_received(
    firmware_t *firmware, const sp_can_frame_t *frame, uint32_t arrived_us);

/* Count a frame that the CAN controller has lost, because its FIFO was full. From the same
 * interrupt. */
void firmware_can_lost(firmware_t *firmware);

#endif
