/* Authenticated frames: a counter and a tag that only holders of the key can make
 * (docs/protocol/PROTOCOL.md, Authentication). The tag is checked before the counter and in
 * constant time, so a sender without the key gets no information about tag or counter. */
#ifndef AUTHENTICATION_H
#define AUTHENTICATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sha256.h"
#include "sweepctl_protocol.h"

#define KEY_WORDS 4u

typedef struct {
    bool keyed;
    bool begun; /* a session is open: signed frames may be accepted */
    uint32_t words[KEY_WORDS]; /* the key as in set_key; all 0: no key */
    hmac_key_t key;
    uint32_t openings; /* number of sessions since boot, so that challenges differ */
    uint32_t nonce[3]; /* boot id, session id, challenge */
    uint32_t counter;  /* the last accepted counter */
} authentication_t;

/* Set the key; all words 0: no key. */
void authentication_use(authentication_t *keys, const uint32_t words[KEY_WORDS]);

/* Begin a session; signed frames of other sessions are invalid. */
void authentication_open(authentication_t *keys, uint32_t boot_id, uint32_t session_id);

/* End the session; no signed frame is accepted. */
void authentication_close(authentication_t *keys);

/* Return the challenge: the start value of the counter in this session. */
static inline uint32_t authentication_challenge(const authentication_t *keys)
{
    return keys->nonce[2];
}

/* Return whether the tag is valid in this session and its counter is new. If so, store the counter
 * as the last accepted counter. `trailer` is the counter and the tag: SP_TRAILER_SIZE bytes in a
 * UART frame, SP_CAN_TRAILER_SIZE bytes in a CAN frame. */
bool authentication_check(authentication_t *keys, const uint8_t *covered, size_t length,
    const uint8_t *trailer, size_t trailer_length);

#endif
