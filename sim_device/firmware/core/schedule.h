/* Schedule of the streams in control periods; phases are spread to avoid bursts. */
#ifndef SCHEDULE_H
#define SCHEDULE_H

#include <stdbool.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

/* Streams in the order of their types, which is also the order of transmission. */
typedef enum {
#define STREAM(NAME, name) STREAM_##NAME,
    SP_DEVICE_STREAMS(STREAM)
#undef STREAM
        STREAMS
} stream_t;

typedef struct {
    uint16_t period[STREAMS]; /* 0: off */
    uint16_t phase[STREAMS];  /* the stream is due if tick % period equals its phase */
} schedule_t;

/* Restore the default rates. */
void schedule_reset(schedule_t *schedule);

/* Return the stream of a message type; STREAMS if the device has no such stream. */
stream_t schedule_stream(uint8_t type);

/* Send a stream at `rate` tenths of a hertz, rounded to whole periods; 0: off. */
void schedule_set_rate(schedule_t *schedule, stream_t stream, uint16_t rate);

/* Return whether a stream is due in control period `tick`, or was due in a missed period before it.
 * `ticks` is the number of periods since the last call. */
bool schedule_due(const schedule_t *schedule, stream_t stream, uint32_t tick, uint32_t ticks);

#endif
