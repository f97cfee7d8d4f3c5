#include "text.h"

#include <string.h>

static void add(text_t *text, const char *bytes, size_t length)
{
    if (text->full || text->length + length > TEXT_MAX) {
        text->full = true;
        return;
    }
    for (size_t i = 0; i < length; i++) {
        text->bytes[text->length + i] = bytes[i];
    }
    text->length = (uint8_t)(text->length + length);
}

/* Return the length of a UTF-8 character from its first byte; 0 if the byte is invalid. Also return
 * the valid range of the second byte (Unicode, table 3-7). */
static size_t character(uint8_t first, uint8_t *low, uint8_t *high)
{
    *low = 0x80u;
    *high = 0xBFu;
    if (first < 0x80u) {
        return 1;
    }
    if (first < 0xC2u || first > 0xF4u) {
        return 0;
    }
    if (first < 0xE0u) {
        return 2;
    }
    if (first < 0xF0u) {
        if (first == 0xE0u) {
            *low = 0xA0u;
        } else if (first == 0xEDu) {
            *high = 0x9Fu;
        }
        return 3;
    }
    if (first == 0xF0u) {
        *low = 0x90u;
    } else if (first == 0xF4u) {
        *high = 0x8Fu;
    }
    return 4;
}

void text_add_foreign(text_t *text, const char *bytes, size_t length)
{
    for (size_t at = 0; at < length;) {
        uint8_t low;
        uint8_t high;
        const size_t whole = character((uint8_t)bytes[at], &low, &high);
        size_t good = 1;
        while (good < whole && at + good < length) {
            const uint8_t byte = (uint8_t)bytes[at + good];
            if (byte < low || byte > high) {
                break;
            }
            low = 0x80u;
            high = 0xBFu;
            good++;
        }
        if (good == whole) {
            add(text, bytes + at, whole);
        } else {
            add(text, "\xEF\xBF\xBD", 3);
        }
        at += good;
    }
}

void text_add(text_t *text, const char *utf8)
{
    text_add_foreign(text, utf8, strlen(utf8));
}

/* Add the last `digits` digits without leading zeros. */
static void add_digits(text_t *text, uint32_t value, uint32_t base, size_t digits)
{
    char bytes[10];
    size_t at = sizeof bytes;
    do {
        bytes[--at] = "0123456789abcdef"[value % base];
        value /= base;
    } while (value != 0 || sizeof bytes - at < digits);
    add(text, bytes + at, sizeof bytes - at);
}

void text_add_number(text_t *text, uint32_t value)
{
    add_digits(text, value, 10u, 1u);
}

void text_add_hex(text_t *text, uint32_t value)
{
    add_digits(text, value, 16u, 8u);
}
