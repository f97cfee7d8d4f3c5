"""CAN database (DBC) with every periodic frame of one device, for cantools, SavvyCAN and others.

This file alone is sufficient to decode a periodic frame. All other messages are split into
segments. A DBC file cannot describe segments, so these messages are omitted. The database also
contains the tag frame that signs a message (:mod:`protocol.authentication`). The tag frame shows
whether a setpoint was signed, and with which counter.
"""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

from protocol.authentication import CAN_AUTH_TYPE, CAN_TRAILER
from protocol.can.frames import STAMP_SHIFT, T16, T32, is_native, parts_of
from protocol.errors import FieldRangeError
from protocol.imu import NOMINAL, ImuScale
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue
from protocol.schema.fields import SI_UNITS
from protocol.schema.message import Direction
from protocol.uart.framing import MAX_NODE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.can.frames import Part
    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec

HOST = "host"
DEVICE = "device"
STAMP = "t16"
FULL_STAMP = "t_us"
TAG = "auth_tag"
_PLAIN_UNITS = {"percent": "%", "us": "us"}
"""Units of unscaled fields that the database contains. Other units of unscaled fields only describe
the encoding."""
_PLAIN_SIGNS = str.maketrans({'"': "'", "±": "+-", "°": "deg", "×": "x", "–": "-", "’": "'"})
"""Replacements of non-ASCII characters and of the double quote, which a DBC text must not
contain."""


class Signal(NamedTuple):
    """One value within a frame: ``physical = raw * scale + offset``."""

    name: str
    start_bit: int
    bits: int
    signed: bool
    scale: float
    offset: float
    low: float
    high: float
    unit: str
    doc: str
    values: dict[int, str]


class DbcFrame(NamedTuple):
    """One frame."""

    can_id: int
    name: str
    length: int
    sender: str
    receiver: str
    cycle_ms: int
    """Period, ms; 0: the frame is sent together with another frame."""
    doc: str
    signals: tuple[Signal, ...]


def render(
    catalogue: Catalogue = CATALOGUE, node: int = 1, imu: ImuScale = NOMINAL
) -> dict[str, str]:
    """Return the database of device ``node`` (1-15) by file name; ``imu`` is the scale of its IMU.

    Raises:
        FieldRangeError: there is no such node.

    """
    if not 1 <= node <= MAX_NODE:
        raise FieldRangeError("frame", "node", node)
    periodic = chain.from_iterable(
        frames_of(imu.declared(spec), node) for spec in catalogue if is_native(spec)
    )
    frames = sorted([*periodic, tag_frame(node)])
    return {f"sweepctl-node{node}.dbc": "\n".join(_lines(catalogue, node, frames)) + "\n"}


