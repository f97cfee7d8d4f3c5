"""Listening on a line without a word: what passes, how often, and what is broken.

Sans-I/O and without a session: bytes and host time go in, what they mean comes out. There is
no way in here by which anything could be sent.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from protocol.link import LinkBase, Medium, Received, Rejected
from protocol.messages import Hello
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.message import Direction
from protocol.uart.link import Link
from protocol.values import flag_labels, label

if TYPE_CHECKING:
    from collections.abc import Collection
    from enum import IntFlag

    from protocol.clock import HostNs
    from protocol.schema.fields import Field
    from protocol.schema.message import Message, MessageSpec
    from protocol.uart.framing import DamagedFrame, Frame

RATE_WINDOW_NS = 2_000_000_000
"""Rates are of the last two seconds: two of the rarest stream."""
_SECOND = 1_000_000_000


class Seen(NamedTuple):
    """One thing that passed on the line."""

    host_ns: int
    kind: str
    """``message``, ``rejected`` or ``damaged``."""
    name: str
    """Of the message, or what is wrong."""
    node: int
    direction: str
    """``device`` or ``host``: who sent it; empty where that cannot be known."""
    t_us: int
    """Sender's stamp."""
    fields: dict[str, Any]
    """Physical values with the unit in the name, labels for enumerations and bits."""
    text: str
    """The same for people."""
    raw: bytes
    """Payload, or the bytes that are no frame."""


@dataclass(slots=True)
class TypeCount:
    """What came of one type."""

    name: str
    count: int = 0
    newest: Seen | None = None
    _times: deque[int] = field(default_factory=deque)

    def add(self, seen: Seen) -> None:
        """Count one more."""
        self.count += 1
        self.newest = seen
        self._times.append(seen.host_ns)

    def rate_hz(self, now_ns: int, since_ns: int) -> float:
        """Messages a second over the window, or over the time since the start if shorter."""
        oldest = now_ns - RATE_WINDOW_NS
        times = self._times
        while times and times[0] < oldest:
            times.popleft()
        window_s = min(RATE_WINDOW_NS, max(now_ns - since_ns, 1)) / _SECOND
        return len(times) / window_s


