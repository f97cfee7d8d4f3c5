"""A Wireshark dissector in one Lua file.

It reads the serial line (DLT_USER0: one frame a packet; DLT_USER1: bytes as they were read) and
CAN (any link type that Wireshark's own CAN dissector takes, SocketCAN's 227 among them). The
catalogue becomes tables; the code that walks them is text of :mod:`~protocol.generate.lua_fields`,
:mod:`~protocol.generate.lua_uart` and :mod:`~protocol.generate.lua_can`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.authentication import CAN_AUTH_TYPE, CAN_TRAILER, TRAILER
from protocol.can.frames import CAN_FULL_STAMP, is_native, parts_of
from protocol.can.link import DOUBLE_US
from protocol.can.transfers import MAX_CONTENT, OPEN_US, SEGMENT
from protocol.generate.lua_can import CAN, REGISTRATION
from protocol.generate.lua_fields import FIELDS
from protocol.generate.lua_uart import UART
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue
from protocol.uart.framing import CRC, MAX_ENCODED, MIN_DECODED

if TYPE_CHECKING:
    from collections.abc import Iterator
    from enum import IntEnum

    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec

FILE = "sweepctl.lua"
_HEX_UNITS = frozenset({"bits", "hash"})
_KINDS = {"text": "text", "uid96": "bytes"}


def render(catalogue: Catalogue = CATALOGUE) -> dict[str, str]:
    """The dissector's text by its file name."""
    fields = [f for s in catalogue for f in s.fields]
    values = {f.enum.__name__: f.enum for f in fields if f.enum and f.unit == "enum"}
    lines = [
        "-- Wireshark dissector of the sweeper's wire: serial line and CAN.",
        "-- Made by `sweepctl generate lua`; changes belong into the catalogue.",
        f"-- Protocol version {PROTOCOL_VERSION}, catalogue 0x{catalogue.hash:08x}.",
        "-- SPDX-License-Identifier: MIT",
        "--",
        '-- It belongs into the plugins folder ("About", "Folders"); or by hand:',
        "-- tshark -X lua_script:sweepctl.lua",
        "",
        f"local VERSION = {PROTOCOL_VERSION}",
        f"local MIN_DECODED, MAX_ENCODED = {MIN_DECODED}, {MAX_ENCODED} -- B, of a serial frame",
        f"local SEGMENT, MAX_SEGMENTS = {SEGMENT}, {-(-(MAX_CONTENT + CRC.size) // SEGMENT)}",
        f"local AUTH_TRAILER = {TRAILER.size} -- B: counter and tag of a signed serial frame",
        f"local CAN_AUTH_TYPE, CAN_AUTH_SIZE = 0x{CAN_AUTH_TYPE:02X}, {CAN_TRAILER.size}",
        f"local OPEN_S, DOUBLE_S = {OPEN_US / 1e6}, {DOUBLE_US / 1e6}",
        "",
        "-- ---- the catalogue " + "-" * 70,
        "",
        "local VALUES = {",
        *(f"  {name} = {_value_names(enum)}," for name, enum in sorted(values.items())),
        "}",
        "",
        "local MESSAGES = {",
        *(line for spec in catalogue for line in _message(spec)),
        "}",
        "",
        "-- By the type in the identifier: which fields of which message a frame carries.",
        "local CAN_FRAMES = {",
        *(line for spec in catalogue if is_native(spec) for line in _can_frames(spec)),
        "}",
        "local CAN_TYPES = {}",
        "for type_id in pairs(MESSAGES) do",
        "  CAN_TYPES[type_id] = true",
        "end",
        "CAN_TYPES[CAN_AUTH_TYPE] = true",
        "for can_type, frame in pairs(CAN_FRAMES) do",
        "  CAN_TYPES[can_type] = true",
        "  for i, index in ipairs(frame.fields) do",
        "    frame.fields[i] = MESSAGES[frame.message].fields[index]",
        "  end",
        "end",
    ]
    text = "\n".join(lines) + "\n" + FIELDS + UART + CAN + REGISTRATION
    return {FILE: text}


def _message(spec: MessageSpec) -> Iterator[str]:
    yield f"  [0x{spec.type_id:02X}] = {{ -- {_one_line(spec.doc)}"
    yield f"    name = {_quoted(spec.name)}, direction = {_quoted(spec.direction.value)},"
    yield f"    size = {spec.layout.size}, -- B, a text behind it left out"
    yield "    fields = {"
    for field in spec.fields:
        yield f"      {{ {', '.join(_properties(field))} }},"
    yield "    },"
    yield "  },"


def _properties(field: Field) -> Iterator[str]:
    wire = field.wire
    kind = _KINDS.get(wire.name, "signed" if wire.low < 0 else "unsigned")
    yield f"name = {_quoted(field.name)}, kind = {_quoted(kind)}, size = {wire.size}"
    yield f"doc = {_quoted(field.doc)}"
    if not wire.is_integer:
        return
    yield f"low = {field.low}, high = {field.high}"
    if field.none is not None:
        yield f"none = {field.none}"
    if field.si_suffix is not None:
        yield f"unit = {_quoted(field.unit)}"
        yield f"scale = {float(field.scale)!r}, offset = {float(field.offset)!r}"
    if field.unit in _HEX_UNITS:
        yield "hex = true"
    if field.enum is None:
        return
    if field.unit == "bits":
        bits = ", ".join(f"{{ {_flag(b.value)}, {_quoted(_lower(b.name))} }}" for b in field.enum)
        yield f"bits = {{ {bits} }}"
    else:
        yield f"values = VALUES.{field.enum.__name__}"


def _can_frames(spec: MessageSpec) -> Iterator[str]:
    parts = parts_of(spec, len(spec.fields))
    for part in parts:
        mine = [(i, f) for i, f in enumerate(spec.fields, 1) if f.can_part == part.number]
        indices = ", ".join(str(i) for i, _ in mine)
        size = sum(f.wire.size for _, f in mine)
        stamp = ", full_stamp = true" if part.can_type in CAN_FULL_STAMP else ""
        name = spec.name if len(parts) == 1 else f"{spec.name} part {part.number}"
        yield (
            f"  [0x{part.can_type:02X}] = {{ name = {_quoted(name)}, message = "
            f"0x{spec.type_id:02X}, part = {part.number}, parts = {len(parts)},"
        )
        yield f"    fields = {{ {indices} }}, size = {size}{stamp} }},"


def _value_names(enum: type[IntEnum]) -> str:
    return "{ " + ", ".join(f"[{v.value}] = {_quoted(_lower(v.name))}" for v in enum) + " }"


def _flag(value: int) -> str:
    return f"0x{value:x}"


def _lower(name: str | None) -> str:
    return (name or "").lower()


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _quoted(text: str) -> str:
    """Lua takes a backslash before a byte that would end the string, as Python shows it."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
