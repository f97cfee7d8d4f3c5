/* The device's modes as a table: what each event does in each state, and on what condition. */
#ifndef MODES_H
#define MODES_H

#include <stdbool.h>
#include <stdint.h>

/* Where the device stands. Off and booting are not here: then no program runs. */
typedef enum {
    STATE_STOPPED, /* a stop is latched */
    STATE_IDLE,
    STATE_VELOCITY,
    STATE_BRINGUP,
    STATE_ONBOARD, /* ready for the device's own planner */
    STATE_RUNNING, /* which drives */
    STATE_PAUSED,  /* which holds still, its plan kept */
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

/* Conditions on which an event is refused, as bits of what holds now. */
enum {
    GUARD_OTHER_CAUSE = 1, /* another cause than the one named holds the latch */
    GUARD_CAUSE_HOLDS = 2, /* the fault that stopped it persists */
    GUARD_FAULT_HOLDS = 4, /* a stopping fault holds */
    GUARD_NO_PLANNER = 8   /* no such planner */
};

/* What came of an event: gone to a state, refused for a reason, or nothing to do. */
typedef struct {
    bool went;
    bool refused;
    uint8_t reason; /* SP_NACK_REASON_*, where refused */
} outcome_t;

/* Let an event happen: gives what the table says, `state` being changed already. */
outcome_t modes_fire(state_t *state, event_t event, unsigned holding);

/* SP_MODE_* that the status message says of a state. */
uint8_t modes_told(state_t state);

/* Whether there is a plan. */
static inline bool modes_planning(state_t state)
{
    return state == STATE_RUNNING || state == STATE_PAUSED;
}

#endif
