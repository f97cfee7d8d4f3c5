/* The device's modes as a transition table: the effect of each event in each state. */
#ifndef MODES_H
#define MODES_H

#include <stdbool.h>
#include <stdint.h>

#include "mode_table.h"

/* States of the device: STATE_STOPPED and so on. Off and booting are omitted, because no program
 * runs in these states. */
typedef enum {
#define STATE(state, mode) STATE_##state,
    MODE_STATES(STATE)
#undef STATE
        STATES
} state_t;

typedef enum {
#define EVENT(event) EVENT_##event,
    MODE_EVENTS(EVENT)
#undef EVENT
        EVENTS
} event_t;

/* Conditions that reject an event: one bit per condition. */
enum {
#define GUARD(condition, bit) GUARD_##condition = bit,
    MODE_GUARDS(GUARD)
#undef GUARD
};

/* Outcome of an event: a new state, a rejection with its reason, or nothing. */
typedef struct {
    bool went;
    bool rejected;
    uint8_t reason; /* SP_NACK_REASON_*, if rejected */
} outcome_t;

/* Apply an event and change `state`; return the outcome from the table. */
outcome_t modes_fire(state_t *state, event_t event, unsigned holding);

/* Return the SP_MODE_* of a state for the status message. */
uint8_t modes_wire_mode(state_t state);

/* Return whether a plan exists in this state. */
static inline bool modes_planning(state_t state)
{
    return state == STATE_RUNNING || state == STATE_PAUSED;
}

#endif
