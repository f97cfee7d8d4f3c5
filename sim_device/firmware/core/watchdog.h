/* The setpoint watchdog: it stores the last valid pair of cyclic values until its time to live
 * ends. One instance stores the body velocity, another instance stores the duties of bring-up mode.
 * Only setpoints feed it. */
#ifndef WATCHDOG_H
#define WATCHDOG_H

#include <stdbool.h>
#include <stdint.h>

#define MAX_TIME_TO_LIVE_US 250000

typedef struct {
    int16_t first; /* in the units of the message */
    int16_t second;
    bool live;
    bool counter_known;
    uint8_t counter;
    int64_t until_us; /* end of the time to live; 0: no values are stored */
} watchdog_t;

/* Discard values and counter for a new session. */
void watchdog_reset(watchdog_t *watchdog);

/* Discard the values; later values of the session are still accepted. */
void watchdog_halt(watchdog_t *watchdog);

typedef struct {
    int16_t first;
    int16_t second;
    uint8_t time_to_live_ms;
    uint8_t counter;
} setpoint_t;

/* Store new values with the additional delay `extra` (freshness.h); return false if they are
 * repeated, reordered or too old. */
bool watchdog_offer(
    watchdog_t *watchdog, const setpoint_t *setpoint, int64_t extra, int64_t arrived_us);

/* Return the remaining time to live. */
uint32_t watchdog_left_us(const watchdog_t *watchdog, int64_t now_us);

/* Return true once after the time to live of stored values has expired. */
bool watchdog_expired(watchdog_t *watchdog, int64_t now_us);

#endif
