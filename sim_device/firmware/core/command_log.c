#include "command_log.h"

#include <stddef.h>

/* Half of the range of command ids. Ids wrap at 16 bits, so an id that is less than this number
 * behind another id is older (RFC 1982). */
#define HALF 0x8000u

const reply_t *command_log_find(
    const command_log_t *log, uint32_t session_id, uint16_t command_id, uint8_t type)
{
    const reply_t *const known = &log->replies[command_id % COMMANDS_REMEMBERED];
    const bool same = known->used && known->session_id == session_id
        && known->command_id == command_id && known->type == type;
    return same ? known : NULL;
}

bool command_log_is_stale(command_log_t *log, uint32_t session_id, uint16_t command_id)
{
    const uint16_t behind = (uint16_t)(log->newest_id - command_id);
    if (session_id != 0 && session_id == log->session_id && behind < HALF) {
        return behind >= COMMANDS_REMEMBERED;
    }
    log->session_id = session_id;
    log->newest_id = command_id;
    return false;
}

const reply_t *command_log_add(command_log_t *log, const reply_t *reply)
{
    reply_t *const place = &log->replies[reply->command_id % COMMANDS_REMEMBERED];
    *place = *reply;
    place->used = true;
    return place;
}
