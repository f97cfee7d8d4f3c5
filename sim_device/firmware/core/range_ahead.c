#include "range_ahead.h"

#include "board.h"
#include "numbers.h"

/* Share of a fresh reading. The output's sigma is half of a reading's at constant speed. */
#define GAIN 0.4f
/* Maximum change of a valid reading; a larger one is an outlier or a new object in view. */
#define GATE_M 0.05f
/* Time without an echo (six readings) after which nothing is ahead. */
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
    } else if (ahead->doubting && absolute(reading_m - ahead->doubt_m) < GATE_M) {
        ahead->range_m = reading_m;
    } else {
        ahead->doubting = true;
        ahead->doubt_m = reading_m;
        return;
    }
    ahead->doubting = false;
}

void range_ahead_update(range_ahead_t *ahead, uint16_t reading_mm, float travel_m, float dt_s)
{
    ahead->range_m = larger(ahead->range_m - travel_m, 0.0f);
    ahead->doubt_m -= travel_m;
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
