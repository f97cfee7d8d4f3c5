/* RM0090, section 4: polynomial 0x04C11DB7, highest bit first, 32 bits at a time, no mirroring,
 * no final complement. */
#include "crc_unit.h"

uint32_t crc_unit_register;

void crc_unit_write(uint32_t word)
{
    crc_unit_register ^= word;
    for (int bit = 0; bit < 32; bit++) {
        const uint32_t top = crc_unit_register & 0x80000000u;
        crc_unit_register = crc_unit_register << 1 ^ (top ? 0x04C11DB7u : 0u);
    }
}
