/* The functions that the example needs of a board. On a chip these are a few lines each: a UART
 * with a DMA ring to read from and a queue to write to, a microsecond counter, sensors, two motors.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Sleep until bytes arrive or a millisecond has passed; false: end (never on a chip). */
bool board_wait(void);

/* Microseconds since boot; wraps. */
uint32_t board_time_us(void);

/* Read the received bytes, at most `room`. */
size_t board_read(uint8_t *data, size_t room);

/* Queue a complete frame, or nothing if it does not fit. */
void board_write(const uint8_t *data, size_t length);

/* Return whether all queued bytes have left. */
bool board_line_idle(void);

void board_uid(uint8_t uid[12]);
uint32_t board_random(void);

/* Registers of the MPU6050 in its order: acceleration, temperature, rates. */
void board_imu(int16_t raw[7]);
void board_encoders(uint16_t *left, uint16_t *right);

/* Body velocity for the wheel control; zero ramps to rest. */
void board_drive(float v_m_s, float yaw_rate_rad_s);

#endif
