#include "parameters.h"

#include <string.h>

#include "robot.h"

typedef struct {
    const char *label; /* name, a blank, unit */
    float factory;
    float low;
    float high;
    uint8_t kind;  /* SP_PARAMETER_KIND_* */
    uint8_t flags; /* SP_PARAMETER_FLAG_READ_ONLY, _NEEDS_REBOOT */
} row_t;

#define U32 SP_PARAMETER_KIND_U32
#define F32 SP_PARAMETER_KIND_F32
#define READ_ONLY SP_PARAMETER_FLAG_READ_ONLY
#define REBOOT SP_PARAMETER_FLAG_NEEDS_REBOOT

static const row_t table[PARAMETERS] = {
    [PARAMETER_NODE] = {"node id", 1.0f, 1.0f, 15.0f, U32, READ_ONLY},
    [PARAMETER_WHEEL_DIAMETER] =
        {"wheel_diameter m", ROBOT_WHEEL_DIAMETER_M, 0.01f, 1.0f, F32, REBOOT},
    [PARAMETER_WHEEL_BASE] = {"wheel_base m", ROBOT_WHEEL_BASE_M, 0.02f, 2.0f, F32, REBOOT},
    [PARAMETER_COUNTS_PER_TURN] =
        {"counts_per_turn count", ROBOT_COUNTS_PER_TURN, 4.0f, 1e6f, U32, REBOOT},
    [PARAMETER_MAX_SPEED] = {"max_speed m/s", ROBOT_MAX_SPEED_M_S, 0.01f, 2.0f, F32, 0},
    [PARAMETER_MAX_YAW_RATE] =
        {"max_yaw_rate rad/s", ROBOT_MAX_YAW_RATE_RAD_S, 0.05f, 20.0f, F32, 0},
    [PARAMETER_CRUISE_SPEED] = {"cruise_speed m/s", ROBOT_CRUISE_SPEED_M_S, 0.01f, 2.0f, F32, 0},
    [PARAMETER_STOP_DECELERATION] =
        {"stop_deceleration m/s2", ROBOT_STOP_DECELERATION_M_S2, 0.2f, 5.0f, F32, 0},
    [PARAMETER_BATTERY_LOW] = {"battery_low V", ROBOT_BATTERY_LOW_V, 3.0f, 60.0f, F32, 0},
    [PARAMETER_ROBOT_DIAMETER] =
        {"robot_diameter m", ROBOT_DIAMETER_M, 0.05f, 2.0f, F32, REBOOT},
    [PARAMETER_CLEANING_WIDTH] =
        {"cleaning_width m", ROBOT_CLEANING_WIDTH_M, 0.02f, 2.0f, F32, REBOOT},
    [PARAMETER_MOUTH_OFFSET] = {"mouth_offset m", ROBOT_MOUTH_OFFSET_M, -1.0f, 1.0f, F32, REBOOT},
    [PARAMETER_BATTERY_EMPTY] = {"battery_empty V", ROBOT_BATTERY_EMPTY_V, 3.0f, 60.0f, F32, 0},
    [PARAMETER_WHEEL_RATIO] = {"wheel_ratio ratio", 1.0f, 0.8f, 1.25f, F32, REBOOT},
    [PARAMETER_GYRO_BIAS] = {"gyro_bias rad/s", 0.0f, -0.4f, 0.4f, F32, REBOOT},
    [PARAMETER_ULTRASONIC_SCALE] = {"ultrasonic_scale ratio", 1.0f, 0.5f, 2.0f, F32, REBOOT},
    [PARAMETER_ULTRASONIC_OFFSET] = {"ultrasonic_offset m", 0.0f, -0.2f, 0.2f, F32, REBOOT},
    [PARAMETER_INFRARED_LEFT_SCALE] = {"infrared_left_scale ratio", 1.0f, 0.5f, 2.0f, F32, REBOOT},
    [PARAMETER_INFRARED_LEFT_OFFSET] = {"infrared_left_offset m", 0.0f, -0.2f, 0.2f, F32, REBOOT},
    [PARAMETER_INFRARED_RIGHT_SCALE] =
        {"infrared_right_scale ratio", 1.0f, 0.5f, 2.0f, F32, REBOOT},
    [PARAMETER_INFRARED_RIGHT_OFFSET] =
        {"infrared_right_offset m", 0.0f, -0.2f, 0.2f, F32, REBOOT},
    [PARAMETER_CLIFF_REFLEX] = {"cliff_reflex bool", 1.0f, 0.0f, 1.0f, U32, 0},
    [PARAMETER_BUMPER_REFLEX] = {"bumper_reflex bool", 1.0f, 0.0f, 1.0f, U32, 0},
};

