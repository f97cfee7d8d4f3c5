#include "schedule.h"

#include "period.h"
#include "sweepctl_protocol.h"

static const struct {
    uint8_t type;
    uint8_t hz;
} table[STREAMS] = {
    [STREAM_SYNC] = {SP_TYPE_SYNC, SP_SYNC_HZ},
    [STREAM_STATUS] = {SP_TYPE_STATUS, SP_STATUS_HZ},
    [STREAM_IMU] = {SP_TYPE_IMU, SP_IMU_HZ},
    [STREAM_ENCODERS] = {SP_TYPE_ENCODERS, SP_ENCODERS_HZ},
    [STREAM_RANGE] = {SP_TYPE_RANGE, SP_RANGE_HZ},
    [STREAM_POWER] = {SP_TYPE_POWER, SP_POWER_HZ},
    [STREAM_LINK_COUNTERS] = {SP_TYPE_LINK_COUNTERS, SP_LINK_COUNTERS_HZ},
    [STREAM_PLANNER_STATE] = {SP_TYPE_PLANNER_STATE, SP_PLANNER_STATE_HZ},
};

void schedule_reset(schedule_t *schedule)
{
    for (unsigned i = 0; i < STREAMS; i++) {
        schedule_set_rate(schedule, (stream_t)i, (uint16_t)(10u * table[i].hz));
    }
}

stream_t schedule_stream(uint8_t type)
{
    unsigned i = 0;
    while (i < STREAMS && table[i].type != type) {
        i++;
    }
    return (stream_t)i;
}

void schedule_set_rate(schedule_t *schedule, stream_t stream, uint16_t rate)
{
    const uint32_t per_second = 10u * PERIODS_PER_SECOND; /* tenths, as the rate */
    uint32_t period = 0;
    if (rate != 0) {
        period = (2u * per_second + rate - 1u) / (2u * rate); /* rounded */
        period = period == 0 ? 1u : period;
    }
    schedule->period[stream] = (uint16_t)period;
    schedule->phase[stream] = (uint16_t)(period == 0 ? 0u : (unsigned)stream % period);
}

bool schedule_due(const schedule_t *schedule, stream_t stream, uint32_t tick, uint32_t ticks)
{
    const uint32_t period = schedule->period[stream];
    return period != 0 && due_every(period, schedule->phase[stream], tick, ticks);
}
