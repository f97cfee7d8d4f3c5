/* Reads lines and prints lines, for comparison with another implementation:
 *   hash HEX                      -> SHA-256
 *   hmac KEY DATA                 -> HMAC-SHA-256
 *   key WORD WORD WORD WORD       -> ok
 *   open BOOT SESSION             -> challenge
 *   check COVERED TRAILER         -> 1 or 0
 * Numbers and bytes are hexadecimal; "-" is no bytes. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "authentication.h"

static size_t bytes_of(const char *hex, uint8_t *out)
{
    size_t length = 0;
    if (hex[0] == '-') {
        return 0;
    }
    for (; hex[2u * length] != '\0'; length++) {
        const char two[3] = {hex[2u * length], hex[2u * length + 1u], '\0'};
        out[length] = (uint8_t)strtoul(two, NULL, 16);
    }
    return length;
}

static void print(const uint8_t *bytes, size_t length)
{
    for (size_t i = 0; i < length; i++) {
        printf("%02x", bytes[i]);
    }
    printf("\n");
}

int main(void)
{
    static char line[8192], first[4096], second[4096], third[16], fourth[16];
    static uint8_t a[4096], b[4096];
    static authentication_t keys;
    uint8_t digest[SHA256_SIZE];
    sha256_t hash;
    while (fgets(line, sizeof line, stdin) != NULL) {
        char what[8] = "";
        (void)sscanf(line, "%7s %4095s %4095s %15s %15s", what, first, second, third, fourth);
        const size_t length = bytes_of(first, a);
        if (strcmp(what, "hash") == 0) {
            sha256_begin(&hash);
            sha256_add(&hash, a, length);
            sha256_end(&hash, digest);
            print(digest, sizeof digest);
        } else if (strcmp(what, "hmac") == 0) {
            hmac_key_t key;
            hmac_key(&key, a, length);
            hmac_begin(&key, &hash);
            sha256_add(&hash, b, bytes_of(second, b));
            hmac_end(&key, &hash, digest);
            print(digest, sizeof digest);
        } else if (strcmp(what, "key") == 0) {
            const uint32_t words[KEY_WORDS] = {(uint32_t)strtoul(first, NULL, 16),
                (uint32_t)strtoul(second, NULL, 16), (uint32_t)strtoul(third, NULL, 16),
                (uint32_t)strtoul(fourth, NULL, 16)};
            memset(&keys, 0, sizeof keys);
            authentication_use(&keys, words);
            printf("ok\n");
        } else if (strcmp(what, "open") == 0) {
            authentication_open(&keys, (uint32_t)strtoul(first, NULL, 16),
                (uint32_t)strtoul(second, NULL, 16));
            printf("%x\n", (unsigned)authentication_challenge(&keys));
        } else {
            const size_t trailer_length = bytes_of(second, b);
            printf("%d\n", authentication_check(&keys, a, length, b, trailer_length));
        }
    }
    return 0;
}
