#include "range_ahead.h"

#include "board.h"
#include "numbers.h"

/* Weight of a new reading in the filter. At constant speed, the output has half of a reading's
 * sigma. */
#define GAIN 0.4f
/* Maximum change of a valid reading, m. A larger change is an outlier or a new object ahead. */
#define GATE_M 0.05f
/* Time without an echo after which the floor ahead counts as free, s: six readings. */
#define DROPOUT_S 0.3f

void range_ahead_reset(range_ahead_t *ahead)
{
    const range_ahead_t nothing = {.last_mm = BOARD_NO_RANGE};
    *ahead = nothing;
}

static void fresh(range_ahead_t *ahead, float reading_m)
{
    const float error_m = reading_m - ahead->range_m;
    if (!ahead->known) {
        ahead->known = true;
        ahead->range_m = reading_m;
    } else if (absolute(error_m) < GATE_M) {
        ahead->range_m += GAIN * error_m;
    } else if (ahead->has_outlier && absolute(reading_m - ahead->outlier_m) < GATE_M) {
        ahead->range_m = reading_m;
    } else {
        ahead->has_outlier = true;
        ahead->outlier_m = reading_m;
        return;
    }
    ahead->has_outlier = false;
}

void range_ahead_update(range_ahead_t *ahead, uint16_t reading_mm, float travel_m, float dt_s)
{
    ahead->range_m = larger(ahead->range_m - travel_m, 0.0f);
    ahead->outlier_m -= travel_m;
    if (reading_mm == BOARD_NO_RANGE) {
        ahead->silent_s += dt_s;
        if (ahead->silent_s > DROPOUT_S) {
            ahead->known = false;
        }
    } else {
        ahead->silent_s = 0.0f;
        if (reading_mm != ahead->last_mm) {
            fresh(ahead, (float)reading_mm * 1e-3f);
        }
    }
    ahead->last_mm = reading_mm;
}
