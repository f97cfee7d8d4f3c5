/* The functions that the tests' adapter needs for each message. The table is generated from the
 * catalogue. */
#ifndef ADAPTER_H
#define ADAPTER_H

#include "sweepctl_protocol.h"

typedef struct {
    uint8_t type;
    /* Decode and print " field=value ..."; return false if the length is wrong. */
    bool (*show)(const uint8_t *payload, size_t length);
    /* Encode values given as words into a frame; return 0 if they do not fit. */
    size_t (*frame)(uint8_t *frame, sp_sender_t *sender, uint32_t t_us, char **words);
    /* Decode and encode again; return the length, or -1. */
    int (*again)(const uint8_t *payload, size_t length, uint8_t *out, size_t capacity);
    /* Print " name=value:raw ..." of values in SI units and of the raw value encoded from each. */
    void (*si)(const uint8_t *payload, size_t length);
} adapter_message_t;

extern const adapter_message_t adapter_messages[];
extern const size_t adapter_message_count;

const adapter_message_t *adapter_find(uint8_t type);
long long adapter_number(const char *word);
/* Replace hexadecimal digits ("-": none) by bytes in place; return their number. */
size_t adapter_unhex(char *word);
void adapter_hex(const void *data, size_t length);

#endif
