/* The device's parameters: a table of their properties, and their values. A changed value is valid
 * until the next boot; a save stores the present values for the next boot. A parameter of the
 * robot's geometry takes effect at the next boot, so that odometry stays consistent. */
#ifndef PARAMETERS_H
#define PARAMETERS_H

#include <stdbool.h>
#include <stdint.h>

#include "robot.h"
#include "sweepctl_protocol.h"

/* Numbers of the parameters: PARAMETER_NODE and so on. */
enum {
#define PARAMETER(NAME, label, factory, low, high, kind, flags) PARAMETER_##NAME,
    PARAMETER_TABLE(PARAMETER) OWN_PARAMETERS(PARAMETER)
#undef PARAMETER
        PARAMETERS
};

typedef struct {
    uint32_t value; /* 32 bits, interpreted by its kind */
    bool known;
} stored_t;

typedef struct {
    uint32_t factory[PARAMETERS]; /* the default in the table; for the node id, the board's value */
    stored_t stored[PARAMETERS];
    uint32_t boot[PARAMETERS];
    uint32_t present[PARAMETERS];
} parameters_t;

/* Begin a boot with the stored values; a value outside its parameter's range is ignored. */
void parameters_start(parameters_t *parameters, uint8_t node, const stored_t stored[PARAMETERS]);

/* Return all properties of a parameter; false if the number is unknown. The name points into the
 * table. */
bool parameters_describe(
    const parameters_t *parameters, uint8_t number, sp_parameter_value_t *out);

/* Change a present value. Return -1, or the reason of a rejection (SP_NACK_REASON_*). */
int parameters_set(parameters_t *parameters, uint8_t number, uint8_t kind, uint32_t value);

/* Return the stored values. */
void parameters_stored(const parameters_t *parameters, stored_t image[PARAMETERS]);

/* Return the image to store so that the next boot uses the present values. */
void parameters_image(const parameters_t *parameters, stored_t image[PARAMETERS]);

/* Record that the flash now contains this image. */
void parameters_saved(parameters_t *parameters, const stored_t image[PARAMETERS]);

/* Return the value in effect, in its unit: the value at boot if a change needs a boot, else the
 * present value. */
float parameters_value(const parameters_t *parameters, uint8_t number);

/* Return the CRC-32 of the parameter's name. A later firmware finds the stored value by this
 * key. */
uint32_t parameters_key(uint8_t number);

#endif
