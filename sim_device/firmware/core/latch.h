/* The latched stop: the most severe cause stays latched until a command clears this cause. */
#ifndef LATCH_H
#define LATCH_H

#include <stdbool.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

typedef struct {
    uint8_t cause; /* SP_STOP_CAUSE_* */
} latch_t;

/* Latch a cause; return false if an equal or more severe cause is already latched. */
static inline bool latch_set(latch_t *latch, uint8_t cause)
{
    const uint8_t held = latch->cause;
    latch->cause = sp_latched_cause(held, cause);
    return latch->cause != held;
}

/* Release the latch if `cause` is the latched cause; return whether it was released. */
static inline bool latch_clear(latch_t *latch, uint8_t cause)
{
    if (latch->cause == 0 || cause != latch->cause) {
        return false;
    }
    latch->cause = 0;
    return true;
}

#endif
