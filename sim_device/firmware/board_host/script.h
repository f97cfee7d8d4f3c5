/* The firmware on a board that a script plays: see script.c. */
#ifndef SCRIPT_H
#define SCRIPT_H

#include <stddef.h>
#include <stdint.h>

/* No record is longer. */
#define SCRIPT_RECORD_MAX (7u + 65535u)

typedef void script_write_t(void *to, const uint8_t *data, size_t length);

/* Boot for the first time; the life that follows is no longer than this, whatever steps say. */
void script_begin(uint64_t life_us);

/* Run the whole records among these bytes; what each step brought about goes to `write`. Gives how
 * many bytes were taken: the rest is the beginning of a record. */
size_t script_take(const uint8_t *data, size_t length, script_write_t *write, void *to);

#endif
