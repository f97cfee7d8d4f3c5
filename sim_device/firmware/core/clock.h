/* Uptime: the board's microsecond counter, which wraps after 71 minutes, is extended to 64 bits.
 * All deadlines use uptime, so they cannot wrap. */
#ifndef CLOCK_H
#define CLOCK_H

#include <stdint.h>

/* Convert a value modulo 2^32 to a signed number. */
static inline int32_t signed32(uint32_t value)
{
    return value < 0x80000000u ? (int32_t)value : -(int32_t)~value - 1;
}

/* Return the time nearest to `near_us` with the low 32 bits `counter`. */
static inline int64_t extend_us(int64_t near_us, uint32_t counter)
{
    return near_us + signed32(counter - (uint32_t)(uint64_t)near_us);
}

#endif
