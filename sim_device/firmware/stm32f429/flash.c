/* Driver of the two flash pages, which are sectors 12 and 13: the first sectors of the second bank.
 * So the program continues in the first bank while the pages are erased and written (RM0090 3.4:
 * read while write). The second bank begins in the middle of the flash, at 1 MB in a chip of 2 MB
 * (table 6). A chip of 1 MB has two banks only with the option bit DB1M (table 7; 3.9.10). Without
 * this bit, parameters cannot be saved: the program would run from the same bank, and erasing a
 * sector would stop it for longer than the watchdog's timeout. */
#include "cortex_m4.h"
#include "f429.h"
#include "stm32f4.h"

#define FLASH_ADDRESS 0x08000000u
#define WHOLE_KIB 2048u
#define SECTOR_BYTES 0x4000u
#define FIRST_CODE 16u /* 3.9.8: the code of sector 12 is 10000 */

void flash_handler(void);

static volatile bool busy;
static const uint8_t *volatile next;
static volatile uint32_t to_address, words_left;

bool flash_can_save(void) {
    return FLASH_KIB == WHOLE_KIB || (FLASH->optcr & FLASH_OPTCR_DB1M) != 0;
}

static uint32_t address_of(unsigned page) {
    return FLASH_ADDRESS + FLASH_KIB * 1024u / 2u + SECTOR_BYTES * page;
}

const uint8_t *board_flash_page(board_t *board, unsigned page) {
    return (const uint8_t *)(uintptr_t)address_of(page);
}

/* Start an operation, and disable the data cache until it is complete, because the program reads
 * its constants from the first bank during this time. ES0206 (errata of the F42x): "Data cache
 * might be corrupted during Flash memory read-while-write operation". */
static void begin(void) {
    if ((FLASH->cr & FLASH_CR_LOCK) != 0) {
        FLASH->keyr = FLASH_KEY_1;
        FLASH->keyr = FLASH_KEY_2;
    }
    /* After a start without a reset, EOP may be set by the previous program. nvic_enable() then drops
     * the pending interrupt, whose handler would lock CR again. */
    FLASH->sr = FLASH_SR_EOP | FLASH_SR_ERRORS;
    FLASH->acr &= ~FLASH_ACR_DCEN;
    nvic_enable(IRQ_FLASH, LEVEL_FLASH);
}

void board_flash_erase(board_t *board, unsigned page) {
    if (!flash_can_save()) {
        return;
    }
    begin();
    busy = true;
    words_left = 0;
    FLASH->cr = FLASH_CR_SER | FLASH_CR_SNB(FIRST_CODE + page) | FLASH_CR_PSIZE_32 |
                FLASH_CR_EOPIE | FLASH_CR_ERRIE;
    FLASH->cr |= FLASH_CR_STRT;
}

/* Write a word. All variables that the interrupt reads are set before the store that can trigger
 * it. */
static void write_word(void) {
    const uint8_t *const from = next;
    const uint32_t to = to_address;
    const uint32_t word = (uint32_t)from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 |
                          (uint32_t)from[3] << 24;
    next = from + 4;
    words_left--;
    to_address = to + 4u;
    *(volatile uint32_t *)(uintptr_t)to = word;
    barrier();
}

void board_flash_write(board_t *board, unsigned page, size_t offset, const uint8_t *data, size_t length) {
    if (!flash_can_save() || length < 4u) {
        return;
    }
    begin();
    busy = true;
    next = data;
    to_address = address_of(page) + (uint32_t)offset;
    words_left = (uint32_t)(length / 4u);
    FLASH->cr = FLASH_CR_PG | FLASH_CR_PSIZE_32 | FLASH_CR_EOPIE | FLASH_CR_ERRIE;
    write_word();
}

/* Interrupt: write the next word. At the end of the operation, clear the data cache, because it may
 * contain old content (3.9.2: this requires DCEN = 0), and enable it again. */
void flash_handler(void) {
    const uint32_t flags = FLASH->sr;
    FLASH->sr = FLASH_SR_EOP | FLASH_SR_ERRORS;
    if ((flags & FLASH_SR_ERRORS) == 0 && words_left != 0) {
        write_word();
        return;
    }
    FLASH->cr = FLASH_CR_LOCK;
    FLASH->acr |= FLASH_ACR_DCRST;
    FLASH->acr &= ~FLASH_ACR_DCRST;
    FLASH->acr |= FLASH_ACR_DCEN;
    busy = false;
}

bool board_flash_busy(board_t *board) { return busy; }
