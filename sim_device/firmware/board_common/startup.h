#ifndef STARTUP_H
#define STARTUP_H

#include <stddef.h>

#include "board.h"

void reset_handler(void);
void fault_handler(void);
int main(void);

/* Bytes of the stack that have never been used since reset. */
size_t startup_stack_free(void);

/* What the fault handler kept in the life before, once: the next start finds nothing more. NULL: it
 * did not end so. */
const board_crash_t *startup_take_crash(void);

typedef void (*handler_t)(void);

#endif
