#include "authentication.h"

#define HALF 0x80000000u
#define SHORT 0x10000u

static void put_u32(uint8_t *to, uint32_t value)
{
    for (unsigned i = 0; i < 4u; i++) {
        to[i] = (uint8_t)(value >> (8u * i));
    }
}

static void add_u32(sha256_t *hash, uint32_t value)
{
    uint8_t bytes[4];
    put_u32(bytes, value);
    sha256_add(hash, bytes, sizeof bytes);
}

void authentication_use(authentication_t *keys, const uint32_t words[KEY_WORDS])
{
    uint8_t bytes[4u * KEY_WORDS];
    uint32_t any = 0;
    for (unsigned i = 0; i < KEY_WORDS; i++) {
        keys->words[i] = words[i];
        put_u32(bytes + 4u * i, words[i]);
        any |= words[i];
    }
    keys->keyed = any != 0;
    keys->begun = false;
    hmac_key(&keys->key, bytes, sizeof bytes);
}

void authentication_open(authentication_t *keys, uint32_t boot_id, uint32_t session_id)
{
    sha256_t hash;
    uint8_t digest[SHA256_SIZE];
    if (!keys->keyed) {
        return;
    }
    keys->openings++;
    hmac_begin(&keys->key, &hash);
    sha256_add(&hash, (const uint8_t *)"challenge", 9);
    add_u32(&hash, boot_id);
    add_u32(&hash, session_id);
    add_u32(&hash, keys->openings);
    hmac_end(&keys->key, &hash, digest);
    keys->nonce[0] = boot_id;
    keys->nonce[1] = session_id;
    keys->nonce[2] = (uint32_t)digest[0] | (uint32_t)digest[1] << 8 | (uint32_t)digest[2] << 16
        | (uint32_t)digest[3] << 24;
    keys->counter = keys->nonce[2];
    keys->begun = true;
}

void authentication_close(authentication_t *keys)
{
    keys->begun = false;
}

static void make_tag(const authentication_t *keys, const uint8_t *covered, size_t length,
    uint32_t counter, uint8_t digest[SHA256_SIZE])
{
    sha256_t hash;
    hmac_begin(&keys->key, &hash);
    for (unsigned i = 0; i < 3u; i++) {
        add_u32(&hash, keys->nonce[i]);
    }
    sha256_add(&hash, covered, length);
    add_u32(&hash, counter);
    hmac_end(&keys->key, &hash, digest);
}

/* Compare in constant time, so that the duration reveals nothing about the tag. */
static bool same(const uint8_t *a, const uint8_t *b, size_t length)
{
    uint8_t differ = 0;
    for (size_t i = 0; i < length; i++) {
        differ = (uint8_t)(differ | (a[i] ^ b[i]));
    }
    return differ == 0;
}

bool authentication_check(authentication_t *keys, const uint8_t *covered, size_t length,
    const uint8_t *trailer, size_t trailer_length)
{
    const size_t counter_length = trailer_length == SP_TRAILER_SIZE ? 4u : 2u;
    uint32_t counter = 0;
    uint8_t digest[SHA256_SIZE];
    if (!keys->begun
        || (trailer_length != SP_TRAILER_SIZE && trailer_length != SP_CAN_TRAILER_SIZE)) {
        return false;
    }
    for (size_t i = 0; i < counter_length; i++) {
        counter |= (uint32_t)trailer[i] << (8u * i);
    }
    if (counter_length == 2u) {
        /* A CAN trailer has only the low 16 bits of the counter. Use the lowest counter with these
         * low bits that is greater than the last accepted counter. */
        const uint32_t ahead = (counter - keys->counter) % SHORT;
        counter = keys->counter + (ahead != 0 ? ahead : SHORT);
    }
    make_tag(keys, covered, length, counter, digest);
    const bool genuine =
        same(digest, trailer + counter_length, trailer_length - counter_length);
    const uint32_t ahead = counter - keys->counter;
    if (!genuine || ahead == 0 || ahead >= HALF) {
        return false;
    }
    keys->counter = counter;
    return true;
}
