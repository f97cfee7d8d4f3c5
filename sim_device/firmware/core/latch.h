/* The latched stop: the gravest cause stays until a command clears it by name. */
#ifndef LATCH_H
#define LATCH_H

#include <stdbool.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

typedef struct {
    uint8_t cause; /* SP_STOP_CAUSE_* */
} latch_t;

/* Latch a cause; return false if an equal or graver cause is latched already. */
static inline bool latch_set(latch_t *latch, uint8_t cause)
{
    const uint8_t held = latch->cause;
    latch->cause = sp_latched_cause(held, cause);
    return latch->cause != held;
}

/* Release the latch if it holds `cause`; return whether it did. */
static inline bool latch_clear(latch_t *latch, uint8_t cause)
{
    if (latch->cause == 0 || cause != latch->cause) {
        return false;
    }
    latch->cause = 0;
    return true;
}

#endif
