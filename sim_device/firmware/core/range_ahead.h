/* The range to what is ahead, at the present moment. Readings come at 20 Hz and decisions at 50 Hz,
 * so between readings the range is reduced by the way driven; a fresh reading (one that differs
 * from the last) corrects it by a share. One reading that disagrees is not believed, two in a row
 * that agree with each other are. */
#ifndef RANGE_AHEAD_H
#define RANGE_AHEAD_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    bool known; /* something is ahead */
    float range_m;
    uint16_t last_mm; /* reading before */
    bool doubting;
    float doubt_m;
    float silent_s;
} range_ahead_t;

/* Nothing seen yet, as after a turn. */
void range_ahead_reset(range_ahead_t *ahead);

/* After driving `travel_m` forward in `dt_s`, with the newest reading (BOARD_NO_RANGE: none). */
void range_ahead_update(range_ahead_t *ahead, uint16_t reading_mm, float travel_m, float dt_s);

#endif
