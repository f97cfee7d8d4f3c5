#ifndef REGISTER_WATCH_H
#define REGISTER_WATCH_H

#include <stdbool.h>
#include <stdint.h>

/* Call `after` after each access to the registers in the page of this address, with the address and
 * the kind of access. `after` may use the registers itself. NULL ends the watch. Return false if this
 * computer's processor is not supported. */
bool watch_registers(uintptr_t address, void (*after)(uintptr_t address, bool write));

#endif
