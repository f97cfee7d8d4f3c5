/* Checks the length of the host's payloads. A valid payload has the length of its message. For an
 * older host, it has the length of the fields that the host has reported in its describe
 * message. */
#ifndef PAYLOADS_H
#define PAYLOADS_H

#include <stdbool.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

#define MESSAGE_TYPES 128u
#define PAYLOAD_MAX_SIZE 25u /* maximum size of a host's message, without its text */

typedef struct {
    uint8_t known_fields[MESSAGE_TYPES]; /* number of fields that the host declares, plus 1; 0: all
                                            fields */
    uint8_t padded[PAYLOAD_MAX_SIZE];
} payloads_t;

/* Start with a new host: every message has its full length. */
void payloads_reset(payloads_t *payloads);

/* Store the number of fields of a message that the host declares. */
void payloads_described(payloads_t *payloads, const sp_describe_t *question);

/* Return the number of payload bytes that the host declares, without text; 0: not a host's
 * message. */
uint8_t payloads_known(const payloads_t *payloads, uint8_t type);

/* Check a frame's payload; return false if its length does not match its message. The payload of an
 * older host is extended to the full length with zeros. */
bool payloads_fit(payloads_t *payloads, sp_frame_t *frame);

#endif
