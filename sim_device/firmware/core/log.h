/* Queue of log lines for the host, with a limited rate. */
#ifndef LOG_H
#define LOG_H

#include <stdbool.h>
#include <stdint.h>

#include "text.h"

#define LOG_PERIOD_US 100000 /* minimum time between lines, us: ten lines per second */
#ifndef LOG_WAITING
#define LOG_WAITING 16u /* a full queue drops its oldest line */
#endif

typedef struct {
    uint8_t level; /* SP_LOG_LEVEL_* */
    text_t text;
} log_line_t;

typedef struct {
    log_line_t lines[LOG_WAITING];
    uint8_t first;
    uint8_t count;
    bool sent;
    int64_t sent_us;
} log_t;

/* Queue an empty line and return it; the caller then writes its text. */
text_t *log_begin(log_t *log, uint8_t level);

/* Queue a complete line. */
void log_add(log_t *log, uint8_t level, const char *utf8);

/* Return the next line, or NULL if no line may be sent now. The line is valid until the next
 * call. */
const log_line_t *log_take(log_t *log, int64_t now_us);

#endif
