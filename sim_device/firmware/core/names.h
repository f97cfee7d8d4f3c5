/* Names of enumeration values, for log lines. */
#ifndef NAMES_H
#define NAMES_H

#include <stdint.h>

#include "text.h"

/* Return the name of a SP_STOP_CAUSE_*. */
const char *name_of_cause(uint8_t cause);

/* Add the name of each set SP_FAULT_*, separated by commas. */
void add_fault_names(text_t *line, uint16_t bits);

#endif
