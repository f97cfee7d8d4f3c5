/* The setpoint watchdog: holds the last good pair of cyclic values for as long as it may live.
 * One holds the body velocity, another the duties of bring-up. Nothing but setpoints feeds it. */
#ifndef WATCHDOG_H
#define WATCHDOG_H

#include <stdbool.h>
#include <stdint.h>

#define MAX_TIME_TO_LIVE_US 250000

typedef struct {
    int16_t first; /* wire steps */
    int16_t second;
    bool live;
    bool counter_known;
    uint8_t counter;
    int64_t until_us; /* when the values held run out; 0: none are held */
} watchdog_t;

/* Forget the values and the counter: a new session. */
void watchdog_reset(watchdog_t *watchdog);

/* Let go of the values; later ones of the session are taken again. */
void watchdog_halt(watchdog_t *watchdog);

typedef struct {
    int16_t first;
    int16_t second;
    uint8_t time_to_live_ms;
    uint8_t counter;
} setpoint_t;

/* Take values that came `extra` later than the quickest (freshness.h); false where they are
 * repeated, reordered or too old. */
bool watchdog_offer(
    watchdog_t *watchdog, const setpoint_t *setpoint, int64_t extra, int64_t arrived_us);

/* Time to live that is left. */
uint32_t watchdog_left_us(const watchdog_t *watchdog, int64_t now_us);

/* True once, when values that held have run out. */
bool watchdog_expired(watchdog_t *watchdog, int64_t now_us);

#endif
