#include "inbox.h"

/* Memory barriers for the queues. The writer publishes its position after it has written the
 * content; the reader publishes its position after it has read the content. Neither the compiler
 * nor a processor with several cores moves an access to the data across these calls. On a Cortex-M
 * each call is a load or store and a DMB instruction. */
static uint16_t published(const uint16_t *place)
{
    return __atomic_load_n(place, __ATOMIC_ACQUIRE);
}

static void publish(uint16_t *place, unsigned value)
{
    __atomic_store_n(place, (uint16_t)value, __ATOMIC_RELEASE);
}

/* Number of used entries between two free-running positions. */
static unsigned taken(uint16_t in, uint16_t out)
{
    return (uint16_t)(in - out);
}

/* Only the writer changes the count; the reader may read it at any time. */
void inbox_drop(inbox_t *inbox, uint32_t count)
{
    __atomic_store_n(&inbox->dropped, inbox->dropped + count, __ATOMIC_RELAXED);
}

void inbox_put_bytes(inbox_t *inbox, const uint8_t *data, size_t length, uint32_t arrived_us)
{
    const uint16_t bytes_out = published(&inbox->bytes_out);
    const uint16_t stamps_out = published(&inbox->stamps_out);
    uint16_t at = inbox->bytes_in;
    uint16_t stamp = inbox->stamps_in;
    uint32_t dropped = 0;
    for (size_t i = 0; i < length; i++) {
        const bool ends = data[i] == 0;
        if (taken(at, bytes_out) == INBOX_BYTES
            || (ends && taken(stamp, stamps_out) == INBOX_STAMPS)) {
            dropped++;
            continue;
        }
        if (ends) {
            inbox->stamps[stamp % INBOX_STAMPS] = arrived_us;
            stamp++;
        }
        inbox->bytes[at % INBOX_BYTES] = data[i];
        at++;
    }
    publish(&inbox->stamps_in, stamp); /* before the byte, so that the reader of a zero also finds
                                          its stamp */
    publish(&inbox->bytes_in, at);
    if (dropped != 0) {
        inbox_drop(inbox, dropped);
    }
}

bool inbox_take_byte(inbox_t *inbox, uint8_t *byte, uint32_t *arrived_us)
{
    const uint16_t at = inbox->bytes_out;
    if (at == published(&inbox->bytes_in)) {
        return false;
    }
    *byte = inbox->bytes[at % INBOX_BYTES];
    if (*byte == 0) {
        const uint16_t stamp = inbox->stamps_out;
        *arrived_us = inbox->stamps[stamp % INBOX_STAMPS];
        publish(&inbox->stamps_out, stamp + 1u);
    }
    publish(&inbox->bytes_out, at + 1u);
    return true;
}

void inbox_put_frame(inbox_t *inbox, const sp_can_frame_t *frame, uint32_t arrived_us)
{
    const uint16_t at = inbox->frames_in;
    if (taken(at, published(&inbox->frames_out)) == INBOX_CAN_FRAMES) {
        inbox_drop(inbox, 1);
        return;
    }
    inbox->frames[at % INBOX_CAN_FRAMES].frame = *frame;
    inbox->frames[at % INBOX_CAN_FRAMES].arrived_us = arrived_us;
    publish(&inbox->frames_in, at + 1u);
}

bool inbox_take_frame(inbox_t *inbox, sp_can_frame_t *frame, uint32_t *arrived_us)
{
    const uint16_t at = inbox->frames_out;
    if (at == published(&inbox->frames_in)) {
        return false;
    }
    *frame = inbox->frames[at % INBOX_CAN_FRAMES].frame;
    *arrived_us = inbox->frames[at % INBOX_CAN_FRAMES].arrived_us;
    publish(&inbox->frames_out, at + 1u);
    return true;
}

void inbox_clear(inbox_t *inbox)
{
    sp_can_frame_t frame;
    uint8_t byte;
    uint32_t arrived_us;
    while (inbox_take_byte(inbox, &byte, &arrived_us)) {
    }
    while (inbox_take_frame(inbox, &frame, &arrived_us)) {
    }
}
