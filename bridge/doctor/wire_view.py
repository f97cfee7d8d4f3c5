"""Examination of a link's bytes: frames, damage, losses, round trips and boots.

It uses every byte of both directions with its time. It stores statistics, not the bytes.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from protocol.can.link import CanLink
from protocol.clock import elapsed_us
from protocol.link import Medium, Received, Rejected
from protocol.messages.device import Hello, LinkCounters, LogText, Power, Status, TimeReply
from protocol.messages.host import PlannerCommand, TimeRequest
from protocol.messages.values import OnboardPlanner, PlannerAction, label
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from protocol.schema.message import Direction, RateClass
from protocol.uart.framing import CRC, HEADER, DamagedFrame
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.link import LinkBase, LinkEvent
    from protocol.schema.message import Message, MessageSpec

_KEPT = 1024
"""Number of received bytes that are stored to examine damaged data. It is four frames of maximum
length."""
_RECENT = 16
"""Number of frames that are stored to detect duplicates."""
_VERSION = PROTOCOL_VERSION << 4
_COBS_AND_CRC = 1 + CRC.size
_HEAD_SEEN = 4
"""Number of bytes of a frame up to its type: COBS code byte, version, node, type."""
CRASH_LINE = "crash after "
"""Beginning of the log line in which a device sends its crash record (docs/device.md)."""
_MAX_TEXT = 2048
"""Number of bytes that are stored from the beginning of the capture, to recognise text."""
_MAX_MARKS = 2_000_000
"""Maximum number of frames whose times are stored. They cover more than two hours at the default
rates."""


@dataclass(slots=True)
class Boot:
    """One boot of the device, from its hello."""

    boot_id: int
    cause: int
    at_ns: int
    firmware: str
    catalogue_hash: int
    uid: bytes


@dataclass(slots=True)
class Damaged:
    """Damaged data, classified by the message length that its header indicates."""

    whole: int = 0
    """Number of pieces of the right length. Their bits were flipped."""
    short: int = 0
    """Number of pieces that lack bytes."""
    long: int = 0
    """Number of pieces with too many bytes: two frames without a delimiter, or repeated bytes."""
    unknown: int = 0
    """Number of pieces whose header has an unknown message type."""
    bytes: int = 0
    unknown_bytes: int = 0

    @property
    def total(self) -> int:
        """Number of damaged pieces."""
        return self.whole + self.short + self.long + self.unknown


@dataclass(slots=True)
class Stream:
    """Statistics of one message type over the capture."""

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    longest_ns: int = 0
    """Longest time between two messages, ns."""
    default_hz: float = 0.0

    @property
    def rate_hz(self) -> float | None:
        """Mean rate, Hz; None for fewer than two messages."""
        if self.count < 2 or self.last_ns <= self.first_ns:  # noqa: PLR2004 - a rate needs two
            return None
        return (self.count - 1) / ((self.last_ns - self.first_ns) * 1e-9)


@dataclass(slots=True)
class FrameTimes:
    """Times of the intact frames in order, for the timing analysis."""

    arrived_ns: array[int] = field(default_factory=lambda: array("q"))
    stamp_us: array[int] = field(default_factory=lambda: array("q"))
    """Device times of the frames, µs, 32 bits as received."""
    skipped: array[int] = field(default_factory=lambda: array("q"))
    """Number of frames missing before each frame, from the sequence numbers."""


class WireView:
    """Examines one link. Pass its bytes to :meth:`received` and :meth:`sent`."""

    def __init__(self, medium: Medium = Medium.UART) -> None:
        """Start without any data."""
        can = medium is Medium.CAN
        self.on_message: Callable[[Message, int, int], None] = lambda *_: None
        """Function that is called with each message of the device, its stamp (µs, 32 bits) and
        arrival (ns)."""
        self.bytes_in = self.bytes_out = 0
        self.frames = 0
        self.lost = 0
        self.repeated = 0
        """Number of duplicate frames."""
        self.foreign = Counter[str]()
        """Number of intact frames that could not be used, by reason."""
        self.versions: set[int] = set()
        """Unsupported protocol versions that were received."""
        self.damaged = Damaged()
        self.streams: dict[str, Stream] = {}
        self.boots: list[Boot] = []
        self.marks = FrameTimes()
        self.chunk_ns = array("q")
        """Times at which the port returned bytes, ns."""
        self.round_trips: list[tuple[int, int]] = []
        """Arrival of the reply (ns) and round trip without the device's processing time (ns), for
        each answered ping."""
        self.device_damaged = self.device_stale = self.device_received = 0
        """Increase of the device's counters of frames from the host, during the capture."""
        self.device_receive_dropped = self.device_send_dropped = self.can_bus_offs = 0
        """Increase of the counters of the device's queues and of its CAN controller, during the
        capture."""
        self.can_errors = 0
        """Highest value of the CAN controller's error counters (TEC and REC)."""
        self.faults = 0
        """Fault bits that the device reported during the capture."""
        self.crash = ""
        """The device's log line with its crash record; empty if there is none."""
        self.logic_low_v: float | None = None
        self.load_percent = 0
        self.stop_cause: int | None = None
        self.beginning = b""
        self.onboard = ""
        """Name of the onboard planner that the host started last."""
        self._can = can
        self._rx: LinkBase = (CanLink if can else Link)(Direction.HOST)
        self._tx: LinkBase = (CanLink if can else Link)(Direction.DEVICE)
        self._tail = b""
        self._seq: int | None = None
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RECENT)
        self._pings: dict[int, int] = {}
        self._counters: LinkCounters | None = None

    # ---- bytes ----------------------------------------------------------------------------

    @property
    def heard_s(self) -> float:
        """Time from the first to the last decoded message, s."""
        streams = self.streams.values()
        if not streams:
            return 0.0
        first_ns = min(stream.first_ns for stream in streams)
        return (max(stream.last_ns for stream in streams) - first_ns) * 1e-9

    @property
    def streaming_ns(self) -> float:
        """Arrival of the first message of a stream, ns; infinite if there is none."""
        first = (
            float(stream.first_ns)
            for name, stream in self.streams.items()
            if CATALOGUE.by_name[name].rate is RateClass.STREAM
        )
        return min(first, default=math.inf)

    def received(self, data: bytes, at_ns: int) -> None:
        """Handle bytes from the device and their arrival time; on CAN, whole 16-byte records."""
        if not data:
            return
        if len(self.beginning) < _MAX_TEXT:
            self.beginning = (self.beginning + data)[:_MAX_TEXT]
        self.bytes_in += len(data)
        self._tail = (self._tail + data)[-_KEPT - len(data) :]
        if len(self.chunk_ns) < _MAX_MARKS:
            self.chunk_ns.append(at_ns)
        for event in self._rx.receive(data, at_ns // 1000):
            self._event(event, at_ns)
        self._tail = self._tail[-_KEPT:]

    def sent(self, data: bytes, at_ns: int) -> None:
        """Handle bytes that were sent to the device."""
        self.bytes_out += len(data)
        for event in self._tx.receive(data, at_ns // 1000):
            if not isinstance(event, Received):
                continue
            message = event.message
            if isinstance(message, TimeRequest):
                self._pings[message.ping] = at_ns
            elif isinstance(message, PlannerCommand) and message.action == PlannerAction.START:
                self.onboard = label(OnboardPlanner, message.planner).replace("_", "-")

    def note_decoded(self, spec: MessageSpec, message: Message, stamp_us: int, at_ns: int) -> None:
        """Handle a decoded message from a log without raw bytes."""
        self.frames += 1
        if isinstance(message, Hello):
            self._hello(message, at_ns)
        self._note(spec, message, stamp_us, at_ns)

    # ---- link events ----------------------------------------------------------------------

    def _event(self, event: LinkEvent, at_ns: int) -> None:
        if isinstance(event, Received):
            self._message(event, at_ns)
        elif isinstance(event, Rejected):
            self.foreign[event.reason] += 1
            self._sequence(event.frame.seq, event.frame.t_us, at_ns)
            if event.reason == "version":
                self.versions.add(event.frame.version)
        else:
            self._damage(event)

    def _message(self, event: Received, at_ns: int) -> None:
        message, frame, spec = event
        self.frames += 1
        if isinstance(message, Hello):
            self._hello(message, at_ns)
        self._sequence(frame.seq, frame.t_us, at_ns)
        if isinstance(message, TimeReply):
            self._reply(message, frame.t_us, at_ns)
        self._note(spec, message, frame.t_us, at_ns)

    def _note(self, spec: MessageSpec, message: Message, stamp_us: int, at_ns: int) -> None:
        stream = self.streams.get(spec.name)
        if stream is None:
            rate_hz = float(spec.default_hz or 0.0)
            stream = self.streams[spec.name] = Stream(0, at_ns, at_ns, 0, rate_hz)
        stream.count += 1
        stream.longest_ns = max(stream.longest_ns, at_ns - stream.last_ns)
        stream.last_ns = at_ns
        match message:
            case LinkCounters():
                self._count(message)
            case Power():
                low_v = message.logic_v
                self.logic_low_v = (
                    low_v if self.logic_low_v is None else min(self.logic_low_v, low_v)
                )
            case Status():
                self.load_percent = max(self.load_percent, message.load)
                self.stop_cause = message.stop_cause
                self.faults |= message.faults
            case LogText() if message.line.startswith(CRASH_LINE):
                self.crash = message.line
            case _:
                pass
        self.on_message(message, stamp_us, at_ns)

    def _sequence(self, seq: int, stamp_us: int, at_ns: int) -> None:
        before, self._seq = self._seq, seq
        skipped = 0
        if (seq, stamp_us) in self._recent:
            self.repeated += 1
            return
        self._recent.append((seq, stamp_us))
        if before is not None and not self._can:
            skipped = (seq - before - 1) & 0xFF
            self.lost += skipped
        marks = self.marks
        if len(marks.arrived_ns) < _MAX_MARKS:
            marks.arrived_ns.append(at_ns)
            marks.stamp_us.append(stamp_us)
            marks.skipped.append(skipped)

    def _hello(self, hello: Hello, at_ns: int) -> None:
        if self.boots and self.boots[-1].boot_id == hello.boot_id:
            return
        name = f"{hello.name} {hello.version_major}.{hello.version_minor}.{hello.version_patch}"
        self.boots.append(
            Boot(hello.boot_id, hello.reset_cause, at_ns, name, hello.catalogue_hash, hello.uid)
        )
        self._seq = self._counters = None  # both restart at a boot

    def _reply(self, reply: TimeReply, replied_us: int, at_ns: int) -> None:
        sent_ns = self._pings.pop(reply.ping, None)
        if sent_ns is not None:
            own_ns = elapsed_us(reply.received_us, replied_us) * 1000
            self.round_trips.append((at_ns, at_ns - sent_ns - own_ns))

    def _count(self, counters: LinkCounters) -> None:
        before, self._counters = self._counters, counters
        if before is not None:
            self.device_received += (counters.received - before.received) & 0xFFFF
            self.device_damaged += (counters.damaged - before.damaged) & 0xFFFF
            self.device_stale += (counters.stale - before.stale) & 0xFFFF
        if None in tuple(counters):
            return  # an older device lacks the counters below
        self.can_errors = max(
            self.can_errors, counters.can_send_errors, counters.can_receive_errors
        )
        if before is not None:
            self.device_receive_dropped += (
                counters.receive_dropped - before.receive_dropped
            ) & 0xFFFF
            self.device_send_dropped += (counters.send_dropped - before.send_dropped) & 0xFFFF
            self.can_bus_offs += (counters.can_bus_offs - before.can_bus_offs) & 0xFFFF

    def _damage(self, event: DamagedFrame) -> None:
        start = len(self._tail) - (self.bytes_in - event.offset)
        stretch = self._tail[start : start + event.length] if start >= 0 else b""
        expected = _length_by_header(stretch)
        self.damaged.bytes += event.length
        if expected is None:
            self.damaged.unknown += 1
            self.damaged.unknown_bytes += event.length
        elif event.length == expected:
            self.damaged.whole += 1
        elif event.length < expected:
            self.damaged.short += 1
        else:
            self.damaged.long += 1


def _length_by_header(stretch: bytes) -> int | None:
    """Return the encoded length of the message type in a damaged frame's header, or None.

    The first bytes of the header are never zero, so COBS does not change them.
    """
    if len(stretch) < _HEAD_SEEN or stretch[1] & 0xF0 != _VERSION:
        return None
    spec = CATALOGUE.by_type.get(stretch[3])
    if spec is None or spec.direction is not Direction.DEVICE or spec.text_field is not None:
        return None
    return int(HEADER.size + spec.layout.size + _COBS_AND_CRC)
