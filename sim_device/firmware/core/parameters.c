#include "parameters.h"

#include <string.h>


typedef struct {
    const char *label; /* name, space, unit */
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
#define PARAMETER(NAME, label, factory, low, high, kind, flags)                                   \
    [PARAMETER_##NAME] = {label, factory, low, high, kind, flags},
    PARAMETER_TABLE(PARAMETER) OWN_PARAMETERS(PARAMETER)
#undef PARAMETER
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
    return value >= row->low && value <= row->high; /* false for NaN */
}

/* Return the value with which the next boot would start. */
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
