#include "inbox.h"

/* How many places between two free-running ones are taken. */
static unsigned taken(uint16_t in, uint16_t out)
{
    return (uint16_t)(in - out);
}

void inbox_put_bytes(inbox_t *inbox, const uint8_t *data, size_t length, uint32_t arrived_us)
{
    for (size_t i = 0; i < length; i++) {
        const uint16_t at = inbox->bytes_in;
        const uint16_t stamp = inbox->stamps_in;
        const bool ends = data[i] == 0;
        if (taken(at, inbox->bytes_out) == INBOX_BYTES
            || (ends && taken(stamp, inbox->stamps_out) == INBOX_STAMPS)) {
            inbox->dropped++;
            continue;
        }
        if (ends) {
            inbox->stamps[stamp % INBOX_STAMPS] = arrived_us;
            inbox->stamps_in = (uint16_t)(stamp + 1u);
        }
        inbox->bytes[at % INBOX_BYTES] = data[i];
        inbox->bytes_in = (uint16_t)(at + 1u);
    }
}

bool inbox_take_byte(inbox_t *inbox, uint8_t *byte, uint32_t *arrived_us)
{
    const uint16_t at = inbox->bytes_out;
    if (at == inbox->bytes_in) {
        return false;
    }
    *byte = inbox->bytes[at % INBOX_BYTES];
    if (*byte == 0) {
        const uint16_t stamp = inbox->stamps_out;
        *arrived_us = inbox->stamps[stamp % INBOX_STAMPS];
        inbox->stamps_out = (uint16_t)(stamp + 1u);
    }
    inbox->bytes_out = (uint16_t)(at + 1u);
    return true;
}

void inbox_put_frame(inbox_t *inbox, const sp_can_frame_t *frame, uint32_t arrived_us)
{
    const uint16_t at = inbox->frames_in;
    if (taken(at, inbox->frames_out) == INBOX_CAN_FRAMES) {
        inbox->dropped++;
        return;
    }
    inbox->frames[at % INBOX_CAN_FRAMES].frame = *frame;
    inbox->frames[at % INBOX_CAN_FRAMES].arrived_us = arrived_us;
    inbox->frames_in = (uint16_t)(at + 1u);
}

bool inbox_take_frame(inbox_t *inbox, sp_can_frame_t *frame, uint32_t *arrived_us)
{
    const uint16_t at = inbox->frames_out;
    if (at == inbox->frames_in) {
        return false;
    }
    *frame = inbox->frames[at % INBOX_CAN_FRAMES].frame;
    *arrived_us = inbox->frames[at % INBOX_CAN_FRAMES].arrived_us;
    inbox->frames_out = (uint16_t)(at + 1u);
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
