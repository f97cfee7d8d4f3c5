/* The firmware on a board that a script controls: see script.c. */
#ifndef SCRIPT_H
#define SCRIPT_H

#include <stddef.h>
#include <stdint.h>

/* Maximum length of a record. */
#define SCRIPT_RECORD_MAX (7u + 65535u)

typedef void script_write_t(void *to, const uint8_t *data, size_t length);

/* Boot for the first time. The run ends at this time at the latest, whatever the steps say. */
void script_begin(uint64_t life_us);

/* Run the complete records among these bytes; the result of each step goes to `write`. Return the
 * number of bytes used: the rest is the beginning of a record. */
size_t script_take(const uint8_t *data, size_t length, script_write_t *write, void *to);

#endif
