/* Authenticated frames: a counter and a tag that only the key's holders can make
 * (docs/protocol/PROTOCOL.md, Authentication). The tag is checked before the counter and in constant
 * time: whoever has not the key learns nothing of either. */
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
    bool begun; /* there is a session: what is signed may be taken */
    uint32_t words[KEY_WORDS]; /* the key, as set_key carries it; all 0: none */
    hmac_key_t key;
    uint32_t openings; /* sessions since boot: their challenges differ */
    uint32_t nonce[3]; /* boot id, session id, challenge */
    uint32_t counter;  /* the last that was taken */
} authentication_t;

/* Use this key from now on; all words 0: none. */
void authentication_use(authentication_t *keys, const uint32_t words[KEY_WORDS]);

/* A session begins: frames of another one do not fit any more. */
void authentication_open(authentication_t *keys, uint32_t boot_id, uint32_t session_id);

/* No session: nothing that is signed is taken. */
void authentication_close(authentication_t *keys);

/* Count from which this session's signed frames go on. */
static inline uint32_t authentication_challenge(const authentication_t *keys)
{
    return keys->nonce[2];
}

/* Whether what follows on the covered bytes, a counter and a tag, is this session's and new; it
 * counts then. Of a UART frame SP_TRAILER_SIZE bytes, of a CAN frame SP_CAN_TRAILER_SIZE. */
bool authentication_check(authentication_t *keys, const uint8_t *covered, size_t length,
    const uint8_t *trailer, size_t trailer_length);

#endif
