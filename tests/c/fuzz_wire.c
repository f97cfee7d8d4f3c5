/* libFuzzer: no input causes a read or write out of bounds, and every accepted message is equal
 * after encoding and decoding it again.
 *
 *   first byte 0: a stream for the parser; its first byte sets the size of the blocks
 *              1: a frame's content; it gets a valid CRC, so it always reaches the decoders
 *              2: CAN frames
 */
#include "adapter.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void demand(bool holds)
{
    if (!holds) {
        abort();
    }
}

static void accept(const sp_frame_t *frame)
{
    const adapter_message_t *message = adapter_find(frame->type);
    demand((message == NULL) == (sp_direction(frame->type) == SP_UNKNOWN));
    if (message == NULL) {
        return;
    }
    uint8_t *copy = malloc(frame->length ? frame->length : 1u);
    uint8_t out[SP_PAYLOAD_MAX];
    demand(copy != NULL);
    memcpy(copy, frame->payload, frame->length);
    const int again = message->again(copy, frame->length, out, frame->length);
    demand(again < 0 || memcmp(out, copy, (size_t)again) == 0);
    free(copy);
}

static void stream(const uint8_t *data, size_t size)
{
    static sp_parser_t blocks, bytes;
    memset(&blocks, 0, sizeof blocks);
    memset(&bytes, 0, sizeof bytes);
    const size_t block = size ? 1u + data[0] % 64u : 1u;
    size_t events = 0;
    for (size_t at = 0; at < size; at += block) {
        const size_t end = at + block < size ? at + block : size;
        for (size_t i = at; i < end;) {
            sp_frame_t frame;
            sp_event_t event;
            i += sp_parser_block(&blocks, data + i, end - i, &frame, &event);
            if (event == SP_FRAME) {
                accept(&frame);
            }
            events += event != SP_NOTHING;
        }
    }
    for (size_t i = 0; i < size; i++) {
        sp_frame_t frame;
        events -= sp_parser_byte(&bytes, data[i], &frame) != SP_NOTHING;
    }
    demand(events == 0 && memcmp(&blocks, &bytes, sizeof blocks) == 0);
    demand(blocks.frames + blocks.damaged <= size);
}

static void content(const uint8_t *data, size_t size)
{
    uint8_t frame[SP_FRAME_MAX];
    sp_sender_t sender = {1, 0, 7, 0};
    sp_parser_t parser = {0};
    sp_frame_t parsed;
    sp_event_t event = SP_NOTHING;
    if (size < 2) {
        return;
    }
    const size_t length = size - 2 < SP_PAYLOAD_MAX ? size - 2 : SP_PAYLOAD_MAX;
    memcpy(sp_payload(frame), data + 2, length);
    sender.flags = data[1] & 0x0Fu;
    const size_t n = sp_seal(frame, &sender, data[0], 0x12345678u, length);
    demand(n == length + 15);
    demand(sp_seal(frame, &sender, data[0], 0, SP_PAYLOAD_MAX + 1u + data[1]) == 0);
    for (size_t i = 0; i < n; i++) {
        demand(event == SP_NOTHING && (i == 0 || i == n - 1 || frame[i] != 0));
        event = sp_parser_byte(&parser, frame[i], &parsed);
    }
    demand(event == SP_FRAME && parser.damaged == 0 && parsed.type == data[0]);
    demand(parsed.length == length && memcmp(parsed.payload, data + 2, length) == 0);
    demand(parsed.seq == 7 && parsed.flags == (data[1] & 0x0Fu) && parsed.t_us == 0x12345678u);
    accept(&parsed);
}

static void can(const uint8_t *data, size_t size)
{
    static sp_can_receiver_t receiver;
    memset(&receiver, 0, sizeof receiver);
    uint32_t now_us = 0;
    for (size_t at = 0; at + 4 <= size;) {
        /* There are few ids, so that transfers often continue: same id, next toggle. */
        sp_can_frame_t in = {
            (uint16_t)((data[at] & 0x1Fu) << 4 | (data[at] >> 5 & 1u)), data[at + 1] % 9u, {0}};
        const size_t left = size - at - 2;
        sp_frame_t frame;
        now_us += (uint32_t)(data[at] >> 6) * 60000u;
        memcpy(in.data, data + at + 2, in.length < left ? in.length : left);
        if (sp_can_receive(&receiver, &in, now_us, &frame) == SP_FRAME) {
            demand(sp_direction(frame.type) == SP_FROM_HOST);
            accept(&frame);
        }
        at += 2u + in.length;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0) {
        return 0;
    }
    switch (data[0] % 3u) {
    case 0:
        stream(data + 1, size - 1);
        break;
    case 1:
        content(data + 1, size - 1);
        break;
    default:
        can(data + 1, size - 1);
        break;
    }
    return 0;
}
