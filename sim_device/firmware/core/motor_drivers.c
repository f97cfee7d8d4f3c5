#include "motor_drivers.h"

/* Number of control periods for which the motors continue to brake at rest after a latched stop:
 * 0.5 s. Without braking, a robot on a slope would roll on. */
#define BRAKE_TICKS 50u

void motor_drivers_switch(motor_drivers_t *drivers, state_t state, bool rests)
{
    if (state != STATE_STOPPED && state != STATE_IDLE) {
        drivers->enabled = true;
        drivers->rest_ticks = 0;
    } else if (drivers->enabled) {
        drivers->rest_ticks = rests ? (uint8_t)(drivers->rest_ticks + 1u) : 0u;
        drivers->enabled = drivers->rest_ticks < (state == STATE_STOPPED ? BRAKE_TICKS : 1u);
    }
}
