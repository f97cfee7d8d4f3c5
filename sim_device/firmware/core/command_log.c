#include "command_log.h"

#include <stddef.h>

const reply_t *command_log_find(
    const command_log_t *log, uint32_t session_id, uint16_t command_id, uint8_t type)
{
    for (unsigned i = 0; i < COMMANDS_REMEMBERED; i++) {
        const reply_t *const known = &log->replies[i];
        if (known->used && known->session_id == session_id && known->command_id == command_id
            && known->type == type) {
            return known;
        }
    }
    return NULL;
}

const reply_t *command_log_add(command_log_t *log, const reply_t *reply)
{
    reply_t *const place = &log->replies[log->next];
    log->next = (uint8_t)((log->next + 1u) % COMMANDS_REMEMBERED);
    *place = *reply;
    place->used = true;
    return place;
}
