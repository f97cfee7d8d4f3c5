/* The content of each stream. A function stream_NAME() fills in the message of the stream NAME, here or
 * in a file of yours; the schedule and the sending follow from the catalogue. */
#ifndef STREAMS_H
#define STREAMS_H

#include "firmware_state.h"

/* Fill in the message; false: there is nothing to send. `sampled_us` is the present time at the
 * call. If the content was sampled earlier, the function replaces it by that time. */
#define STREAM(NAME, name) \
    bool stream_##name(firmware_t *firmware, sp_##name##_t *message, uint32_t *sampled_us);
SP_DEVICE_STREAMS(STREAM)
#undef STREAM

#endif
