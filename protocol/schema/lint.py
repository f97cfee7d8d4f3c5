"""Rules for the declarations in the catalogue; tests and generators check these rules."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from protocol.schema.fields import PLAIN_UNITS, SI_UNITS, SiValue, SiValueOrNone
from protocol.schema.message import MAKERS_TYPES, MAX_TYPE, Direction, RateClass

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec

STREAM_PAYLOAD_MAX = 25
"""Maximum payload of a stream, bytes. With header and CRC, the codeword has 37 B. Up to this length
the CRC detects every error of up to 5 bits."""
CAN_PAYLOAD_MAX = 6
"""Maximum payload of one native CAN frame, bytes, without its 16-bit stamp."""
MAX_PAYLOAD = 241
"""Maximum payload, bytes: a decoded frame of 253 B minus header and CRC. It repeats
``framing.MAX_PAYLOAD``, because ``framing`` imports the catalogue, which imports this module."""

RESERVED_FIELDS = frozenset(
    {"bound_ns", "frame_flags", "log_time", "node", "offset", "publish_time", "seq", "sequence"}
    | {"t_us", "type_id"}
)
"""Columns that a decoded capture, a log or an exported table adds to the fields of a message."""
RESERVED_MESSAGES = frozenset(
    # of the generated C code
    {"can_frame", "can_joined", "can_message", "can_receiver", "can_sender", "can_transfer"}
    | {"direction", "event", "frame", "parser", "sender"}
    # other schemas of a log
    | {"clock_sync", "command", "plan_state", "pose_estimate", "raw_bytes", "raw_can"}
)
"""Names that a message may not have, because generated code or a log already uses them."""


def findings(specs: Iterable[MessageSpec]) -> list[str]:
    """Return the errors in the declarations, one line per error."""
    specs = list(specs)
    found: list[str] = []
    for what, counts in (
        ("type", Counter(hex(s.type_id) for s in specs)),
        ("name", Counter(s.name for s in specs)),
    ):
        found += [f"{what} {key} is declared {n} times" for key, n in counts.items() if n > 1]
    enums = {(f.enum.__name__, f.enum) for s in specs for f in s.fields if f.enum is not None}
    for name, count in Counter(name for name, _ in enums).items():
        if count > 1:
            found.append(f"enumeration {name} is declared {count} times")
    own = {s.type_id for s in specs}
    parts = Counter(
        p.can_type for s in {s.type_id: s for s in specs}.values() for p in s.can_parts[1:]
    )
    found += [f"CAN part type {t:#x} is declared {n} times" for t, n in parts.items() if n > 1]
    found += [f"CAN part type {t:#x} is a message's too" for t in parts if t in own]
    found += [f"CAN part type {t:#x} is out of range" for t in parts if not 0 <= t <= MAX_TYPE]
    for spec in specs:
        found += [f"{spec.name}: {line}" for line in _message(spec)]
        for field in spec.fields:
            found += [f"{spec.name}.{field.name}: {line}" for line in _field(spec, field)]
    return found


def _message(spec: MessageSpec) -> Iterator[str]:
    if spec.cls.__module__.startswith("protocol."):
        for claimed in sorted({spec.type_id, *(p.can_type for p in spec.can_parts)}):
            if claimed in MAKERS_TYPES:
                yield f"type {claimed:#x} is one of the makers' own messages"
    if not 0 <= spec.type_id <= MAX_TYPE:
        yield f"type {spec.type_id:#x} is out of range"
    if not spec.doc:
        yield "has no description"
    yield from _names(spec)
    if spec.to_all and spec.direction is Direction.DEVICE:
        yield "a device's message has the node of its device, never all"
    if spec.layout.size > MAX_PAYLOAD:
        yield f"payload of {spec.layout.size} B exceeds {MAX_PAYLOAD} B"
    if spec.rate is RateClass.STREAM:
        yield from _stream(spec)
    elif spec.rate is RateClass.COMMAND and [f.name for f in spec.fields[:1]] != ["command_id"]:
        yield "a command starts with its command_id"


def _names(spec: MessageSpec) -> Iterator[str]:
    if spec.name in RESERVED_MESSAGES:
        yield "the name is reserved"
    names = [field.name for field in spec.fields]
    names += [f"{f.name}{f.si_suffix}" for f in spec.fields if f.si_suffix is not None]
    for name, count in Counter(names).items():
        if name in RESERVED_FIELDS:
            yield f"the field name {name} is reserved"
        if count > 1:
            yield f"two values have the name {name}"


def _stream(spec: MessageSpec) -> Iterator[str]:
    if spec.text_field is not None:
        yield "a stream may not carry text"
    if spec.layout.size > STREAM_PAYLOAD_MAX:
        yield f"stream of {spec.layout.size} B exceeds {STREAM_PAYLOAD_MAX} B"
    if spec.default_hz <= 0:
        yield "a stream needs a default rate"
    yield from _can_parts(spec)


def _can_parts(spec: MessageSpec) -> Iterator[str]:
    for part in sorted({f.can_part for f in spec.fields}):
        size = sum(f.wire.size for f in spec.fields if f.can_part == part)
        if size > CAN_PAYLOAD_MAX:
            yield f"CAN part {part} of {size} B exceeds {CAN_PAYLOAD_MAX} B"
        if part >= len(spec.can_parts):
            yield f"CAN part {part} has no type of its own"
    if spec.direction is Direction.HOST and any(p.slow_us for p in spec.can_parts):
        yield "a host's message has a slow CAN part: a device needs all parts at once"
    if MAX_TYPE >= spec.type_id >= 0 and spec.can_parts[0].can_type != spec.type_id:
        yield f"CAN part 0 has type {spec.can_parts[0].can_type:#x}, not the message's own"
    own = spec.can_parts[0].can_type
    if [p.can_type - own for p in spec.can_parts] != list(range(len(spec.can_parts))):
        yield "the types of CAN parts must be consecutive"
    if len(spec.can_parts) > 1:
        yield from (f"CAN part {i} has no name" for i, p in enumerate(spec.can_parts) if not p.name)


def _field(spec: MessageSpec, field: Field) -> Iterator[str]:
    if not field.doc:
        yield "has no description"
    if field.unit not in SI_UNITS and field.unit not in PLAIN_UNITS:
        yield f"unit {field.unit!r} is not known"
    if field.wire.is_integer:
        if not field.wire.low <= field.low <= field.high <= field.wire.high:
            yield f"range {field.low}..{field.high} does not fit {field.wire.name}"
        if field.none is not None and field.low <= field.none <= field.high:
            yield f"sentinel {field.none} lies inside the range"
    if field.unit == "enum" and field.enum is None:
        yield "an enum needs its names"
    if field.unit in PLAIN_UNITS and field.is_scaled:
        yield f"a scaled value needs a physical unit, not {field.unit!r}"
    if field.si_suffix is not None:
        # A field without a sentinel may still be absent, because an older peer does not declare it.
        wanted = (SiValue, SiValueOrNone) if field.none is None else SiValueOrNone
        if not isinstance(vars(spec.cls).get(field.name + field.si_suffix), wanted):
            yield f"lacks its SI property {field.name}{field.si_suffix}"
