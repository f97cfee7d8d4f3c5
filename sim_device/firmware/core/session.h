/* The session with one host: handshake, and the host's permission to move the robot. */
#ifndef SESSION_H
#define SESSION_H

#include "firmware_state.h"

/* Process a host's intact frame that arrived at this uptime. */
void session_receive(firmware_t *firmware, sp_frame_t *frame, int64_t arrived_us);

/* Call once per control period: check that the host is still present. */
void session_tick(firmware_t *firmware);

/* Send the device's hello. */
void session_hello(firmware_t *firmware, int64_t now_us);

/* Send the scale of the IMU's counts. After the handshake it is sent after each hello and once per
 * second. */
void session_imu_info(firmware_t *firmware, int64_t now_us);

#endif
