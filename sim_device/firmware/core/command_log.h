/* The last replies by session, id and type, so that a repeated command is answered again and not
 * carried out again. */
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
    uint8_t next;
} command_log_t;

/* The reply that a command got before; else NULL. */
const reply_t *command_log_find(
    const command_log_t *log, uint32_t session_id, uint16_t command_id, uint8_t type);

/* Remember a reply, in the oldest one's place; gives it as it is kept. */
const reply_t *command_log_add(command_log_t *log, const reply_t *reply);

#endif
