#ifndef STARTUP_H
#define STARTUP_H

#include <stddef.h>

#include "board.h"

void reset_handler(void);
void start_program(void); /* called by reset_handler */
void fault_handler(void);
int main(void);

/* Return the number of stack bytes that have not been used since reset. */
size_t startup_stack_free(void);

/* Return the crash record of the previous boot and delete it. NULL: no crash. */
const board_crash_t *startup_take_crash(void);

typedef void (*handler_t)(void);

#endif