class Monitor:
    """Understands both directions of a line; remembers counts, not messages."""

    def __init__(
        self,
        link: type[LinkBase] = Link,
        *,
        types: Collection[str] = (),
        node: int | None = None,
        catalogue: Catalogue = CATALOGUE,
    ) -> None:
        """``types`` are names of messages that are given out (none: all); all are counted.

        Raises:
            UnknownTypeError: a name that the catalogue does not hold.

        """
        for name in types:
            if name not in catalogue.by_name:
                raise UnknownTypeError(name, tuple(catalogue.by_name))
        self._catalogue = catalogue
        # A link hears only what the other side sends: one for each ear.
        self._device_ear = link(Direction.HOST, codec=Codec(catalogue))
        self._host_ear = link(Direction.DEVICE, codec=Codec(catalogue))
        self._wanted = frozenset(types)
        self.node = node
        """The device whose messages are wanted; None: all."""
        self.others: set[int] = set()
        """Nodes of the messages that are not wanted."""
        self._since_ns = -1
        self._now_ns = 0
        self.types: dict[str, TypeCount] = {}
        """By name, in the order of first appearance."""
        self.damaged = self.rejected = self.bytes = 0
        self.newest_damage: Seen | None = None
        self.strangers: dict[int, int] = {}
        """Node → hash of its catalogue, where that is not ours: its fields may be misread."""

    def receive(self, data: bytes, now_ns: HostNs) -> list[Seen]:
        """Take bytes from the line; give what they complete and was asked for, in order."""
        if self._since_ns < 0:
            self._since_ns = now_ns
        self._now_ns = now_ns
        self.bytes += len(data)
        found: list[Seen] = []
        # Cut where a frame can end, so that both directions keep their order.
        for chunk in _cuts(data, self._device_ear.medium):
            events = self._device_ear.receive(chunk, now_ns // 1000)
            # Damage and strange frames are told once, by the first ear.
            said = self._host_ear.receive(chunk, now_ns // 1000)
            events += [e for e in said if isinstance(e, Received)]
            found += filter(None, (self._judge(event, now_ns) for event in events))
        return found

    def rates_hz(self) -> dict[str, float]:
        """Messages a second, by name."""
        return {n: c.rate_hz(self._now_ns, self._since_ns) for n, c in self.types.items()}

    def tick(self, now_ns: HostNs) -> None:
        """Tell the time where nothing comes: rates then fall."""
        if self._since_ns < 0:
            self._since_ns = now_ns
        self._now_ns = now_ns

    @property
    def lost(self) -> int:
        """The device's frames that are missing by its own numbers."""
        return self._device_ear.statistics.lost

    def _judge(self, event: Received | Rejected | DamagedFrame, now_ns: int) -> Seen | None:
        if isinstance(event, Received):
            return self._message(event, now_ns)
        if isinstance(event, Rejected):
            return None if event.reason == "direction" else self._rejected(event, now_ns)
        return self._damage(event, now_ns)

    def _message(self, event: Received, now_ns: int) -> Seen | None:
        message, frame, spec = event
        if self.node is not None and frame.node not in {self.node, 0}:
            self.others.add(frame.node)
            return None
        if isinstance(message, Hello) and message.catalogue_hash != self._catalogue.hash:
            self.strangers[frame.node] = message.catalogue_hash
        values = physical(spec, message)
        seen = Seen(
            now_ns,
            "message",
            spec.name,
            frame.node,
            spec.direction.value,
            frame.t_us,
            values,
            as_text(spec, message),
            frame.payload,
        )
        count = self.types.get(spec.name)
        if count is None:
            count = self.types[spec.name] = TypeCount(spec.name)
        count.add(seen)
        return seen if not self._wanted or spec.name in self._wanted else None

    def _rejected(self, event: Rejected, now_ns: int) -> Seen:
        self.rejected += 1
        frame = event.frame
        text = f"type 0x{frame.type_id:02x} from node {frame.node} cannot be used: {event.reason}"
        seen = _bad(now_ns, "rejected", event.reason, text, frame.payload, frame)
        return self._bad_one(seen)

    def _damage(self, event: DamagedFrame, now_ns: int) -> Seen:
        self.damaged += 1
        text = f"{event.length} B at byte {event.offset} are no frame ({event.damage.value})"
        return self._bad_one(_bad(now_ns, "damaged", event.damage.value, text, event.data, None))

    def _bad_one(self, seen: Seen) -> Seen:
        self.newest_damage = seen
        return seen


class UnknownTypeError(ValueError):
    """A name that is no message's."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        super().__init__(f"{name!r} is no message; there are {', '.join(sorted(known))}")
        self.name, self.known = name, known


def physical(spec: MessageSpec, message: Message) -> dict[str, Any]:
    """A message's values as people and programs use them, by name with the SI unit's ending."""
    found: dict[str, Any] = {}
    for item, raw in zip(spec.fields, message, strict=False):
        found[item.name + (item.si_suffix or "")] = _value(item, raw)
    return found


def as_text(spec: MessageSpec, message: Message) -> str:
    """A message's values in one line, each with its unit."""
    parts = []
    for item, raw in zip(spec.fields, message, strict=False):
        value = _value(item, raw)
        unit = "" if item.si_suffix is None or value is None else _UNITS[item.si_suffix]
        if isinstance(value, list):
            shown = "|".join(value) or "-"
        elif value is None:
            shown = "-"
        elif isinstance(value, float):
            shown = f"{value:.6g}"
        else:
            shown = str(value)
        parts.append(f"{item.name}={shown}{unit}")
    return " ".join(parts)


_UNITS = {
    "_m": "m",
    "_m_s": "m/s",
    "_rad_s": "rad/s",
    "_m_s2": "m/s²",
    "_v": "V",
    "_a": "A",
    "_s": "s",
    "_deg_c": "°C",
    "_hz": "Hz",
    "_duty": "",
}


def _value(item: Field, raw: Any) -> Any:  # noqa: ANN401 - a number, a text, a list of names or nothing
    if raw is None or raw == item.none:
        return None
    if item.enum is not None:
        if item.unit == "bits":
            flags: type[IntFlag] = item.enum  # type: ignore[assignment]  # the unit says so
            return flag_labels(flags, raw)
        return label(item.enum, raw)
    if item.si_suffix is not None:
        return raw * item.si_gain + item.si_offset
    if item.unit == "hash":
        return f"{raw:08x}"
    return raw.hex() if isinstance(raw, bytes) else raw


def _bad(now_ns: int, kind: str, name: str, text: str, raw: bytes, frame: Frame | None) -> Seen:  # noqa: PLR0913, PLR0917 - a record's parts
    node, t_us = (frame.node, frame.t_us) if frame else (0, 0)
    return Seen(now_ns, kind, name, node, "", t_us, {}, text, raw)


def _cuts(data: bytes, medium: Medium) -> list[bytes]:
    """Pieces that each end with a delimiter, or hold one CAN frame; the last may be open."""
    if medium is Medium.CAN:
        return [data[i : i + 16] for i in range(0, len(data), 16)]
    pieces = data.split(b"\0")
    return [p + b"\0" for p in pieces[:-1]] + ([pieces[-1]] if pieces[-1] else [])
