#include "readings.h"

static correction_t correction(const parameters_t *parameters, uint8_t scale)
{
    const correction_t found = {
        parameters_value(parameters, scale), parameters_value(parameters, (uint8_t)(scale + 1u))};
    return found;
}

/* Return the bits of SP_CONTACT_* whose parts are connected. */
static uint8_t connected_contacts(uint16_t capabilities)
{
    const bool bumper = capabilities & SP_CAPABILITY_BUMPER;
    const bool cliff = capabilities & SP_CAPABILITY_CLIFF;
    return (uint8_t)((bumper ? SP_CONTACT_BUMPER_LEFT | SP_CONTACT_BUMPER_RIGHT : 0)
        | (cliff ? SP_CONTACT_CLIFF : 0));
}

void readings_start(readings_t *readings, board_t *board, const parameters_t *parameters)
{
    const uint16_t capabilities = board_identity(board)->capabilities;
    readings->board = board;
    readings->connected_contacts = connected_contacts(capabilities);
    readings->has_ultrasonic = capabilities & SP_CAPABILITY_ULTRASONIC;
    readings->has_infrared = capabilities & SP_CAPABILITY_INFRARED;
    readings->ultrasonic = correction(parameters, PARAMETER_ULTRASONIC_SCALE);
    readings->infrared_left = correction(parameters, PARAMETER_INFRARED_LEFT_SCALE);
    readings->infrared_right = correction(parameters, PARAMETER_INFRARED_RIGHT_SCALE);
}

/* Return a calibrated range, in steps of 1/`per_m` m, rounded. BOARD_NO_RANGE does not change. */
static uint16_t corrected(uint16_t range, const correction_t *by, float per_m)
{
    if (!seen(range) || (by->scale == 1.0f && by->offset_m == 0.0f)) {
        return range;
    }
    const float exact = by->scale * (float)range + by->offset_m * per_m + 0.5f;
    if (exact < 0.0f) {
        return 0;
    }
    return exact < (float)BOARD_NO_RANGE ? (uint16_t)exact : (uint16_t)(BOARD_NO_RANGE - 1u);
}

void readings_begin(readings_t *readings)
{
    board_encoders(readings->board, &readings->counts);
    if (!readings->begun) {
        readings->begun = true;
        readings->zero = readings->counts;
    }
    readings->counts.left = (uint16_t)(readings->counts.left - readings->zero.left);
    readings->counts.right = (uint16_t)(readings->counts.right - readings->zero.right);
    board_imu(readings->board, &readings->imu);
    readings->around_known = false;
    readings->contacts_known = false;
}

uint8_t readings_contacts(readings_t *readings)
{
    if (!readings->contacts_known) {
        readings->contacts_known = true;
        readings->contacts =
            (uint8_t)(board_contacts(readings->board) & readings->connected_contacts);
    }
    return readings->contacts;
}

const around_t *readings_around(readings_t *readings)
{
    if (!readings->around_known) {
        readings->around_known = true;
        board_ranges_t *const ranges = &readings->around.ranges;
        board_ranges(readings->board, ranges);
        if (!readings->has_ultrasonic) {
            ranges->ultrasonic_mm = BOARD_NO_RANGE;
        }
        if (!readings->has_infrared) {
            ranges->infrared_left_dmm = ranges->infrared_right_dmm = BOARD_NO_RANGE;
        }
        ranges->ultrasonic_mm = corrected(ranges->ultrasonic_mm, &readings->ultrasonic, 1e3f);
        ranges->infrared_left_dmm =
            corrected(ranges->infrared_left_dmm, &readings->infrared_left, 1e4f);
        ranges->infrared_right_dmm =
            corrected(ranges->infrared_right_dmm, &readings->infrared_right, 1e4f);
        readings->around.contacts = readings_contacts(readings);
    }
    return &readings->around;
}
