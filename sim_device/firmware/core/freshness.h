/* Extra delay of a frame beyond the session's fastest frame. Host and device clocks are not
 * synchronised. A frame's delay is its arrival minus its host stamp. Its extra delay is this delay
 * minus the smallest delay of the session. The smallest delay grows with time by the drift that two
 * crystals may have. Otherwise a long session would finally reject every frame. */
#ifndef FRESHNESS_H
#define FRESHNESS_H

#include <stdbool.h>
#include <stdint.h>

/* Unit of delays: quarters of a nanosecond. 250 ppm of a microsecond is one unit, so ageing is
 * exact. */
#define FRESHNESS_STEPS_PER_US 4000

typedef struct {
    bool known;
    int64_t host_us;     /* newest stamp of the host, extended */
    int64_t least_steps; /* smallest delay of the session, aged */
    int64_t at_us;
} freshness_t;

/* Start a session without any delay. */
void freshness_reset(freshness_t *freshness);

/* Take a frame of the session; return its delay beyond the fastest frame's, in steps. */
int64_t freshness_extra(freshness_t *freshness, uint32_t host_stamp, int64_t arrived_us);

#endif
