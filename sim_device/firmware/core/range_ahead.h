/* Present range to the obstacle ahead. Readings come at 20 Hz and decisions at 50 Hz. Between
 * readings the range decreases by the distance driven; a fresh reading (one that differs from the
 * last) corrects it by a share. A single outlier is ignored; two outliers in a row that agree are
 * accepted. */
#ifndef RANGE_AHEAD_H
#define RANGE_AHEAD_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    bool known; /* something is ahead */
    float range_m;
    uint16_t last_mm; /* previous reading */
    bool doubting;
    float doubt_m;
    float silent_s;
} range_ahead_t;

/* Discard the readings, as after a turn. */
void range_ahead_reset(range_ahead_t *ahead);

/* Update after `travel_m` forward in `dt_s`, with the newest reading (BOARD_NO_RANGE: none). */
void range_ahead_update(range_ahead_t *ahead, uint16_t reading_mm, float travel_m, float dt_s);

#endif
