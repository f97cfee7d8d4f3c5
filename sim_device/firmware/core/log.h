/* Lines for people, on their way to the host: few enough not to crowd the wire. */
#ifndef LOG_H
#define LOG_H

#include <stdbool.h>
#include <stdint.h>

#include "text.h"

#define LOG_PERIOD_US 100000 /* at most ten lines a second ... */
#ifndef LOG_WAITING
#define LOG_WAITING 16u /* ... what waits longer is dropped, oldest first */
#endif

typedef struct {
    uint8_t level; /* SP_LOG_LEVEL_* */
    text_t text;
} log_line_t;

typedef struct {
    log_line_t lines[LOG_WAITING];
    uint8_t first;
    uint8_t count;
    bool told;
    int64_t told_us;
} log_t;

/* Queue an empty line, to be written by the caller: a line is put together where it waits. */
text_t *log_begin(log_t *log, uint8_t level);

/* Queue a line of one piece. */
void log_add(log_t *log, uint8_t level, const char *utf8);

/* The next line, if one may be sent now; NULL: none. It stands until the next call. */
const log_line_t *log_take(log_t *log, int64_t now_us);

#endif
