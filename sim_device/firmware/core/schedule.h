/* When each stream is due, in control periods; phases are spread so that none come in bursts. */
#ifndef SCHEDULE_H
#define SCHEDULE_H

#include <stdbool.h>
#include <stdint.h>

/* In the order of their types, which is that of sending. */
typedef enum {
    STREAM_SYNC,
    STREAM_STATUS,
    STREAM_IMU,
    STREAM_ENCODERS,
    STREAM_RANGE,
    STREAM_POWER,
    STREAM_LINK_COUNTERS,
    STREAM_PLANNER_STATE,
    STREAMS
} stream_t;

typedef struct {
    uint16_t period[STREAMS]; /* 0: off */
    uint16_t phase[STREAMS];  /* tick % period at which it is due */
} schedule_t;

/* Back to the default rates. */
void schedule_reset(schedule_t *schedule);

/* The stream of a message's type; STREAMS: it is none of the device's. */
stream_t schedule_stream(uint8_t type);

/* Send a stream at `rate` tenths of a hertz, as near as whole periods allow; 0: not. */
void schedule_set_rate(schedule_t *schedule, stream_t stream, uint16_t rate);

/* Whether it is due in period `tick`, or was in one of those that were missed before it: `ticks`
 * periods have begun since the loop was last here. */
bool schedule_due(const schedule_t *schedule, stream_t stream, uint32_t tick, uint32_t ticks);

#endif
