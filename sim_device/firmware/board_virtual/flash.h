/* The two flash pages of the virtual board. Erasing and writing take as long as on the chip. A loss
 * of supply in this time leaves a page incomplete. */
#ifndef VIRTUAL_FLASH_H
#define VIRTUAL_FLASH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board.h"

typedef enum { FLASH_JOB_NONE, FLASH_JOB_ERASE, FLASH_JOB_WRITE } flash_job_t;

typedef struct {
    uint8_t pages[BOARD_FLASH_PAGES][BOARD_FLASH_PAGE_SIZE];
    flash_job_t job;
    unsigned page;
    size_t offset;
    const uint8_t *data;
    size_t length;
    uint64_t began_us;
} virtual_flash_t;

/* Set the state of a new chip: erased. */
void virtual_flash_new(virtual_flash_t *flash);

void virtual_flash_erase(virtual_flash_t *flash, unsigned page, uint64_t now_us);
void virtual_flash_write(virtual_flash_t *flash, unsigned page, size_t offset,
    const uint8_t *data, size_t length, uint64_t now_us);

/* Continue the operation in progress up to `now_us`; return true if it is not complete. */
bool virtual_flash_busy(virtual_flash_t *flash, uint64_t now_us);

/* Abort the operation in progress at its present state. */
void virtual_flash_lose_supply(virtual_flash_t *flash, uint64_t now_us);

#endif
