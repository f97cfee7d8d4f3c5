/* A line of text of bounded length, built without printf; always valid UTF-8. */
#ifndef TEXT_H
#define TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifndef TEXT_MAX
#define TEXT_MAX 120u /* bytes; the rest of a longer text is left out */
#endif

typedef struct {
    uint8_t length;
    bool full; /* something was left out: nothing may follow */
    char bytes[TEXT_MAX];
} text_t;

/* UTF-8, ended by a zero. */
void text_add(text_t *text, const char *utf8);

/* Add a number in decimal digits; the other function adds eight hexadecimal digits. */
void text_add_number(text_t *text, uint32_t value);
void text_add_hex(text_t *text, uint32_t value);

/* Add bytes of unknown origin. Invalid UTF-8 becomes U+FFFD, as Unicode's section 3.9 recommends
 * (one for each longest valid beginning of a character). */
void text_add_foreign(text_t *text, const char *bytes, size_t length);

#endif