def frames_of(spec: MessageSpec, node: int) -> Iterator[DbcFrame]:
    """Yield the frames of one periodic message."""
    parts = parts_of(spec, len(spec.fields))
    period_ms = round(1000 / spec.default_hz)
    ends = (DEVICE, HOST) if spec.direction is Direction.DEVICE else (HOST, DEVICE)
    for part in parts:
        name, doc = spec.name, spec.doc
        if len(parts) > 1:
            name = f"{spec.name}_{spec.can_parts[part.number].name}"
            kept = (
                "; holds until the next one"
                if part.slow_us
                else "; parts with equal stamps belong together"
            )
            doc = f"{doc} Part {part.number + 1} of {len(parts)}{kept}."
        signals = tuple(_signals(spec, part))
        length = sum(s.bits for s in signals) // 8
        cycle_ms = max(period_ms, part.slow_us // 1000)
        yield DbcFrame(part.can_type << 4 | node, name, length, *ends, cycle_ms, doc, signals)


def tag_frame(node: int) -> DbcFrame:
    """Return the tag frame, which follows a signed message of the host."""
    counter_bits = 16
    tag_bits = 8 * CAN_TRAILER.size - counter_bits
    signals = (
        _plain("counter", 0, counter_bits, 1.0, "", "low 16 bits of the session's counter"),
        _plain(
            "tag", counter_bits, tag_bits, 1.0, "", "HMAC-SHA-256 with the device's key, truncated"
        ),
    )
    doc = "Signature of the preceding message; sent if the device has a key."
    can_id = CAN_AUTH_TYPE << 4 | node
    return DbcFrame(can_id, TAG, CAN_TRAILER.size, HOST, DEVICE, 0, doc, signals)


def _signals(spec: MessageSpec, part: Part) -> Iterator[Signal]:
    doc = "sender's clock when the content was sampled"
    if part.full_stamp:
        bit = 8 * T32.size
        yield _plain(FULL_STAMP, 0, bit, 1.0, "us", doc)
    else:
        bit, step_us = 8 * T16.size, 1 << STAMP_SHIFT
        doc = f"{doc}, low 16 bits of {step_us} us steps"
        yield _plain(STAMP, 0, bit, step_us / 1e6, "s", doc)
    for field in spec.fields:
        if field.can_part == part.number:
            yield _signal(field, bit)
            bit += 8 * field.wire.size


def _plain(  # noqa: PLR0913, PLR0917 - a row of the table
    name: str, bit: int, bits: int, scale: float, unit: str, doc: str
) -> Signal:
    top = ((1 << bits) - 1) * scale
    return Signal(name, bit, bits, False, scale, 0.0, 0.0, top, unit, doc, {})  # noqa: FBT003 - a row


def _signal(field: Field, bit: int) -> Signal:
    values: dict[int, str] = {}
    doc = field.doc
    if field.enum is not None and field.unit == "enum":
        values = {int(v): v.name.lower() for v in field.enum}
    elif field.enum is not None:
        named = (f"{int(b).bit_length() - 1} {(b.name or '').lower()}" for b in field.enum)
        doc = f"{doc}; bits: {', '.join(named)}"
    if field.none is not None:
        values[field.none] = "none"
    return Signal(
        field.name,
        bit,
        8 * field.wire.size,
        field.wire.low < 0,
        float(field.scale),
        float(field.offset),
        float(field.low * field.scale + field.offset),
        float(field.high * field.scale + field.offset),
        field.unit if field.unit in SI_UNITS else _PLAIN_UNITS.get(field.unit, ""),
        doc,
        values,
    )


def _lines(catalogue: Catalogue, node: int, frames: list[DbcFrame]) -> Iterator[str]:
    about = (
        f"Periodic frames of device {node}, and its authentication tags. Protocol version "
        f"{PROTOCOL_VERSION}, catalogue 0x{catalogue.hash:08x}. Generated by "
        "`sweepctl generate dbc`. All other messages are segmented and not described here."
    )
    yield f'VERSION "protocol {PROTOCOL_VERSION} catalogue {catalogue.hash:08x} node {node}"'
    yield ""
    yield "NS_ :"
    yield ""
    yield "BS_:"
    yield ""
    yield f"BU_: {HOST} {DEVICE}"
    for frame in frames:
        yield ""
        yield f"BO_ {frame.can_id} {frame.name}: {frame.length} {frame.sender}"
        for signal in frame.signals:
            yield f" SG_ {_signal_line(signal)} {frame.receiver}"
    yield ""
    yield f"CM_ {_quoted(about)};"
    yield f'CM_ BU_ {HOST} "Host computer; one per bus.";'
    yield f'CM_ BU_ {DEVICE} "Sweeping robot, node {node}.";'
    for frame in frames:
        yield f"CM_ BO_ {frame.can_id} {_quoted(frame.doc)};"
        for signal in frame.signals:
            yield f"CM_ SG_ {frame.can_id} {signal.name} {_quoted(signal.doc)};"
    yield 'BA_DEF_ "BusType" STRING ;'
    yield 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;'
    yield 'BA_DEF_ BO_ "GenMsgSendType" ENUM "Cyclic","NoMsgSendType";'
    yield 'BA_DEF_DEF_ "BusType" "CAN";'
    yield 'BA_DEF_DEF_ "GenMsgCycleTime" 0;'
    yield 'BA_DEF_DEF_ "GenMsgSendType" "NoMsgSendType";'
    yield 'BA_ "BusType" "CAN";'
    for frame in frames:
        yield f'BA_ "GenMsgCycleTime" BO_ {frame.can_id} {frame.cycle_ms};'
        yield f'BA_ "GenMsgSendType" BO_ {frame.can_id} {0 if frame.cycle_ms else 1};'
    for frame in frames:
        for signal in frame.signals:
            if signal.values:
                table = " ".join(f"{k} {_quoted(v)}" for k, v in sorted(signal.values.items()))
                yield f"VAL_ {frame.can_id} {signal.name} {table} ;"


def _signal_line(signal: Signal) -> str:
    sign = "-" if signal.signed else "+"
    return (
        f"{signal.name} : {signal.start_bit}|{signal.bits}@1{sign} "
        f"({_number(signal.scale)},{_number(signal.offset)}) "
        f"[{_number(signal.low)}|{_number(signal.high)}] {_quoted(signal.unit)}"
    )


def _number(value: float) -> str:
    """Return the shortest text that reads back as the same double."""
    return str(int(value)) if value.is_integer() else repr(value)


def _quoted(text: str) -> str:
    """Return a line in double quotes, in ASCII because programs expect different encodings."""
    plain = " ".join(text.split()).translate(_PLAIN_SIGNS).encode("ascii", "replace").decode()
    return f'"{plain}"'
