/* Names of wire values, for log lines. */
#ifndef NAMES_H
#define NAMES_H

#include <stdint.h>

#include "text.h"

/* Of a SP_STOP_CAUSE_*. */
const char *name_of_cause(uint8_t cause);

/* Of each SP_FAULT_* that is set, with commas between. */
void add_fault_names(text_t *line, uint16_t bits);

#endif
