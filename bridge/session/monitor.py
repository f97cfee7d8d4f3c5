"""Receive-only monitor of a link: message types, rates and errors.

Sans-I/O and without a session. Its inputs are bytes and host time, its output is decoded messages.
It cannot send anything.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from protocol.link import LinkBase, Medium, Received, Rejected
from protocol.messages.device import Hello
from protocol.messages.values import flag_labels, label
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.message import Direction
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Collection
    from enum import IntFlag

    from protocol.clock import HostNs
    from protocol.schema.fields import Field
    from protocol.schema.message import Message, MessageSpec
    from protocol.uart.framing import DamagedFrame, Frame

RATE_WINDOW_NS = 2_000_000_000
"""Window of the message rates, ns: two periods of the slowest stream."""
_SECOND = 1_000_000_000


class Seen(NamedTuple):
    """One message, rejected frame or damaged frame on the link."""

    host_ns: int
    kind: str
    """``message``, ``rejected`` or ``damaged``."""
    name: str
    """Name of the message or of the error."""
    node: int
    direction: str
    """Sender: ``device`` or ``host``; empty if unknown."""
    t_us: int
    """Sender's 32-bit stamp, µs."""
    fields: dict[str, Any]
    """Physical values with the unit in the name; labels for enumerations and bits."""
    text: str
    """The values as one line of text."""
    raw: bytes
    """Payload, or the bytes that are not a frame."""


@dataclass(slots=True)
class TypeCount:
    """Count, rate and newest message of one type."""

    name: str
    count: int = 0
    newest: Seen | None = None
    _times: deque[int] = field(default_factory=deque)

    def add(self, seen: Seen) -> None:
        """Count one message."""
        self.count += 1
        self.newest = seen
        self._times.append(seen.host_ns)
        self._drop_before(seen.host_ns - RATE_WINDOW_NS)

    def rate_hz(self, now_ns: int, since_ns: int) -> float:
        """Return the mean rate over the window; it decreases if no message arrives.

        Intervals are counted, not messages: two messages that are 1 s apart are 1 Hz. Without an
        interval the rate is that of the messages since the start, over at least 1 s.
        """
        times = self._times
        self._drop_before(now_ns - RATE_WINDOW_NS)
        if not times or times[0] == times[-1]:
            return len(times) / (min(RATE_WINDOW_NS, max(now_ns - since_ns, _SECOND)) / _SECOND)
        mean_ns = (times[-1] - times[0]) / (len(times) - 1)
        return _SECOND / max(mean_ns, (now_ns - times[0]) / len(times))

    def _drop_before(self, oldest_ns: int) -> None:
        while self._times and self._times[0] < oldest_ns:
            self._times.popleft()


