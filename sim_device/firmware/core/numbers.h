/* Small arithmetic for which C99 has no single-precision or 16-bit function. */
#ifndef NUMBERS_H
#define NUMBERS_H

#include <stdint.h>

#define PI_F 3.14159265f

static inline float absolute(float value)
{
    return value < 0.0f ? -value : value;
}

static inline float larger(float a, float b)
{
    return a > b ? a : b;
}

static inline float smaller(float a, float b)
{
    return a < b ? a : b;
}

/* Limit a value to -limit .. limit. */
static inline float clamped(float value, float limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

static inline float radians(float degrees)
{
    return degrees * (PI_F / 180.0f);
}

/* Return the difference of two 16-bit counts as a signed distance of less than half the range. */
static inline int16_t wrapped16(uint16_t difference)
{
    return (int16_t)(difference < 0x8000u ? difference : (int32_t)difference - 0x10000);
}

#endif
