#include "sha256.h"

#include <string.h>

#define ROUNDS 64u
#define LENGTH_AT 56u /* index of the message length (in bits) in the last block */
#define INNER 0x36u
#define OUTER 0x5Cu

/* Constants of FIPS 180-4, 4.2.2 and 5.3.3: fractional parts of the roots of the first primes. */
static const uint32_t rounds[ROUNDS] = {0x428A2F98u, 0x71374491u, 0xB5C0FBCFu, 0xE9B5DBA5u,
    0x3956C25Bu, 0x59F111F1u, 0x923F82A4u, 0xAB1C5ED5u, 0xD807AA98u, 0x12835B01u, 0x243185BEu,
    0x550C7DC3u, 0x72BE5D74u, 0x80DEB1FEu, 0x9BDC06A7u, 0xC19BF174u, 0xE49B69C1u, 0xEFBE4786u,
    0x0FC19DC6u, 0x240CA1CCu, 0x2DE92C6Fu, 0x4A7484AAu, 0x5CB0A9DCu, 0x76F988DAu, 0x983E5152u,
    0xA831C66Du, 0xB00327C8u, 0xBF597FC7u, 0xC6E00BF3u, 0xD5A79147u, 0x06CA6351u, 0x14292967u,
    0x27B70A85u, 0x2E1B2138u, 0x4D2C6DFCu, 0x53380D13u, 0x650A7354u, 0x766A0ABBu, 0x81C2C92Eu,
    0x92722C85u, 0xA2BFE8A1u, 0xA81A664Bu, 0xC24B8B70u, 0xC76C51A3u, 0xD192E819u, 0xD6990624u,
    0xF40E3585u, 0x106AA070u, 0x19A4C116u, 0x1E376C08u, 0x2748774Cu, 0x34B0BCB5u, 0x391C0CB3u,
    0x4ED8AA4Au, 0x5B9CCA4Fu, 0x682E6FF3u, 0x748F82EEu, 0x78A5636Fu, 0x84C87814u, 0x8CC70208u,
    0x90BEFFFAu, 0xA4506CEBu, 0xBEF9A3F7u, 0xC67178F2u};
static const uint32_t initial[8] = {0x6A09E667u, 0xBB67AE85u, 0x3C6EF372u, 0xA54FF53Au,
    0x510E527Fu, 0x9B05688Cu, 0x1F83D9ABu, 0x5BE0CD19u};

static uint32_t turned(uint32_t word, unsigned bits)
{
    return word >> bits | word << (32u - bits);
}

static uint32_t big_endian(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

/* Compression function of FIPS 180-4, 6.2.2; it stores only the sixteen words of the message
 * schedule that are still needed. */
static void compress(uint32_t state[8], const uint8_t *block)
{
    uint32_t words[16];
    uint32_t s[8];
    memcpy(s, state, sizeof s);
    for (unsigned i = 0; i < ROUNDS; i++) {
        uint32_t *const word = &words[i % 16u];
        if (i < 16u) {
            *word = big_endian(block + 4u * i);
        } else {
            const uint32_t before_15 = words[(i + 1u) % 16u];
            const uint32_t before_2 = words[(i + 14u) % 16u];
            *word += (turned(before_15, 7) ^ turned(before_15, 18) ^ before_15 >> 3)
                + words[(i + 9u) % 16u]
                + (turned(before_2, 17) ^ turned(before_2, 19) ^ before_2 >> 10);
        }
        const uint32_t first = s[7] + (turned(s[4], 6) ^ turned(s[4], 11) ^ turned(s[4], 25))
            + ((s[4] & s[5]) ^ (~s[4] & s[6])) + rounds[i] + *word;
        const uint32_t second = (turned(s[0], 2) ^ turned(s[0], 13) ^ turned(s[0], 22))
            + ((s[0] & s[1]) ^ (s[0] & s[2]) ^ (s[1] & s[2]));
        memmove(s + 1, s, 7u * sizeof *s);
        s[4] += first;
        s[0] = first + second;
    }
    for (unsigned i = 0; i < 8u; i++) {
        state[i] += s[i];
    }
}

void sha256_begin(sha256_t *hash)
{
    memcpy(hash->state, initial, sizeof initial);
    hash->length = 0;
}

void sha256_add(sha256_t *hash, const uint8_t *data, size_t length)
{
    for (size_t i = 0; i < length; i++) {
        hash->block[hash->length % SHA256_BLOCK] = data[i];
        hash->length++;
        if (hash->length % SHA256_BLOCK == 0) {
            compress(hash->state, hash->block);
        }
    }
}

void sha256_end(sha256_t *hash, uint8_t digest[SHA256_SIZE])
{
    static const uint8_t one = 0x80;
    static const uint8_t zero = 0;
    const uint32_t length = hash->length;
    sha256_add(hash, &one, 1);
    while (hash->length % SHA256_BLOCK != LENGTH_AT) {
        sha256_add(hash, &zero, 1);
    }
    const uint32_t bits[2] = {length >> 29, length << 3};
    for (unsigned i = 0; i < 8u; i++) {
        const uint8_t byte = (uint8_t)(bits[i / 4u] >> (24u - 8u * (i % 4u)));
        sha256_add(hash, &byte, 1);
    }
    for (unsigned i = 0; i < SHA256_SIZE; i++) {
        digest[i] = (uint8_t)(hash->state[i / 4u] >> (24u - 8u * (i % 4u)));
    }
}

static void key_block(uint32_t state[8], const uint8_t *bytes, size_t length, uint8_t with)
{
    uint8_t block[SHA256_BLOCK];
    for (size_t i = 0; i < SHA256_BLOCK; i++) {
        block[i] = (uint8_t)((i < length ? bytes[i] : 0u) ^ with);
    }
    memcpy(state, initial, sizeof initial);
    compress(state, block);
}

void hmac_key(hmac_key_t *key, const uint8_t *bytes, size_t length)
{
    key_block(key->inner, bytes, length, INNER);
    key_block(key->outer, bytes, length, OUTER);
}

static void start_from(sha256_t *hash, const uint32_t state[8])
{
    memcpy(hash->state, state, sizeof hash->state);
    hash->length = SHA256_BLOCK;
}

void hmac_begin(const hmac_key_t *key, sha256_t *hash)
{
    start_from(hash, key->inner);
}

void hmac_end(const hmac_key_t *key, sha256_t *hash, uint8_t digest[SHA256_SIZE])
{
    sha256_end(hash, digest);
    start_from(hash, key->outer);
    sha256_add(hash, digest, SHA256_SIZE);
    sha256_end(hash, digest);
}
