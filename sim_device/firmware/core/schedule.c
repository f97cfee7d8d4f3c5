#include "schedule.h"

#include "period.h"

static const struct {
    uint8_t type;
    uint16_t rate; /* tenths of a hertz */
} table[STREAMS] = {
#define STREAM(NAME, name) [STREAM_##NAME] = {SP_TYPE_##NAME, (uint16_t)(10 * SP_##NAME##_HZ)},
    SP_DEVICE_STREAMS(STREAM)
#undef STREAM
};

void schedule_reset(schedule_t *schedule)
{
    for (unsigned i = 0; i < STREAMS; i++) {
        schedule_set_rate(schedule, (stream_t)i, table[i].rate);
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
