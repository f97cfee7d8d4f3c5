/* Stores the parameters in two flash pages; a loss of supply at any time leaves one page valid. A
 * save erases the older page and writes the new record there. The CRC of the record is written
 * last. Without this CRC, the next boot reads the other page. */
#ifndef FLASH_STORE_H
#define FLASH_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "authentication.h"
#include "board.h"
#include "parameters.h"

/* Number of values in a record. A record is little-endian words: magic, number of the save, number
 * of entries; key and value of each entry; the CRC-32 of everything before it. */
#define FLASH_VALUES (PARAMETERS + KEY_WORDS)
#define FLASH_RECORD_WORDS (3u + 2u * FLASH_VALUES + 1u)
/* An array of negative size is an error: a record must fit into a page. */
typedef char record_fits_into_a_page[4u * FLASH_RECORD_WORDS <= BOARD_FLASH_PAGE_SIZE ? 1 : -1];

typedef enum { FLASH_IDLE, FLASH_ERASING, FLASH_WRITING } flash_step_t;

/* Result of a save in this period. */
typedef enum { FLASH_NOTHING, FLASH_SAVED, FLASH_FAILED } flash_result_t;

typedef struct {
    flash_step_t step;
    uint8_t page;
    uint16_t words;
    uint8_t record[4u * FLASH_RECORD_WORDS];
} flash_store_t;

/* Read all parameters and the key from the newest complete record. */
void flash_store_load(board_t *board, stored_t stored[FLASH_VALUES]);

/* Start a save; flash_store_step() continues it. */
void flash_store_begin(
    flash_store_t *store, board_t *board, const stored_t image[FLASH_VALUES]);

/* Call once per control period: continue the save; at its end, check that the flash reads back
 * correctly. */
flash_result_t flash_store_step(flash_store_t *store, board_t *board);

/* Erase everything that is stored. The function waits for the flash: call it only before a reset.
 */
void flash_store_erase(board_t *board);

static inline bool flash_store_busy(const flash_store_t *store)
{
    return store->step != FLASH_IDLE;
}

#endif
