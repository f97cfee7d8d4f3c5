#include "watchdog.h"

#include "freshness.h"

#define HALF_COUNTER 128u

void watchdog_reset(watchdog_t *watchdog)
{
    watchdog_halt(watchdog);
    watchdog->counter_known = false;
}

void watchdog_halt(watchdog_t *watchdog)
{
    watchdog->first = 0;
    watchdog->second = 0;
    watchdog->until_us = 0;
    watchdog->live = false;
}

bool watchdog_offer(
    watchdog_t *watchdog, const setpoint_t *setpoint, int64_t extra, int64_t arrived_us)
{
    const uint8_t advance = (uint8_t)(setpoint->counter - watchdog->counter);
    if (watchdog->counter_known && (advance == 0 || advance >= HALF_COUNTER)) {
        return false;
    }
    int64_t live_us = (int64_t)setpoint->time_to_live_ms * 1000;
    if (live_us > MAX_TIME_TO_LIVE_US) {
        live_us = MAX_TIME_TO_LIVE_US;
    }
    const int64_t left = live_us * FRESHNESS_STEPS_PER_US - extra;
    if (left <= 0) {
        return false;
    }
    watchdog->counter_known = true;
    watchdog->counter = setpoint->counter;
    watchdog->first = setpoint->first;
    watchdog->second = setpoint->second;
    watchdog->until_us = arrived_us + left / FRESHNESS_STEPS_PER_US;
    watchdog->live = true;
    return true;
}

uint32_t watchdog_left_us(const watchdog_t *watchdog, int64_t now_us)
{
    return watchdog->until_us > now_us ? (uint32_t)(watchdog->until_us - now_us) : 0u;
}

bool watchdog_expired(watchdog_t *watchdog, int64_t now_us)
{
    if (!watchdog->live || now_us < watchdog->until_us) {
        return false;
    }
    watchdog_halt(watchdog);
    return true;
}
