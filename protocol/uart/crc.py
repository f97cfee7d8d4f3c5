"""Table of the CRC-32 of IEEE 802.3."""

from __future__ import annotations

POLYNOMIAL = 0xEDB88320
"""CRC polynomial 0x04C11DB7 with its bits reversed."""


def crc_table(bits: int) -> list[int]:
    """Return the effect of each value of ``bits`` bits on the CRC register."""
    table = []
    for value in range(1 << bits):
        register = value
        for _ in range(bits):
            register = register >> 1 ^ (POLYNOMIAL if register & 1 else 0)
        table.append(register)
    return table
