/* The firmware's reaction to each command, and its reasons to reject one. */
#ifndef COMMANDS_H
#define COMMANDS_H

#include "firmware_state.h"

/* Use the stored key. */
void commands_use_key(firmware_t *firmware, const stored_t stored[FLASH_VALUES]);

/* Send a host the data that it needs to sign in this session, if a key is set. */
void commands_challenge(firmware_t *firmware, int64_t now_us);

/* Reject a frame that needs a tag and has none: answer a command, count a setpoint. */
void commands_refuse(firmware_t *firmware, const sp_frame_t *frame, int64_t now_us);

/* Take a command: execute it once, answer it each time. */
void commands_receive(firmware_t *firmware, const sp_frame_t *frame, int64_t now_us);

/* Answer a command. */
void commands_answer(firmware_t *firmware, const reply_t *reply, int64_t now_us);

/* Finish a save of the parameters or of a key: use what is stored and send the answer, again for a
 * repeated command. */
void commands_saved(firmware_t *firmware, bool saved);

#endif
