"""A Wireshark dissector in one Lua file.

The dissector decodes captures of the serial link and of CAN. For the serial link it has two link
types: DLT_USER0 has one frame per packet, DLT_USER1 has the bytes as they were read. For CAN it
accepts each link type of Wireshark's own CAN dissector, including SocketCAN (227). This module
writes the catalogue as Lua tables; ``templates/sweepctl.lua`` has the code that uses the tables.
The dissector runs with Lua 5.1 to 5.4, the versions in Wireshark since 3.0. So bit operations use
the bundled ``bit`` library, and integer division is not used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.authentication import CAN_AUTH_TYPE, CAN_TRAILER, TRAILER
from protocol.can.frames import is_native, parts_of
from protocol.can.link import DUPLICATE_US
from protocol.can.transfers import MAX_CONTENT, OPEN_US, SEGMENT
from protocol.generate.template import fill
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
    """Return the dissector's text by its file name."""
    enums = [spec for spec in catalogue.enums.values() if spec.unit == "enum"]
    text = fill(
        FILE,
        version=PROTOCOL_VERSION,
        hash=f"{catalogue.hash:08x}",
        min_decoded=MIN_DECODED,
        max_encoded=MAX_ENCODED,
        segment=SEGMENT,
        max_segments=-(-(MAX_CONTENT + CRC.size) // SEGMENT),
        trailer=TRAILER.size,
        can_auth_type=f"0x{CAN_AUTH_TYPE:02X}",
        can_auth_size=CAN_TRAILER.size,
        open_s=OPEN_US / 1e6,
        duplicate_s=DUPLICATE_US / 1e6,
        values="\n".join(f"  {spec.name} = {_value_names(spec.enum)}," for spec in enums),
        catalogue="\n".join(line for spec in catalogue for line in _message(spec)),
        can_frames="\n".join(
            line for spec in catalogue if is_native(spec) for line in _can_frames(spec)
        ),
    )
    return {FILE: text}


def _message(spec: MessageSpec) -> Iterator[str]:
    yield f"  [0x{spec.type_id:02X}] = {{ -- {_one_line(spec.doc).replace('``', '`')}"
    yield f"    name = {_quoted(spec.name)}, direction = {_quoted(spec.direction.value)},"
    yield f"    size = {spec.layout.size}, -- B, without a text at the end"
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
        stamp = ", full_stamp = true" if part.full_stamp else ""
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
    """Return a text as a Lua string, with a backslash before special characters."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