class Monitor:
    """Decodes both directions of a link and counts the messages."""

    def __init__(
        self,
        link: type[LinkBase] = Link,
        *,
        types: Collection[str] = (),
        node: int | None = None,
        catalogue: Catalogue = CATALOGUE,
    ) -> None:
        """Create a monitor.

        It counts all messages, but returns only messages in ``types`` (empty: all).

        Raises:
            UnknownTypeError: the catalogue has no message of a name in ``types``.

        """
        for name in types:
            if name not in catalogue.by_name:
                raise UnknownTypeError(name, tuple(catalogue.by_name))
        self._catalogue = catalogue
        # A link receives one direction only, so there is one link for each direction.
        self._device_link = link(Direction.HOST, codec=Codec(catalogue))
        self._host_link = link(Direction.DEVICE, codec=Codec(catalogue))
        self._wanted = frozenset(types)
        self.node = node
        """Node whose messages are returned; None: all nodes."""
        self.others: set[int] = set()
        """Other nodes whose messages were received."""
        self._since_ns = -1
        self._now_ns = 0
        self.types: dict[str, TypeCount] = {}
        """Count by message name, in the order of first arrival."""
        self.damaged = self.rejected = self.bytes = 0
        self.newest_damage: Seen | None = None
        self.foreign_catalogues: dict[int, int] = {}
        """Map of node to catalogue hash, for nodes with a different catalogue. Their fields may be
        decoded wrongly."""

    def receive(self, data: bytes, now_ns: HostNs) -> list[Seen]:
        """Decode bytes; return the requested messages in order."""
        if self._since_ns < 0:
            self._since_ns = now_ns
        self._now_ns = now_ns
        self.bytes += len(data)
        found: list[Seen] = []
        # Split at frame ends, so that the frames of both directions stay in order.
        for chunk in _cuts(data, self._device_link.medium):
            events = self._device_link.receive(chunk, now_ns // 1000)
            # The first link reports damaged and unknown frames. The second link would report them
            # again.
            host_events = self._host_link.receive(chunk, now_ns // 1000)
            events += [e for e in host_events if isinstance(e, Received)]
            found += filter(None, (self._judge(event, now_ns) for event in events))
        return found

    def rates_hz(self) -> dict[str, float]:
        """Messages per second, by name."""
        return {n: c.rate_hz(self._now_ns, self._since_ns) for n, c in self.types.items()}

    def tick(self, now_ns: HostNs) -> None:
        """Advance the time if nothing is received, so that rates decrease."""
        if self._since_ns < 0:
            self._since_ns = now_ns
        self._now_ns = now_ns

    @property
    def lost(self) -> int:
        """Number of lost device frames, from gaps in their sequence numbers."""
        return self._device_link.statistics.lost

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
            self.foreign_catalogues[frame.node] = message.catalogue_hash
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
        text = f"type 0x{frame.type_id:02x} from node {frame.node} rejected: {event.reason}"
        seen = _bad(now_ns, "rejected", event.reason, text, frame.payload, frame)
        return self._bad_one(seen)

    def _damage(self, event: DamagedFrame, now_ns: int) -> Seen:
        self.damaged += 1
        text = f"{event.length} B at byte {event.offset} are not a frame ({event.damage.value})"
        return self._bad_one(_bad(now_ns, "damaged", event.damage.value, text, event.data, None))

    def _bad_one(self, seen: Seen) -> Seen:
        self.newest_damage = seen
        return seen


class UnknownTypeError(ValueError):
    """A message name that the catalogue does not contain."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        super().__init__(f"unknown message {name!r}; use one of {', '.join(sorted(known))}")
        self.name, self.known = name, known


def physical(spec: MessageSpec, message: Message) -> dict[str, Any]:
    """Return a message's values in SI units; each name ends with its unit."""
    found: dict[str, Any] = {}
    for item, raw in zip(spec.fields, message, strict=False):
        found[item.name + (item.si_suffix or "")] = _value(item, raw)
    return found


def as_text(spec: MessageSpec, message: Message) -> str:
    """Return a message's values as one line, each with its unit."""
    return " ".join(f"{name}={value}{unit}" for name, value, unit in texts(spec, message))


def texts(spec: MessageSpec, message: Message) -> list[tuple[str, str, str]]:
    """Return name, value and unit of each field of a message; a dash is an unknown value."""
    parts = []
    for item, raw in zip(spec.fields, message, strict=False):
        value = _value(item, raw)
        unit = "" if item.si_unit is None or value is None else item.si_unit.text
        if isinstance(value, list):
            shown = "|".join(value) or "-"
        elif value is None:
            shown = "-"
        elif isinstance(value, float):
            shown = f"{value:.6g}"
        else:
            shown = str(value)
        parts.append((item.name, shown, unit))
    return parts


def _value(item: Field, raw: Any) -> Any:  # noqa: ANN401 - number, text, list of labels or None
    if raw is None or raw == item.none:
        return None
    if item.enum is not None:
        if item.unit == "bits":
            flags: type[IntFlag] = item.enum  # type: ignore[assignment]  # bits have flag enumerations
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
    """Split bytes after each delimiter, or into CAN frames; the last piece may be incomplete."""
    if medium is Medium.CAN:
        return [data[i : i + 16] for i in range(0, len(data), 16)]
    pieces = data.split(b"\0")
    return [p + b"\0" for p in pieces[:-1]] + ([pieces[-1]] if pieces[-1] else [])
