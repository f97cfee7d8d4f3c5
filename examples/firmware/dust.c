/* The message `dust`: particles, and how full the bin is. A real robot reads a sensor here. */
#include "streams.h"

#define PARTICLES_PER_LITRE 2000.0f
#define PARTICLE_US 50000
#define RATE_TENTHS 200u

bool stream_dust(firmware_t *firmware, sp_dust_t *message, uint32_t *sampled_us)
{
    const uint32_t particles = (uint32_t)(firmware->now_us / PARTICLE_US);
    const float bin_l = parameters_value(&firmware->parameters, PARAMETER_BIN_VOLUME);
    const float full = 100.0f * (float)particles / (PARTICLES_PER_LITRE * bin_l);
    (void)sampled_us; /* now */
    message->particles = (uint16_t)particles;
    message->rate = RATE_TENTHS;
    message->full = (uint8_t)(full < 100.0f ? full : 100.0f);
    return true;
}
