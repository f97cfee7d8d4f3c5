/* The last replies by session, id and type, so that a repeated command is answered again and not
 * carried out again. Ids count up within a session, so each has a place of its own among the last
 * sixteen. */
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
    uint8_t reason; /* SP_NACK_REASON_*, where refused */
} reply_t;

typedef struct {
    reply_t replies[COMMANDS_REMEMBERED];
    uint32_t session_id;
    uint16_t newest_id;
} command_log_t;

/* The reply that a command got before; else NULL. */
const reply_t *command_log_find(
    const command_log_t *log, uint32_t session_id, uint16_t command_id, uint8_t type);

/* Whether an id is older than the last sixteen of its session, and so cannot be told from a
 * repeated one; else it is taken for the newest where it is newer. Session 0 is none. */
bool command_log_is_stale(command_log_t *log, uint32_t session_id, uint16_t command_id);

/* Remember a reply, in the place of its id; gives it as it is kept. */
const reply_t *command_log_add(command_log_t *log, const reply_t *reply);

#endif
