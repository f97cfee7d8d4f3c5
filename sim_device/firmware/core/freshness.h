/* How much later than the session's quickest frame a frame has come. Host and device clocks are
 * not related, but (arrival - host stamp) less the smallest of the session is a frame's extra
 * delay. The smallest is aged by the drift that two crystals may have, or a long session would
 * come to refuse everything. */
#ifndef FRESHNESS_H
#define FRESHNESS_H

#include <stdbool.h>
#include <stdint.h>

/* Delays are counted in quarters of a nanosecond: 250 ppm of a microsecond is one of them, so that
 * ageing is exact. */
#define FRESHNESS_STEPS_PER_US 4000

typedef struct {
    bool known;
    int64_t host_us;     /* newest stamp of the host, extended */
    int64_t least_steps; /* smallest delay of the session, aged */
    int64_t at_us;
} freshness_t;

/* Start a session: nothing is known. */
void freshness_reset(freshness_t *freshness);

/* Take a frame of the session; gives its delay beyond the quickest one's, in steps. */
int64_t freshness_extra(freshness_t *freshness, uint32_t host_stamp, int64_t arrived_us);

#endif
