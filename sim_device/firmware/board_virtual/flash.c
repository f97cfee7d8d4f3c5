#include "flash.h"

#include <string.h>

/* Typical times to erase a 16 KiB sector and to program a 32-bit word (STM32F429 data sheet). */
#define ERASE_US 250000u
#define WORD_US 16u
#define WORD_BYTES 4u
#define HALF_ERASED 0x5Au /* arbitrary value: partly erased cells may read as any value */

void virtual_flash_new(virtual_flash_t *flash)
{
    memset(flash, 0, sizeof *flash);
    memset(flash->pages, 0xFF, sizeof flash->pages);
}

static void begin(virtual_flash_t *flash, flash_job_t job, unsigned page, uint64_t now_us)
{
    (void)virtual_flash_busy(flash, now_us);
    flash->job = page < BOARD_FLASH_PAGES ? job : FLASH_JOB_NONE;
    flash->page = page;
    flash->began_us = now_us;
}

void virtual_flash_erase(virtual_flash_t *flash, unsigned page, uint64_t now_us)
{
    begin(flash, FLASH_JOB_ERASE, page, now_us);
}

void virtual_flash_write(virtual_flash_t *flash, unsigned page, size_t offset,
    const uint8_t *data, size_t length, uint64_t now_us)
{
    begin(flash, FLASH_JOB_WRITE, page, now_us);
    flash->offset = offset < BOARD_FLASH_PAGE_SIZE ? offset : BOARD_FLASH_PAGE_SIZE;
    flash->length = length < BOARD_FLASH_PAGE_SIZE - flash->offset
        ? length
        : BOARD_FLASH_PAGE_SIZE - flash->offset;
    flash->data = data;
}

/* Write the words whose programming time is over. As in real flash, bits only change from 1 to 0.
 */
static bool carry_on_writing(virtual_flash_t *flash, uint64_t spent_us)
{
    const uint64_t bytes = spent_us / WORD_US * WORD_BYTES;
    const size_t done = bytes < flash->length ? (size_t)bytes : flash->length;
    uint8_t *const to = flash->pages[flash->page] + flash->offset;
    for (size_t i = 0; i < done; i++) {
        to[i] &= flash->data[i];
    }
    return done < flash->length;
}

bool virtual_flash_busy(virtual_flash_t *flash, uint64_t now_us)
{
    const uint64_t spent_us = now_us - flash->began_us;
    bool busy = false;
    if (flash->job == FLASH_JOB_ERASE) {
        busy = spent_us < ERASE_US;
        if (!busy) {
            memset(flash->pages[flash->page], 0xFF, BOARD_FLASH_PAGE_SIZE);
        }
    } else if (flash->job == FLASH_JOB_WRITE) {
        busy = carry_on_writing(flash, spent_us);
    }
    if (!busy) {
        flash->job = FLASH_JOB_NONE;
    }
    return busy;
}

void virtual_flash_lose_supply(virtual_flash_t *flash, uint64_t now_us)
{
    if (virtual_flash_busy(flash, now_us) && flash->job == FLASH_JOB_ERASE) {
        for (size_t i = 0; i < BOARD_FLASH_PAGE_SIZE; i++) {
            flash->pages[flash->page][i] |= HALF_ERASED;
        }
    }
    flash->job = FLASH_JOB_NONE;
}
