#include "modes.h"

#include "sweepctl_protocol.h"

#define IN(state) (1u << STATE_##state)
#define ALL ((1u << STATES) - 1u)
#define FREE (ALL & ~IN(STOPPED))
#define PLANNING (IN(RUNNING) | IN(PAUSED))
/* States that a stopping fault ends. Bring-up is not one of them: there the wheels are off the
 * floor, their duty is limited, and a person stands by. */
#define GUARDED (IN(VELOCITY) | IN(ONBOARD) | PLANNING)

typedef struct {
    uint8_t states; /* bit set */
    uint8_t event;
    uint8_t guard;   /* 0: always; else the condition */
    uint8_t outcome; /* a state, or REFUSE(reason) */
} row_t;

#define REFUSED 0x80u
#define REFUSE(reason) (REFUSED | SP_NACK_REASON_##reason)

/* The first row for the state and the event whose guard is true applies. Without a row nothing
 * happens. */
static const row_t table[] = {
    {ALL, EVENT_STOP, 0, STATE_STOPPED},
    {FREE, EVENT_SILENCE, 0, STATE_STOPPED},
    {FREE, EVENT_NEW_SESSION, 0, STATE_STOPPED},
    {GUARDED, EVENT_FAULT, 0, STATE_STOPPED},

    {IN(STOPPED), EVENT_CLEAR, GUARD_OTHER_CAUSE, REFUSE(OTHER_CAUSE)},
    {IN(STOPPED), EVENT_CLEAR, GUARD_CAUSE_HOLDS, REFUSE(FAULT)},
    {IN(STOPPED), EVENT_CLEAR, 0, STATE_IDLE},

    {FREE, EVENT_SET_IDLE, 0, STATE_IDLE},
    {IN(STOPPED), EVENT_SET_VELOCITY, 0, REFUSE(STOP_LATCHED)},
    {FREE, EVENT_SET_VELOCITY, GUARD_FAULT_HOLDS, REFUSE(FAULT)},
    {FREE, EVENT_SET_VELOCITY, 0, STATE_VELOCITY},
    {IN(STOPPED), EVENT_SET_BRINGUP, 0, REFUSE(STOP_LATCHED)},
    {FREE, EVENT_SET_BRINGUP, 0, STATE_BRINGUP},
    {IN(STOPPED), EVENT_SET_ONBOARD, 0, REFUSE(STOP_LATCHED)},
    {FREE & ~PLANNING, EVENT_SET_ONBOARD, GUARD_FAULT_HOLDS, REFUSE(FAULT)},
    {FREE & ~PLANNING, EVENT_SET_ONBOARD, 0, STATE_ONBOARD},

    {IN(STOPPED), EVENT_START, 0, REFUSE(STOP_LATCHED)},
    {FREE & ~IN(ONBOARD), EVENT_START, 0, REFUSE(OTHER_MODE)},
    {IN(ONBOARD), EVENT_START, GUARD_NO_PLANNER, REFUSE(UNSUPPORTED)},
    {IN(ONBOARD), EVENT_START, GUARD_FAULT_HOLDS, REFUSE(FAULT)},
    {IN(ONBOARD), EVENT_START, 0, STATE_RUNNING},
    {IN(STOPPED), EVENT_PAUSE, 0, REFUSE(STOP_LATCHED)},
    {FREE & ~PLANNING, EVENT_PAUSE, 0, REFUSE(OTHER_MODE)},
    {IN(RUNNING), EVENT_PAUSE, 0, STATE_PAUSED},
    {IN(STOPPED), EVENT_RESUME, 0, REFUSE(STOP_LATCHED)},
    {FREE & ~PLANNING, EVENT_RESUME, 0, REFUSE(OTHER_MODE)},
    {IN(PAUSED), EVENT_RESUME, GUARD_FAULT_HOLDS, REFUSE(FAULT)},
    {IN(PAUSED), EVENT_RESUME, 0, STATE_RUNNING},
    {PLANNING, EVENT_ABORT, 0, STATE_IDLE},
    {IN(RUNNING), EVENT_FINISHED, 0, STATE_IDLE},
};

outcome_t modes_fire(state_t *state, event_t event, unsigned holding)
{
    outcome_t outcome = {false, false, 0};
    for (unsigned i = 0; i < sizeof table / sizeof table[0]; i++) {
        const row_t *const row = &table[i];
        if ((row->states >> *state & 1u) == 0 || row->event != event
            || (row->guard != 0 && (row->guard & holding) == 0)) {
            continue;
        }
        if (row->outcome & REFUSED) {
            outcome.refused = true;
            outcome.reason = row->outcome & (uint8_t)~REFUSED;
        } else {
            outcome.went = true;
            *state = (state_t)row->outcome;
        }
        break;
    }
    return outcome;
}

uint8_t modes_wire_mode(state_t state)
{
    static const uint8_t mode[STATES] = {
        SP_MODE_IDLE, /* stopped */
        SP_MODE_IDLE,
        SP_MODE_VELOCITY,
        SP_MODE_BRINGUP,
        SP_MODE_ONBOARD,
        SP_MODE_ONBOARD,
        SP_MODE_ONBOARD,
    };
    return mode[state];
}
