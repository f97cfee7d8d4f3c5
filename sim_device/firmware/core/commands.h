/* What the firmware does with each command, and why it refuses. */
#ifndef COMMANDS_H
#define COMMANDS_H

#include "firmware_state.h"

/* Use the key that is stored. */
void commands_use_key(firmware_t *firmware, const stored_t stored[FLASH_VALUES]);

/* Tell a host what it needs to sign in this session, where a key is set. */
void commands_challenge(firmware_t *firmware, int64_t now_us);

/* Refuse what needs a tag and has none: a command is answered, a setpoint counted. */
void commands_refuse(firmware_t *firmware, const sp_frame_t *frame, int64_t now_us);

/* Take a command: carried out once, answered each time. */
void commands_receive(firmware_t *firmware, const sp_frame_t *frame, int64_t now_us);

/* Answer a command. */
void commands_answer(firmware_t *firmware, const reply_t *reply, int64_t now_us);

/* A save has ended, of the parameters or of a key: what stands counts now. Its answer is given, and
 * again for a repeated command. */
void commands_saved(firmware_t *firmware, bool saved);

#endif
