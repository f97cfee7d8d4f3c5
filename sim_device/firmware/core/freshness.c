#include "freshness.h"

#include "clock.h"

void freshness_reset(freshness_t *freshness)
{
    freshness->known = false;
}

int64_t freshness_extra(freshness_t *freshness, uint32_t host_stamp, int64_t arrived_us)
{
    if (!freshness->known) {
        freshness->known = true;
        freshness->host_us = (int64_t)host_stamp;
        freshness->at_us = arrived_us;
        freshness->min_delay_steps = (arrived_us - freshness->host_us) * FRESHNESS_STEPS_PER_US;
        return 0;
    }
    const int64_t host_us = extend_us(freshness->host_us, host_stamp);
    if (host_us > freshness->host_us) {
        freshness->host_us = host_us;
    }
    freshness->min_delay_steps += arrived_us - freshness->at_us; /* 250 ppm of this time */
    freshness->at_us = arrived_us;
    const int64_t delay_steps = (arrived_us - host_us) * FRESHNESS_STEPS_PER_US;
    if (delay_steps < freshness->min_delay_steps) {
        freshness->min_delay_steps = delay_steps;
    }
    return delay_steps - freshness->min_delay_steps;
}
