/* A line of text with a maximum length, built without printf. The text is always valid UTF-8. */
#ifndef TEXT_H
#define TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifndef TEXT_MAX
#define TEXT_MAX 120u /* bytes; the rest of a longer text is omitted */
#endif

typedef struct {
    uint8_t length;
    bool full; /* a part was omitted, so nothing more may be added */
    char bytes[TEXT_MAX];
} text_t;

/* Add a zero-terminated UTF-8 text. */
void text_add(text_t *text, const char *utf8);

/* Add a number: decimal digits, or eight hexadecimal digits. */
void text_add_number(text_t *text, uint32_t value);
void text_add_hex(text_t *text, uint32_t value);

/* Add bytes of unknown origin. Invalid UTF-8 becomes U+FFFD, as Unicode's section 3.9 recommends
 * (one for each longest valid beginning of a character). */
void text_add_foreign(text_t *text, const char *bytes, size_t length);

#endif
