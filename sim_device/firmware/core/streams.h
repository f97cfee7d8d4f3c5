/* The content of each stream. A function stream_NAME() fills in the message of the stream NAME. It
 * may be in streams.c or in your own file. The catalogue defines when the stream is sent and how it
 * is encoded. */
#ifndef STREAMS_H
#define STREAMS_H

#include "firmware_state.h"

/* Fill in the message; return false if there is nothing to send. `sampled_us` contains the present
 * time at the call. If the content was sampled earlier, the function stores the sampling time
 * there. */
#define STREAM(NAME, name) \
    bool stream_##name(firmware_t *firmware, sp_##name##_t *message, uint32_t *sampled_us);
SP_DEVICE_STREAMS(STREAM)
#undef STREAM

#endif
