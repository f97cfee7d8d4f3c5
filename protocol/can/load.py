"""Load of a CAN bus by all messages at their default rates."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from protocol.can.frames import T16, T32, is_native, nominal_bits, parts_of
from protocol.can.frames import worst_bits as worst_frame_bits
from protocol.can.transfers import content, segments
from protocol.messages.device import LogText, TimeReply
from protocol.messages.host import TimeRequest
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue

if TYPE_CHECKING:
    from protocol.can.frames import Part
    from protocol.schema.message import Message, MessageSpec

BITRATE = 500_000
PING_HZ = 10.0
"""Maximum rate of time requests and replies, Hz, in a session's first seconds."""
LOG_HZ, LOG_BYTES = 10.0, 40
"""Maximum rate of log lines, Hz, and their usual length, bytes."""
_VERSION = PROTOCOL_VERSION << 4


class Load(NamedTuple):
    """Share of a bus that one message uses."""

    name: str
    frames_per_s: float
    bits_per_s: float
    """Bit rate without stuff bits."""
    worst_bits_per_s: float
    """Bit rate with the maximum number of stuff bits."""


def loads(catalogue: Catalogue = CATALOGUE) -> list[Load]:
    """Return the load of each stream at its default rate, of time requests and of a busy log.

    Velocity and duty setpoints are both counted, although a host sends only one kind at a time.
    """
    found = periodic_loads(catalogue)
    rare: tuple[tuple[Message, float], ...] = (
        (TimeRequest(0), PING_HZ),
        (TimeReply(0, 0), PING_HZ),
        (LogText(0, "x" * LOG_BYTES), LOG_HZ),
    )
    for message, rate_hz in rare:
        spec = catalogue.spec(type(message))
        payload = spec.layout.pack(*[v for v in message if isinstance(v, int)])
        if spec.text_field is not None:
            payload += b"x" * LOG_BYTES
        found.append(
            _load(
                spec.name, [(rate_hz, len(s)) for s in segments(content(_VERSION, 0, payload), 0)]
            )
        )
    return found


def periodic_loads(catalogue: Catalogue = CATALOGUE) -> list[Load]:
    """Return the load of each stream at its default rate."""
    return [
        _load(spec.name, [(part_hz(spec, part), part_size(part)) for part in all_parts(spec)])
        for spec in catalogue
        if is_native(spec)
    ]


def all_parts(spec: MessageSpec) -> tuple[Part, ...]:
    """Return the frames that carry all fields of a periodic message."""
    return parts_of(spec, len(spec.fields))


def part_hz(spec: MessageSpec, part: Part) -> float:
    """Return the default rate of a part's frames, Hz."""
    return 1e6 / part.slow_us if part.slow_us else spec.default_hz


def part_size(part: Part) -> int:
    """Return the payload of a part's frame with its stamp, bytes."""
    return (T32 if part.full_stamp else T16).size + sum(end - start for start, end in part.spans)


def _load(name: str, frames: list[tuple[float, int]]) -> Load:
    return Load(
        name,
        sum(rate_hz for rate_hz, _ in frames),
        sum(rate_hz * nominal_bits(length) for rate_hz, length in frames),
        sum(rate_hz * worst_frame_bits(length) for rate_hz, length in frames),
    )