static float from_raw(uint8_t kind, uint32_t raw)
{
    float value;
    if (kind != F32) {
        return (float)raw;
    }
    memcpy(&value, &raw, sizeof value);
    return value;
}

static uint32_t to_raw(uint8_t kind, float value)
{
    uint32_t raw;
    if (kind != F32) {
        return (uint32_t)value;
    }
    memcpy(&raw, &value, sizeof raw);
    return raw;
}

/* Return whether 32 bits are within the parameter's range. */
static bool allowed(const row_t *row, uint32_t raw)
{
    if (row->kind != F32) {
        return raw >= to_raw(row->kind, row->low) && raw <= to_raw(row->kind, row->high);
    }
    const float value = from_raw(F32, raw);
    return value >= row->low && value <= row->high; /* false for a value that is no number */
}

/* Return the value that the next boot would start with. */
static uint32_t kept(const parameters_t *parameters, uint8_t number)
{
    const stored_t *const stored = &parameters->stored[number];
    return stored->known && allowed(&table[number], stored->value) ? stored->value
                                                                  : parameters->factory[number];
}

void parameters_start(parameters_t *parameters, uint8_t node, const stored_t stored[PARAMETERS])
{
    for (uint8_t i = 0; i < PARAMETERS; i++) {
        parameters->factory[i] = to_raw(table[i].kind, table[i].factory);
        if (i == PARAMETER_NODE) {
            parameters->factory[i] = node;
        }
        parameters->stored[i] = stored[i];
        parameters->boot[i] = parameters->present[i] = kept(parameters, i);
    }
}

bool parameters_describe(
    const parameters_t *parameters, uint8_t number, sp_parameter_value_t *out)
{
    if (number >= PARAMETERS) {
        return false;
    }
    const row_t *const row = &table[number];
    const stored_t *const stored = &parameters->stored[number];
    const uint32_t value = parameters->present[number];
    out->parameter = number;
    out->parameter_count = PARAMETERS;
    out->kind = row->kind;
    out->flags = row->flags;
    if (stored->known && stored->value == value) {
        out->flags |= SP_PARAMETER_FLAG_STORED;
    }
    if (value != kept(parameters, number)) {
        out->flags |= SP_PARAMETER_FLAG_CHANGED;
    }
    out->value = value;
    out->default_ = parameters->factory[number];
    out->low = to_raw(row->kind, row->low);
    out->high = to_raw(row->kind, row->high);
    out->name = row->label;
    out->name_length = (uint8_t)strlen(row->label);
    return true;
}

int parameters_set(parameters_t *parameters, uint8_t number, uint8_t kind, uint32_t value)
{
    if (number >= PARAMETERS) {
        return SP_NACK_REASON_UNKNOWN_PARAMETER;
    }
    const row_t *const row = &table[number];
    if (row->flags & READ_ONLY) {
        return SP_NACK_REASON_READ_ONLY;
    }
    if (kind != row->kind || !allowed(row, value)) {
        return SP_NACK_REASON_BAD_VALUE;
    }
    parameters->present[number] = value;
    return -1;
}

void parameters_image(const parameters_t *parameters, stored_t image[PARAMETERS])
{
    for (uint8_t i = 0; i < PARAMETERS; i++) {
        image[i] = parameters->stored[i];
        if (!(table[i].flags & READ_ONLY)) {
            image[i].known = true;
            image[i].value = parameters->present[i];
        }
    }
}

void parameters_stored(const parameters_t *parameters, stored_t image[PARAMETERS])
{
    memcpy(image, parameters->stored, sizeof parameters->stored);
}

void parameters_saved(parameters_t *parameters, const stored_t image[PARAMETERS])
{
    memcpy(parameters->stored, image, sizeof parameters->stored);
}

float parameters_value(const parameters_t *parameters, uint8_t number)
{
    const row_t *const row = &table[number];
    return from_raw(row->kind,
        row->flags & REBOOT ? parameters->boot[number] : parameters->present[number]);
}

uint32_t parameters_key(uint8_t number)
{
    const char *const label = table[number].label;
    const char *const blank = strchr(label, ' ');
    return sp_crc32_update(0, (const uint8_t *)label, (size_t)(blank - label));
}
