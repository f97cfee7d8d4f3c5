/* One host at a time: who it is, whether the handshake is complete, and what it may move. */
#ifndef SESSION_H
#define SESSION_H

#include "firmware_state.h"

/* Take an intact frame of a host that had arrived at this moment of uptime. */
void session_receive(firmware_t *firmware, sp_frame_t *frame, int64_t arrived_us);

/* Once a control period: is it still there? */
void session_tick(firmware_t *firmware);

/* Say who we are. */
void session_hello(firmware_t *firmware, int64_t now_us);

/* Say what a count of the IMU is worth: after each hello once the handshake is complete, and at 1 Hz. */
void session_imu_info(firmware_t *firmware, int64_t now_us);

#endif
