/* Present range to the obstacle ahead. Readings arrive at 20 Hz, and decisions are made at 50 Hz.
 * Between readings the range decreases by the distance driven. A new reading (a reading that
 * differs from the last reading) updates the range with a weight. A single outlier is ignored; two
 * consecutive outliers that agree are accepted. */
#ifndef RANGE_AHEAD_H
#define RANGE_AHEAD_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    bool known; /* an obstacle is ahead */
    float range_m;
    uint16_t last_mm; /* previous reading */
    bool has_outlier;
    float outlier_m;
    float silent_s;
} range_ahead_t;

/* Discard the readings, for example after a turn. */
void range_ahead_reset(range_ahead_t *ahead);

/* Update after `travel_m` forward in `dt_s`, with the newest reading (BOARD_NO_RANGE: none). */
void range_ahead_update(range_ahead_t *ahead, uint16_t reading_mm, float travel_m, float dt_s);

#endif
