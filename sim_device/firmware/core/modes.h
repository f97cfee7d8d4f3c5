/* The device's modes as a table: the effect of each event in each state, with conditions. */
#ifndef MODES_H
#define MODES_H

#include <stdbool.h>
#include <stdint.h>

/* States of the device. Off and booting are missing: no program runs there. */
typedef enum {
    STATE_STOPPED, /* a stop is latched */
    STATE_IDLE,
    STATE_VELOCITY,
    STATE_BRINGUP,
    STATE_ONBOARD, /* ready for the device's own planner */
    STATE_RUNNING, /* the planner drives */
    STATE_PAUSED,  /* the planner is paused and keeps its plan */
    STATES
} state_t;

typedef enum {
    EVENT_STOP,
    EVENT_CLEAR,
    EVENT_SET_IDLE,
    EVENT_SET_VELOCITY,
    EVENT_SET_BRINGUP,
    EVENT_SET_ONBOARD,
    EVENT_START,
    EVENT_PAUSE,
    EVENT_RESUME,
    EVENT_ABORT,
    EVENT_FINISHED,
    EVENT_FAULT,
    EVENT_SILENCE,
    EVENT_NEW_SESSION,
    EVENTS
} event_t;

/* Conditions that reject an event, as bits of what is true now. */
enum {
    GUARD_OTHER_CAUSE = 1, /* the latch holds another cause than the named one */
    GUARD_CAUSE_HOLDS = 2, /* the cause of the stop is still present */
    GUARD_FAULT_HOLDS = 4, /* a stopping fault is present */
    GUARD_NO_PLANNER = 8   /* no such planner */
};

/* Outcome of an event: a new state, a rejection with its reason, or nothing. */
typedef struct {
    bool went;
    bool refused;
    uint8_t reason; /* SP_NACK_REASON_*, if rejected */
} outcome_t;

/* Apply an event; return the table's outcome after the change of `state`. */
outcome_t modes_fire(state_t *state, event_t event, unsigned holding);

/* Return the SP_MODE_* of a state for the status message. */
uint8_t modes_wire_mode(state_t state);

/* Return whether the state has a plan. */
static inline bool modes_planning(state_t state)
{
    return state == STATE_RUNNING || state == STATE_PAUSED;
}

#endif
