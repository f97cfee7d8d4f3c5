/* SHA-256 (FIPS 180-4), and HMAC-SHA-256 (RFC 2104) for keys of at most one block. The code is
 * optimised for size. */
#ifndef SHA256_H
#define SHA256_H

#include <stddef.h>
#include <stdint.h>

#define SHA256_BLOCK 64u
#define SHA256_SIZE 32u

typedef struct {
    uint32_t state[8];
    uint32_t length; /* number of bytes so far */
    uint8_t block[SHA256_BLOCK];
} sha256_t;

void sha256_begin(sha256_t *hash);
void sha256_add(sha256_t *hash, const uint8_t *data, size_t length);
void sha256_end(sha256_t *hash, uint8_t digest[SHA256_SIZE]);

/* A prepared key: the states of both hashes after their first block, which contains the key. */
typedef struct {
    uint32_t inner[8];
    uint32_t outer[8];
} hmac_key_t;

void hmac_key(hmac_key_t *key, const uint8_t *bytes, size_t length);
void hmac_begin(const hmac_key_t *key, sha256_t *hash);
void hmac_end(const hmac_key_t *key, sha256_t *hash, uint8_t digest[SHA256_SIZE]);

#endif
