#include "flash_store.h"

#include <string.h>

#include "clock.h"

#define MAGIC 0x52415053u /* "SPAR" */
#define HEAD_WORDS 3u
#define NO_PAGE BOARD_FLASH_PAGES

/* Return the key of a value in the record: the CRC-32 of its name. A later firmware finds the value
 * by this key. */
static uint32_t key_of(uint8_t number)
{
    uint8_t name[] = "authentication 0";
    if (number < PARAMETERS) {
        return parameters_key(number);
    }
    name[sizeof name - 2u] = (uint8_t)('0' + (number - PARAMETERS));
    return sp_crc32_update(0, name, sizeof name - 1u);
}

static uint32_t word(const uint8_t *page, size_t index)
{
    const uint8_t *const p = page + 4u * index;
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static void put_word(uint8_t *record, size_t index, uint32_t value)
{
    for (size_t i = 0; i < 4u; i++) {
        record[4u * index + i] = (uint8_t)(value >> (8u * i));
    }
}

/* Return the number of entries of a page; 0 if the page is incomplete. */
static size_t whole(const uint8_t *page)
{
    const uint32_t entries = word(page, 2);
    if (word(page, 0) != MAGIC || entries == 0
        || entries > (BOARD_FLASH_PAGE_SIZE / 4u - HEAD_WORDS - 1u) / 2u) {
        return 0;
    }
    const size_t words = HEAD_WORDS + 2u * entries;
    return sp_crc32_update(0, page, 4u * words) == word(page, words) ? entries : 0u;
}

/* Return the page with the newest complete record; NO_PAGE: no record. */
static unsigned newest(board_t *board)
{
    const uint8_t *const first = board_flash_page(board, 0);
    const uint8_t *const second = board_flash_page(board, 1);
    if (whole(first) == 0) {
        return whole(second) == 0 ? NO_PAGE : 1u;
    }
    return whole(second) != 0 && signed32(word(second, 1) - word(first, 1)) > 0 ? 1u : 0u;
}

void flash_store_load(board_t *board, stored_t stored[FLASH_VALUES])
{
    const unsigned page_number = newest(board);
    for (uint8_t i = 0; i < FLASH_VALUES; i++) {
        stored[i].known = false;
        stored[i].value = 0;
    }
    if (page_number == NO_PAGE) {
        return;
    }
    const uint8_t *const page = board_flash_page(board, page_number);
    const size_t entries = whole(page);
    for (size_t entry = 0; entry < entries; entry++) {
        for (uint8_t i = 0; i < FLASH_VALUES; i++) {
            if (word(page, HEAD_WORDS + 2u * entry) == key_of(i)) {
                stored[i].known = true;
                stored[i].value = word(page, HEAD_WORDS + 2u * entry + 1u);
            }
        }
    }
}

void flash_store_begin(
    flash_store_t *store, board_t *board, const stored_t image[FLASH_VALUES])
{
    const unsigned page = newest(board);
    const uint32_t number = page == NO_PAGE ? 0u : word(board_flash_page(board, page), 1) + 1u;
    uint32_t entries = 0;
    for (uint8_t i = 0; i < FLASH_VALUES; i++) {
        if (image[i].known) {
            put_word(store->record, HEAD_WORDS + 2u * entries, key_of(i));
            put_word(store->record, HEAD_WORDS + 2u * entries + 1u, image[i].value);
            entries++;
        }
    }
    const size_t words = HEAD_WORDS + 2u * entries;
    put_word(store->record, 0, MAGIC);
    put_word(store->record, 1, number);
    put_word(store->record, 2, entries);
    put_word(store->record, words, sp_crc32_update(0, store->record, 4u * words));
    store->words = (uint16_t)(words + 1u);
    store->page = page == NO_PAGE ? 0u : (uint8_t)(1u - page);
    store->step = FLASH_ERASING;
    board_flash_erase(board, store->page);
}

flash_result_t flash_store_step(flash_store_t *store, board_t *board)
{
    if (store->step == FLASH_IDLE || board_flash_busy(board)) {
        return FLASH_NOTHING;
    }
    if (store->step == FLASH_ERASING) {
        store->step = FLASH_WRITING;
        board_flash_write(board, store->page, 0, store->record, 4u * store->words);
        return FLASH_NOTHING;
    }
    store->step = FLASH_IDLE;
    const uint8_t *const page = board_flash_page(board, store->page);
    return memcmp(page, store->record, 4u * store->words) == 0 ? FLASH_SAVED : FLASH_FAILED;
}

void flash_store_erase(board_t *board)
{
    while (board_flash_busy(board)) { /* a save that was accepted after the reboot command */
        board_watchdog_feed(board);
    }
    for (unsigned page = 0; page < BOARD_FLASH_PAGES; page++) {
        board_flash_erase(board, page);
        while (board_flash_busy(board)) {
            board_watchdog_feed(board);
        }
    }
}
