/* The motor drivers' enable input: on in a driving mode, off when a stopped robot is at rest. */
#ifndef MOTOR_DRIVERS_H
#define MOTOR_DRIVERS_H

#include <stdbool.h>
#include <stdint.h>

#include "modes.h"

typedef struct {
    bool enabled;
    uint8_t rest_ticks; /* control periods at rest with enabled drivers */
} motor_drivers_t;

/* Switch the drivers in one control period. In a driving mode they are enabled. In idle they are
 * disabled when the robot is at rest, and in a latched stop 0.5 s later. `rests`: the duties are 0
 * and the wheels do not turn. */
void motor_drivers_switch(motor_drivers_t *drivers, state_t state, bool rests);

#endif
