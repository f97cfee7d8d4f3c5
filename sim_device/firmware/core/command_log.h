/* Stores the last replies by session, id and type. A repeated command gets its reply again but is
 * not executed again. Ids count up within a session, so each of the last sixteen ids has its own
 * slot. */
#ifndef COMMAND_LOG_H
#define COMMAND_LOG_H

#include <stdbool.h>
#include <stdint.h>

#define COMMANDS_REMEMBERED 16u

typedef struct {
    uint32_t session_id;
    uint16_t command_id;
    uint8_t type;
    bool used;
    bool accepted;
    uint8_t reason; /* SP_NACK_REASON_*, if rejected */
} reply_t;

typedef struct {
    reply_t replies[COMMANDS_REMEMBERED];
    uint32_t session_id;
    uint16_t newest_id;
} command_log_t;

/* Return the earlier reply to a command, or NULL. */
const reply_t *command_log_find(
    const command_log_t *log, uint32_t session_id, uint16_t command_id, uint8_t type);

/* Return whether an id is older than the last sixteen ids of its session; its command may then be a
 * repeat. Otherwise store it as the newest id if it is newer. Session 0 means no session. */
bool command_log_is_stale(command_log_t *log, uint32_t session_id, uint16_t command_id);

/* Store a reply in the slot of its id; return the stored copy. */
const reply_t *command_log_add(command_log_t *log, const reply_t *reply);

#endif
