/* The device's parameters: a table of what there is, and what each is set to. Setting one counts
 * until the next boot; saving makes the present values the next boot's. What has a bearing on
 * geometry counts from the next boot on, so that odometry never changes its meaning while the
 * robot drives. */
#ifndef PARAMETERS_H
#define PARAMETERS_H

#include <stdbool.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

/* By number; new ones are appended. */
enum {
    PARAMETER_NODE,
    PARAMETER_WHEEL_DIAMETER,
    PARAMETER_WHEEL_BASE,
    PARAMETER_COUNTS_PER_TURN,
    PARAMETER_MAX_SPEED,
    PARAMETER_MAX_YAW_RATE,
    PARAMETER_CRUISE_SPEED,
    PARAMETER_STOP_DECELERATION,
    PARAMETER_BATTERY_LOW,
    PARAMETER_ROBOT_DIAMETER,
    PARAMETER_CLEANING_WIDTH,
    PARAMETER_MOUTH_OFFSET,
    PARAMETER_BATTERY_EMPTY,
    PARAMETER_WHEEL_RATIO,
    PARAMETER_GYRO_BIAS,
    PARAMETER_ULTRASONIC_SCALE, /* and so on: a scale and an offset for each ranger */
    PARAMETER_ULTRASONIC_OFFSET,
    PARAMETER_INFRARED_LEFT_SCALE,
    PARAMETER_INFRARED_LEFT_OFFSET,
    PARAMETER_INFRARED_RIGHT_SCALE,
    PARAMETER_INFRARED_RIGHT_OFFSET,
    PARAMETER_CLIFF_REFLEX,
    PARAMETER_BUMPER_REFLEX,
    PARAMETERS
};

typedef struct {
    uint32_t value; /* 32 bits, read as its kind says */
    bool known;
} stored_t;

typedef struct {
    uint32_t factory[PARAMETERS]; /* the table's default; the node's is the board's */
    stored_t stored[PARAMETERS];
    uint32_t boot[PARAMETERS];
    uint32_t present[PARAMETERS];
} parameters_t;

/* Begin a boot with what is stored; what does not fit its parameter is passed over. */
void parameters_start(parameters_t *parameters, uint8_t node, const stored_t stored[PARAMETERS]);

/* All that is to be known of one; false where there is no such number. The name points into the
 * table. */
bool parameters_describe(
    const parameters_t *parameters, uint8_t number, sp_parameter_value_t *out);

/* Change a present value: -1, or a refusal's reason (SP_NACK_REASON_*). */
int parameters_set(parameters_t *parameters, uint8_t number, uint8_t kind, uint32_t value);

/* What is stored now. */
void parameters_stored(const parameters_t *parameters, stored_t image[PARAMETERS]);

/* What is to be stored to keep every present value that can be set. */
void parameters_image(const parameters_t *parameters, stored_t image[PARAMETERS]);

/* Note that an image is stored now. */
void parameters_saved(parameters_t *parameters, const stored_t image[PARAMETERS]);

/* The value in effect, in its unit: set now, or at boot where it needs one. */
float parameters_value(const parameters_t *parameters, uint8_t number);

/* CRC-32 of its name: how a stored value finds it in a later firmware. */
uint32_t parameters_key(uint8_t number);

#endif
