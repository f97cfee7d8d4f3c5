/* The control period, in which all timed work happens. */
#ifndef PERIOD_H
#define PERIOD_H

#include <stdbool.h>
#include <stdint.h>

#define PERIOD_US 10000
#define PERIOD_S 0.01f
#define PERIODS_PER_SECOND 100u

/* Return whether work with this period and phase is due in control period `tick`, or was due in one
 * of the `ticks` - 1 missed control periods before it. */
static inline bool due_every(uint32_t periods, uint32_t phase, uint32_t tick, uint32_t ticks)
{
    return (tick % periods + periods - phase) % periods < ticks;
}

#endif
