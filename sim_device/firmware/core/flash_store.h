/* Keeps the parameters in two pages of flash, whatever moment the supply is lost at: a save erases
 * the page that is not in use and writes the new record there, its check last. Until that stands,
 * the other page is what the next boot finds. */
#ifndef FLASH_STORE_H
#define FLASH_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "authentication.h"
#include "board.h"
#include "parameters.h"

/* A record, little-endian words: magic, number of the save, number of entries; then key and value
 * of each; then the CRC-32 of all before it. */
#define FLASH_VALUES (PARAMETERS + KEY_WORDS)
#define FLASH_RECORD_WORDS (3u + 2u * FLASH_VALUES + 1u)

typedef enum { FLASH_IDLE, FLASH_ERASING, FLASH_WRITING } flash_step_t;

/* What came of a save in this period. */
typedef enum { FLASH_NOTHING, FLASH_SAVED, FLASH_FAILED } flash_result_t;

typedef struct {
    flash_step_t step;
    uint8_t page;
    uint8_t words;
    uint8_t record[4u * FLASH_RECORD_WORDS];
} flash_store_t;

/* What the newest whole record says of each parameter and, behind them, of the key. */
void flash_store_load(board_t *board, stored_t stored[FLASH_VALUES]);

/* Start to save; flash_store_step() carries it on. */
void flash_store_begin(
    flash_store_t *store, board_t *board, const stored_t image[FLASH_VALUES]);

/* Once a control period: tells as the save has ended, and whether what was written reads back. */
flash_result_t flash_store_step(flash_store_t *store, board_t *board);

/* Forget everything that is stored. It waits for the flash: to be called before a reset only. */
void flash_store_erase(board_t *board);

static inline bool flash_store_busy(const flash_store_t *store)
{
    return store->step != FLASH_IDLE;
}

#endif
