#include "log.h"

#include <stddef.h>

text_t *log_begin(log_t *log, uint8_t level)
{
    if (log->count == LOG_WAITING) {
        log->first = (uint8_t)((log->first + 1u) % LOG_WAITING);
        log->count--;
    }
    log_line_t *const line = &log->lines[(log->first + log->count) % LOG_WAITING];
    log->count++;
    line->level = level;
    line->text.length = 0;
    line->text.full = false;
    return &line->text;
}

void log_add(log_t *log, uint8_t level, const char *utf8)
{
    text_add(log_begin(log, level), utf8);
}

const log_line_t *log_take(log_t *log, int64_t now_us)
{
    if (log->count == 0 || (log->sent && now_us - log->sent_us < LOG_PERIOD_US)) {
        return NULL;
    }
    const log_line_t *const line = &log->lines[log->first];
    log->first = (uint8_t)((log->first + 1u) % LOG_WAITING);
    log->count--;
    log->sent = true;
    log->sent_us = now_us;
    return line;
}
