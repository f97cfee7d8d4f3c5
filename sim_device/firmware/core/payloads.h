/* Checks the length of the host's payloads. A valid payload is as long as its message or, if the
 * describe message of an older host says so, as long as the fields that this host knows. */
#ifndef PAYLOADS_H
#define PAYLOADS_H

#include <stdbool.h>
#include <stdint.h>

#include "sweepctl_protocol.h"

#define MESSAGE_TYPES 128u
#define PAYLOAD_MAX_SIZE 25u /* of a host's message, without its text */

typedef struct {
    uint8_t known_fields[MESSAGE_TYPES]; /* fields that the host knows, plus 1; 0: all */
    uint8_t padded[PAYLOAD_MAX_SIZE];
} payloads_t;

/* Start with a new host: every message has full length. */
void payloads_reset(payloads_t *payloads);

/* Note how many fields of a message the host knows. */
void payloads_described(payloads_t *payloads, const sp_describe_t *question);

/* Return the number of payload bytes that the host knows, without text; 0: not a host's message. */
uint8_t payloads_known(const payloads_t *payloads, uint8_t type);

/* Check a frame's payload; return false if its length does not match its message. The payload of an
 * older host is replaced by a complete one, zero after its end. */
bool payloads_fit(payloads_t *payloads, sp_frame_t *frame);

#endif
