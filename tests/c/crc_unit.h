/* A model of the STM32F4's CRC unit by its manual. It replaces the unit's registers. */
#ifndef CRC_UNIT_H
#define CRC_UNIT_H

#include <stdint.h>

extern uint32_t crc_unit_register;
void crc_unit_write(uint32_t word);

#define SP_CRC_UNIT_RESET() ((void)(crc_unit_register = 0xFFFFFFFFu))
#define SP_CRC_UNIT_WRITE(word) crc_unit_write(word)
#define SP_CRC_UNIT_READ() crc_unit_register

#endif
