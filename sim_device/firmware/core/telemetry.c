#include "telemetry.h"

#include "board.h"
#include "streams.h"

/* A separate function sends each stream, so that the stack contains only one message. */
#define STREAM(NAME, name)                                                                        \
    static void send_##name(firmware_t *firmware)                                                 \
    {                                                                                             \
        sp_##name##_t message;                                                                    \
        uint32_t sampled_us = (uint32_t)firmware->now_us;                                         \
        if (stream_##name(firmware, &message, &sampled_us)) {                                     \
            line_stream(&firmware->line, SP_TYPE_##NAME, sampled_us,                              \
                sp_##name##_encode(&message, line_payload(&firmware->line), SP_PAYLOAD_MAX));     \
        }                                                                                         \
    }
SP_DEVICE_STREAMS(STREAM)
#undef STREAM

void telemetry_send(firmware_t *firmware, stream_t stream)
{
    switch (stream) {
#define STREAM(NAME, name)                                                                        \
    case STREAM_##NAME:                                                                           \
        send_##name(firmware);                                                                    \
        break;
        SP_DEVICE_STREAMS(STREAM)
#undef STREAM
    case STREAMS:
        break;
    }
}

void telemetry_measure_load(firmware_t *firmware)
{
    const uint32_t busy_us = board_busy_us(firmware->board);
    const uint32_t window_us = (uint32_t)(firmware->now_us - firmware->load_at_us);
    if (window_us != 0) {
        const uint32_t percent =
            ((busy_us - firmware->load_busy_us) * 100u + window_us / 2u) / window_us;
        firmware->load_percent = (uint8_t)(percent < 100u ? percent : 100u);
    }
    firmware->load_busy_us = busy_us;
    firmware->load_at_us = firmware->now_us;
}
