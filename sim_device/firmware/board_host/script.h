/* Runs the firmware on a board that a script controls: see script.c. */
#ifndef SCRIPT_H
#define SCRIPT_H

#include <stddef.h>
#include <stdint.h>

/* Maximum length of a record. */
#define SCRIPT_RECORD_MAX (7u + 65535u)

typedef void script_write_t(void *to, const uint8_t *data, size_t length);

/* Boot for the first time. `life_us` is the maximum time of the run, for any script. */
void script_begin(uint64_t life_us);

/* Run the complete records in `data`; pass the result of each step to `write`. Return the number of
 * used bytes. The rest is the beginning of a record. */
size_t script_take(const uint8_t *data, size_t length, script_write_t *write, void *to);

#endif
