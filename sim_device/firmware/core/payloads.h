/* Which payloads of the host are taken: as long as their message, or, once an older host has said
 * so in its describe, as long as the fields that it knows. */
#ifndef PAYLOADS_H
#define PAYLOADS_H

#include <stdbool.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

#define MESSAGE_TYPES 128u
#define PAYLOAD_MAX_SIZE 25u /* of a host's message, its text left out */

typedef struct {
    uint8_t known_fields[MESSAGE_TYPES]; /* that the host knows, plus 1; 0: all */
    uint8_t padded[PAYLOAD_MAX_SIZE];
} payloads_t;

/* A new host: every message is whole. */
void payloads_reset(payloads_t *payloads);

/* Note how many fields of a message the host knows. */
void payloads_described(payloads_t *payloads, const sp_describe_t *question);

/* Bytes of a message's payload, its text left out, that the host knows; 0: it is none of its own. */
uint8_t payloads_known(const payloads_t *payloads, uint8_t type);

/* Judge a frame's payload: false where it is not one of its message. One that an older host sends
 * is replaced by a whole one, zero where it ends. */
bool payloads_fit(payloads_t *payloads, sp_frame_t *frame);

#endif
