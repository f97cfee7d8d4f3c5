#ifndef STARTUP_H
#define STARTUP_H

#include <stddef.h>

void reset_handler(void);
void fault_handler(void);
int main(void);

/* Bytes of the stack that have never been used since reset. */
size_t startup_stack_free(void);

typedef void (*handler_t)(void);

#endif
