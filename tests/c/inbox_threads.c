/* The inbox between two threads. Without barriers, compiler and processor may reorder its
 * accesses. ThreadSanitizer reports each unordered access. No output if all data arrives in order.
 */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

#include "inbox.h"

#define BYTES 200000u
#define FRAMES 20000u

static inbox_t inbox;

static void *write_all(void *nothing)
{
    for (uint32_t i = 0; i < BYTES;) {
        const uint32_t before = inbox.dropped;
        const uint8_t byte = (uint8_t)i;
        inbox_put_bytes(&inbox, &byte, 1, i);
        i += inbox.dropped == before;
    }
    for (uint16_t i = 0; i < FRAMES;) {
        const uint32_t before = inbox.dropped;
        const sp_can_frame_t frame = {.id = i, .length = 1, .data = {(uint8_t)i}};
        inbox_put_frame(&inbox, &frame, i);
        i = (uint16_t)(i + (inbox.dropped == before));
    }
    return nothing;
}

static void expect(bool holds, const char *what)
{
    if (!holds) {
        fprintf(stderr, "%s\n", what);
        exit(1);
    }
}

int main(void)
{
    pthread_t writer;
    uint8_t byte;
    uint32_t arrived_us;
    sp_can_frame_t frame;
    expect(pthread_create(&writer, NULL, write_all, NULL) == 0, "no thread");
    for (uint32_t i = 0; i < BYTES;) {
        if (inbox_take_byte(&inbox, &byte, &arrived_us)) {
            expect(byte == (uint8_t)i, "a byte is out of order");
            expect(byte != 0 || arrived_us == i, "a zero has another's stamp");
            i++;
        }
    }
    for (uint16_t i = 0; i < FRAMES;) {
        if (inbox_take_frame(&inbox, &frame, &arrived_us)) {
            expect(frame.id == i && frame.data[0] == (uint8_t)i && arrived_us == i, "a frame");
            i++;
        }
    }
    return pthread_join(writer, NULL);
}
