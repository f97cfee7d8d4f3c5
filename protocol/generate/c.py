"""C99 for firmware: one header, one source, nothing but ``stdint`` beneath.

No allocation, no I/O, no recursion; everything that is kept stands in structs of the caller.
"""

from __future__ import annotations

from protocol.generate import c_can, c_header_text, c_messages, c_source_text
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue

HEADER = "sweepctl_protocol.h"
SOURCE = "sweepctl_protocol.c"


def render(catalogue: Catalogue = CATALOGUE) -> dict[str, str]:
    """Header and source for a catalogue, by file name."""
    return {HEADER: _header(catalogue), SOURCE: _source(catalogue)}


def _origin(catalogue: Catalogue, what: str) -> str:
    return (
        f"/* {what}\n"
        " *\n"
        " * Made by `sweepctl generate c`; changes belong into the catalogue.\n"
        f" * Protocol version {PROTOCOL_VERSION}, catalogue 0x{catalogue.hash:08X}, "
        f"{len(catalogue.specs)} messages.\n"
        " * SPDX-License-Identifier: MIT\n"
        " */\n"
    )


def _header(catalogue: Catalogue) -> str:
    parts = [
        _origin(catalogue, "The sweeper's wire in C99: structs hold raw wire integers."),
        c_header_text.HEADER_TOP,
        c_messages.switches(catalogue),
        '#ifdef __cplusplus\nextern "C" {\n#endif\n',
        c_header_text.HEADER_FRAMING.format(version=PROTOCOL_VERSION),
        "/* ---- values " + "-" * 78 + " */\n",
        c_messages.enums(catalogue),
        c_messages.latch_rule(catalogue),
        "/* ---- messages " + "-" * 76 + " */\n\n"
        "/* encode: the payload's length, or -1 where it does not fit.\n"
        " * decode: false where the length is not the message's.\n"
        " * frame: a whole frame in a buffer of SP_FRAME_MAX bytes; its length, 0 where it is too\n"
        " * long. */\n",
        *(c_messages.declaration(spec) for spec in catalogue),
        c_messages.to_all(catalogue),
        c_header_text.HEADER_SCHEMA.format(hash=catalogue.hash),
        c_can.header(catalogue),
        "#ifdef __cplusplus\n}\n#endif\n\n#endif\n",
    ]
    return "\n".join(parts)


def _source(catalogue: Catalogue) -> str:
    parts = [
        _origin(catalogue, "The sweeper's wire in C99."),
        f'#include "{HEADER}"\n',
        c_source_text.SOURCE_TOP,
        c_source_text.SOURCE_CRC.format(full=_table(_crc_table(8)), nibble=_table(_crc_table(4))),
        c_source_text.SOURCE_FRAMING,
        "/* ---- messages " + "-" * 76 + " */\n",
        *(c_messages.definition(spec) for spec in catalogue),
        c_source_text.SOURCE_SCHEMA.format(
            rows=c_messages.table_rows(catalogue), chains=c_messages.chain_rows(catalogue)
        ),
        c_can.source(catalogue),
    ]
    return "\n".join(parts)


def _crc_table(bits: int) -> list[int]:
    table = []
    for value in range(1 << bits):
        register = value
        for _ in range(bits):
            register = register >> 1 ^ (0xEDB88320 if register & 1 else 0)
        table.append(register)
    return table


def _table(values: list[int]) -> str:
    rows = [values[i : i + 6] for i in range(0, len(values), 6)]
    return "".join("    " + " ".join(f"0x{v:08X}u," for v in row) + "\n" for row in rows)
