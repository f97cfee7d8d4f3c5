"""Protobuf declarations of what a run's log holds on ``/device/<message>``.

Field i of a message has number 4 + 2i with its raw wire value, and 5 + 2i with its value in
SI units where it has a unit. Fields of the wire are only ever appended, so a number keeps its
meaning. Syntax ``proto2``: every field may be absent, and says so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec

FILE = "sweepctl.proto"
PACKAGE = "sweepctl"
FIRST_FIELD = 4
_HEAD = """\
// What a sweeper sends and is sent, as a run's log keeps it: one message for every message of
// the wire. Made by `sweepctl generate proto`; change the catalogue instead.
//
// Protocol version {version}, catalogue {hash:08x}.
//
// A field without a suffix is the raw integer of the wire; one with a unit for suffix is its
// value in SI units, absent where the raw value says that nothing is there. A field that the
// sender does not know is absent.

syntax = "proto2";

package {package};
"""


def render(catalogue: Catalogue = CATALOGUE) -> dict[str, str]:
    """One file with every message."""
    head = _HEAD.format(version=PROTOCOL_VERSION, hash=catalogue.hash, package=PACKAGE)
    return {FILE: "\n".join([head, *("\n".join(_message(spec)) + "\n" for spec in catalogue)])}


def _message(spec: MessageSpec) -> Iterator[str]:
    yield f"// {spec.doc}"
    if spec.direction is Direction.DEVICE:
        yield f"// From the device, type 0x{spec.type_id:02x}, topic /device/{spec.name}."
    else:
        yield f"// From the host, type 0x{spec.type_id:02x}."
    yield f"message {spec.cls.__name__} {{"
    yield "  // Low 32 bits of the sender's clock when the content was sampled, microseconds."
    yield "  optional fixed32 t_us = 1;"
    yield "  // The device's number."
    yield "  optional fixed32 node = 2;"
    yield "  // Bound of the error of the time that t_us was mapped to, nanoseconds."
    yield "  optional fixed64 bound_ns = 3;"
    for index, field in enumerate(spec.fields):
        yield from _comment(field)
        yield f"  optional {_kind(field)} {field.name} = {FIRST_FIELD + 2 * index};"
    for index, field in enumerate(spec.fields):
        if field.si_suffix is not None:
            number = FIRST_FIELD + 2 * index + 1
            yield f"  optional double {field.name}{field.si_suffix} = {number};"
    yield "}"


def _comment(field: Field) -> Iterator[str]:
    unit = field.unit
    if field.is_scaled:
        unit = f"{field.scale} {field.unit} a step"
        if field.offset:
            unit += f", {float(field.offset):g} {field.unit} at 0"
    yield f"  // {field.doc[:1].upper()}{field.doc[1:]} ({unit})."
    if field.enum is not None:
        names = ", ".join(f"{int(v)} {v.name.lower()}" for v in field.enum)
        yield f"  // {names}."


def _kind(field: Field) -> str:
    if field.wire.is_text:
        return "string"
    if not field.wire.is_integer:
        return "bytes"
    return "sfixed32" if field.wire.low < 0 else "fixed32"
