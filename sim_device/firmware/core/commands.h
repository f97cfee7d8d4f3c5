/* Execution of each command by the firmware, and the reasons for rejections. */
#ifndef COMMANDS_H
#define COMMANDS_H

#include "firmware_state.h"

/* Use the stored key. */
void commands_use_key(firmware_t *firmware, const stored_t stored[FLASH_VALUES]);

/* If a key is set, send the challenge, which a host needs to sign frames in this session. */
void commands_challenge(firmware_t *firmware, int64_t now_us);

/* Reject a frame without the required tag: send a Nack for a command, count a setpoint. */
void commands_reject(firmware_t *firmware, const sp_frame_t *frame, int64_t now_us);

/* Process a command: execute it once, reply each time. */
void commands_receive(firmware_t *firmware, const sp_frame_t *frame, int64_t now_us);

/* Send the reply to a command. */
void commands_answer(firmware_t *firmware, const reply_t *reply, int64_t now_us);

/* Finish a save of the parameters or of a key: use the stored values and send the reply. */
void commands_saved(firmware_t *firmware, bool saved);

#endif
