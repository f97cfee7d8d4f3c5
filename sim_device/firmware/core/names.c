#include "names.h"

const char *name_of_cause(uint8_t cause)
{
    static const char *const names[] = {
        "none", "session_end", "link", "supervise", "operator", "hardware"};
    return cause < sizeof names / sizeof names[0] ? names[cause] : "unknown";
}

void add_fault_names(text_t *line, uint16_t bits)
{
    static const char *const names[] = {"imu", "encoder_left", "encoder_right", "ultrasonic",
        "infrared", "motor_stall", "battery_low", "setpoint_expired", "lifted",
        "encoder_left_reversed", "encoder_right_reversed", "encoders_swapped", "clock", "bumper",
        "limited", "drivers_off"};
    const char *between = "";
    for (unsigned i = 0; i < sizeof names / sizeof names[0]; i++) {
        if ((unsigned)bits >> i & 1u) {
            text_add(line, between);
            text_add(line, names[i]);
            between = ", ";
        }
    }
}
