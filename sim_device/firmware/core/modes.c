#include "modes.h"

#include "sweepctl_protocol.h"

#define IN(state) (1u << STATE_##state)
#define ALL ((1u << STATES) - 1u)
#define FREE (ALL & ~IN(STOPPED))

typedef struct {
    uint8_t states; /* bit set */
    uint8_t event;
    uint8_t guard;   /* 0: always; else the condition */
    uint8_t outcome; /* a state, or a reason with REJECTED */
} row_t;

#define REJECTED 0x80u

/* The transition table. The first row that matches the state and the event and has a true guard
 * applies. If there is no such row, nothing happens. */
static const row_t table[] = {
#define ENTER(states, event, guard, state) {states, EVENT_##event, guard, STATE_##state},
#define REJECT(states, event, guard, reason)                                                      \
    {states, EVENT_##event, guard, REJECTED | SP_NACK_REASON_##reason},
    MODE_ROWS(ENTER, REJECT)
#undef ENTER
#undef REJECT
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
        if (row->outcome & REJECTED) {
            outcome.rejected = true;
            outcome.reason = row->outcome & (uint8_t)~REJECTED;
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
#define STATE(state, mode) SP_MODE_##mode,
        MODE_STATES(STATE)
#undef STATE
    };
    return mode[state];
}
