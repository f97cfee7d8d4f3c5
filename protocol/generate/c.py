"""Generates C99 for firmware: one header and one source, which include only standard headers.

The generated code has no memory allocation, no I/O and no recursion. All its state is in structs of
the caller.
"""

from __future__ import annotations

from protocol.authentication import CAN_AUTH_TYPE, CAN_TRAILER, TRAILER
from protocol.can.awaiting_tag import TOGETHER_US
from protocol.can.frames import STAMP_SHIFT
from protocol.can.link import DUPLICATE_US
from protocol.can.stamps import DRIFT_PPM, LEAD_US, OLDEST_US, STEP_US
from protocol.can.transfers import (
    END,
    FLAG_WHOLE_STAMP,
    MAX_CONTENT,
    OPEN_US,
    SEGMENT,
    START,
    TOGGLE,
    TRANSFER,
)
from protocol.generate import c_can, c_messages
from protocol.generate.template import fill
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue
from protocol.schema.message import MAKERS_TYPES
from protocol.uart.crc import crc_table
from protocol.uart.framing import (
    FLAG_AUTHENTICATED,
    MAX_DECODED,
    MAX_ENCODED,
    MAX_NODE,
    MAX_PAYLOAD,
    MIN_DECODED,
)
from protocol.uart.framing import HEADER as FRAME_HEADER

HEADER = "sweepctl_protocol.h"
SOURCE = "sweepctl_protocol.c"
DELIMITERS = 2
"""Number of zero bytes around a frame, as delimiters."""
_PPM = 1_000_000


def render(catalogue: Catalogue = CATALOGUE) -> dict[str, str]:
    """Return header and source for a catalogue, by file name."""
    return {HEADER: _header(catalogue), SOURCE: _source(catalogue)}


def _header(catalogue: Catalogue) -> str:
    return fill(
        HEADER,
        version=PROTOCOL_VERSION,
        hash=f"{catalogue.hash:08X}",
        messages=len(catalogue.specs),
        max_node=MAX_NODE,
        makers_first=f"0x{MAKERS_TYPES[0]:02X}",
        makers_last=f"0x{MAKERS_TYPES[-1]:02X}",
        flag_authenticated=FLAG_AUTHENTICATED,
        header_size=FRAME_HEADER.size,
        min_decoded=MIN_DECODED,
        max_decoded=MAX_DECODED,
        max_payload=MAX_PAYLOAD,
        max_frame=MAX_ENCODED + DELIMITERS,
        max_content=MAX_CONTENT,
        switches=c_messages.switches(catalogue),
        enums=c_messages.enums(catalogue),
        latch_rule=c_messages.latch_rule(catalogue),
        declarations="\n".join(c_messages.declaration(spec) for spec in catalogue),
        streams=c_messages.streams(catalogue),
        to_all=c_messages.to_all(catalogue),
        needs_tag=c_messages.needs_tag(catalogue),
        may_have_tag=c_messages.may_have_tag(catalogue),
        auth_type=CAN_AUTH_TYPE,
        trailer=TRAILER.size,
        can_trailer=CAN_TRAILER.size,
        together_us=TOGETHER_US,
        slow_parts=max(1, len(c_can.slow_parts(catalogue))),
        host_parts=c_can.host_parts(catalogue),
    )


def _source(catalogue: Catalogue) -> str:
    slow = c_can.slow_parts(catalogue)
    return fill(
        SOURCE,
        version=PROTOCOL_VERSION,
        hash=f"{catalogue.hash:08X}",
        messages=len(catalogue.specs),
        crc_table=_table(crc_table(8)),
        crc_nibbles=_table(crc_table(4)),
        definitions="\n".join(c_messages.definition(spec) for spec in catalogue),
        message_rows=c_messages.table_rows(catalogue),
        chain_rows=c_messages.chain_rows(catalogue),
        size_rows=c_messages.size_rows(catalogue),
        bootstrap_cases=c_messages.bootstrap_cases(catalogue),
        enum_members=c_messages.enum_members(catalogue),
        enum_rows=c_messages.enum_rows(catalogue),
        start=f"{START:02X}",
        end=f"{END:02X}",
        toggle=f"{TOGGLE:02X}",
        transfer=f"{TRANSFER:02X}",
        segment=SEGMENT,
        flag_whole_stamp=FLAG_WHOLE_STAMP,
        spans=c_can.spans(catalogue),
        slow_us=", ".join(f"{us}u" for us in slow.values()) or "0u",
        stamp_shift=STAMP_SHIFT,
        duplicate_us=DUPLICATE_US,
        open_us=OPEN_US,
        oldest_us=OLDEST_US,
        lead_us=LEAD_US,
        step_us=STEP_US,
        drift=_PPM // DRIFT_PPM,
    )


def _table(values: list[int]) -> str:
    rows = [values[i : i + 6] for i in range(0, len(values), 6)]
    return "".join("    " + " ".join(f"0x{v:08X}u," for v in row) + "\n" for row in rows)
