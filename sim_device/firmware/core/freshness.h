/* Additional delay of a frame compared with the session's fastest frame. Host and device clocks are
 * not synchronised, so a frame's arrival time minus its host stamp is the delay plus an unknown
 * constant. The additional delay is this difference minus its minimum in the session. The minimum
 * is increased at the maximum drift of two crystals. Otherwise clock drift would make all frames of
 * a long session look late. */
#ifndef FRESHNESS_H
#define FRESHNESS_H

#include <stdbool.h>
#include <stdint.h>

/* Number of delay steps per microsecond. A step is a quarter of a nanosecond, which is 250 ppm of a
 * microsecond. So the increase of the minimum is exact. */
#define FRESHNESS_STEPS_PER_US 4000

typedef struct {
    bool known;
    int64_t host_us;     /* newest stamp of the host, extended */
    int64_t min_delay_steps; /* smallest delay of the session, increased by the drift */
    int64_t at_us;
} freshness_t;

/* Start a session; its smallest delay is unknown. */
void freshness_reset(freshness_t *freshness);

/* Process a frame of the session; return its additional delay, in steps. */
int64_t freshness_extra(freshness_t *freshness, uint32_t host_stamp, int64_t arrived_us);

#endif
