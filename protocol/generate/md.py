"""Generates PROTOCOL.md, the protocol specification.

The messages come from the catalogue. The programs on both ends define states and timing, so the
caller passes these in. Without states and timing, the document contains only the messages.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.authentication import CAN_AUTH_TYPE, TRAILER
from protocol.can.awaiting_tag import TOGETHER_US
from protocol.can.frames import pack, parts_of
from protocol.generate.md_can import can_tables
from protocol.generate.md_messages import enum_tables, hash_table, message_index, message_section
from protocol.generate.template import fill
from protocol.messages.host import VelocitySetpoint
from protocol.messages.values import StopCause, by_severity, latched_cause
from protocol.retransmission import REMEMBERED, STOP_REPEAT_US
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.message import Direction
from protocol.uart.framing import encode_frame

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

FILE = "PROTOCOL.md"
_CONTENTS = "[contents]"
"""Placeholder of the table of contents until all titles are known."""
_BITS_A_BYTE = 10
_MBAUD = 0.9216


@dataclass(frozen=True, slots=True)
class Machine:
    """A state machine to draw: initial state, and transitions (state, event, next state)."""

    title: str
    text: str
    first: str
    moves: Sequence[tuple[str, str, str]]


@dataclass(frozen=True, slots=True)
class TimingRule:
    """One timing rule: its end of the link, meaning, value and constant."""

    who: str
    what: str
    value: str
    source: str


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One parameter of the device; numbers are in ``unit``."""

    number: int
    name: str
    unit: str
    kind: str
    default: float
    low: float
    high: float
    effect: str
    """Time at which a change takes effect."""
    doc: str


@dataclass(frozen=True, slots=True)
class Behaviour:
    """States, timing and parameters of the programs on both ends."""

    machines: Sequence[Machine]
    parameters: Sequence[ParameterRow]
    rules: Sequence[TimingRule]
    numbers: Mapping[str, str]
    """Values for the section that follows one setpoint, by placeholder name in the template."""


def render(catalogue: Catalogue = CATALOGUE, behaviour: Behaviour | None = None) -> dict[str, str]:
    """Return the document by its file name."""
    text = _wire(catalogue)
    if behaviour is not None:
        text += "\n" + _behaviour(catalogue, behaviour)
    titles = [line[3:] for line in text.splitlines() if line.startswith("## ")]
    contents = "\n".join(f"- [{t}](#{t.lower().replace(' ', '-')})" for t in titles)
    return {FILE: text.replace(_CONTENTS, contents).rstrip() + "\n"}


def _wire(catalogue: Catalogue) -> str:
    messages = [*message_index(catalogue), *(x for s in catalogue for x in message_section(s))]
    return fill(
        FILE,
        version=PROTOCOL_VERSION,
        hash=f"{catalogue.hash:08x}",
        count=len(catalogue.specs),
        contents=_CONTENTS,
        to_all=_listed(s.name for s in catalogue if s.to_all),
        messages="\n".join(messages),
        values="\n".join(enum_tables(catalogue)),
        can_frames="\n".join(can_tables(catalogue)),
        hashes="\n".join(hash_table(catalogue)),
        causes=", ".join(f"`{c.name.lower()}`" for c in by_severity()),
        unnamed=latched_cause(StopCause.NONE, StopCause.NONE).name.lower(),
        stop_repeat_ms=STOP_REPEAT_US // 1000,
        remembered=REMEMBERED,
        guarded=", ".join(f"`{s.name}`" for s in catalogue if s.needs_tag),
        free=", ".join(
            f"`{s.name}`" for s in catalogue if s.direction is Direction.HOST and not s.needs_tag
        ),
        auth_type=f"{CAN_AUTH_TYPE:#04x}",
        together_ms=TOGETHER_US // 1000,
        trailer=TRAILER.size,
    )


def _behaviour(catalogue: Catalogue, behaviour: Behaviour) -> str:
    return "\n".join(
        [
            *_machines(behaviour),
            *_parameters(behaviour),
            fill("PROTOCOL-timing.md", rules="\n".join(_rules(behaviour))),
            *_life(catalogue, behaviour),
        ]
    )


def _listed(names: Iterable[str]) -> str:
    *others, last = (f"`{name}`" for name in names)
    return f"{', '.join(others)} and {last}" if others else last


def _machines(behaviour: Behaviour) -> Iterator[str]:
    yield "## States\n"
    for machine in behaviour.machines:
        yield f"### {machine.title}\n\n{machine.text}\n"
        yield "```mermaid"
        yield from diagram(machine)
        yield "```\n"


def diagram(machine: Machine) -> Iterator[str]:
    """Draw a Mermaid state diagram; transitions between the same two states share one arrow."""
    yield "stateDiagram-v2"
    yield f"    [*] --> {machine.first}"
    arrows: dict[tuple[str, str], list[str]] = {}
    for start, what, end in machine.moves:
        arrows.setdefault((start, end), []).append(what)
    for (start, end), labels in arrows.items():
        yield f"    {start} --> {end}: {', '.join(labels)}"


def _parameters(behaviour: Behaviour) -> Iterator[str]:
    yield "## Parameters\n"
    yield (
        "The parameters of the Python device and of the reference firmware, with the defaults of "
        "the paper's robot. Another device may have others: the host reads names, units and limits "
        "from `parameter_value`.\n"
    )
    yield "| number | name | unit | kind | default | range | a change takes effect | meaning |"
    yield "|---|---|---|---|---|---|---|---|"
    for row in behaviour.parameters:
        yield (
            f"| {row.number} | `{row.name}` | {row.unit} | {row.kind} | {row.default:g} "
            f"| {row.low:g} … {row.high:g} | {row.effect} | {row.doc} |"
        )
    yield ""


def _rules(behaviour: Behaviour) -> Iterator[str]:
    yield "| side | rule | value | constant |"
    yield "|---|---|---|---|"
    for rule in behaviour.rules:
        yield f"| {rule.who} | {rule.what} | {rule.value} | `{rule.source}` |"
    yield ""


def _life(catalogue: Catalogue, behaviour: Behaviour) -> Iterator[str]:
    if VelocitySetpoint not in catalogue.by_class or "encoders" not in catalogue.by_name:
        return
    setpoint = VelocitySetpoint(v=2000, yaw_rate=-500, time_to_live=200, counter=7)
    spec = catalogue.spec(VelocitySetpoint)
    type_id, payload = Codec(catalogue).encode(setpoint)
    stamp_us, (part, *_) = 0x0012_D687, parts_of(spec, len(spec.fields))
    wire = b"\0" + encode_frame(1, type_id, 42, stamp_us, payload)
    yield fill(
        "PROTOCOL-life.md",
        payload=payload.hex(" "),
        wire=wire.hex(" "),
        wire_bytes=len(wire),
        wire_us=round(len(wire) * _BITS_A_BYTE / _MBAUD),
        encoders_ms=f"{1000 / catalogue.by_name['encoders'].default_hz:g}",
        can_id=f"{type_id << 4 | 1:03x}",
        can=pack(part, payload, stamp_us).hex(" "),
        **behaviour.numbers,
    )
