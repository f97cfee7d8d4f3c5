/* What the firmware does with each command, and why it refuses. */
#ifndef COMMANDS_H
#define COMMANDS_H

#include "firmware_state.h"

/* Take a command: carried out once, answered each time. */
void commands_receive(firmware_t *firmware, const sp_frame_t *frame, int64_t now_us);

/* Answer a command. */
void commands_answer(firmware_t *firmware, const reply_t *reply, int64_t now_us);

/* A save has ended: its answer is given now, and again for a repeated command. */
void commands_saved(firmware_t *firmware, bool saved);

#endif
