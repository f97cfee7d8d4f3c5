/* Telemetry of the device: creates the message of each stream from the present readings. */
#ifndef TELEMETRY_H
#define TELEMETRY_H

#include "firmware_state.h"

/* Send a stream's message. */
void telemetry_send(firmware_t *firmware, stream_t stream);

/* Compute the busy share of the processor's time since the last call. */
void telemetry_measure_load(firmware_t *firmware);

#endif
