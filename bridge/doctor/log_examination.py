"""Examination of a recorded log.

A log of sweepctl contains raw bytes, which are examined like a live link. A log of another program
may contain only decoded messages. Then only the robot and its sensors are examined, and a finding
states this. For an unknown topic, only pauses are reported.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from bridge.convert.sources import readable
from bridge.doctor.body_view import FROZEN
from bridge.doctor.examination import Examination
from bridge.doctor.findings import Finding
from bridge.record.reader import LogReader
from bridge.record.version_1 import Version1, is_version_1
from bridge.record.wire_records import RAW_CAN, RAW_TOPICS, wire_record
from bridge.session.event_kinds import EventKind
from bridge.session.records import Severity
from protocol.link import Medium
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from bridge.record.reader import LogMessage

_EVENTS, _DEVICE = "/events", "/device/"
_NANO = 1e-9
PAUSE_TIMES = 20.0
"""Minimum pause of a topic that is reported, in mean periods of the topic."""
PAUSE_S = 1.0
"""Minimum pause of a topic that is reported, s. The limits in periods and in seconds must both be
exceeded."""
MIN_MESSAGES = 20
"""Minimum number of messages in a topic whose pauses are reported."""
WINDOW_NS = 2_000_000_000
"""Maximum time by which a message in a file may be out of order, ns. It is the duration of eight
chunks of a sweepctl log."""
_FAILURES = frozenset(
    {
        *(EventKind.SILENCE, EventKind.GARBAGE, EventKind.ECHO, EventKind.WORDS),
        *(EventKind.VERSION, EventKind.TRANSMIT_ONLY, EventKind.RESTLESS, EventKind.INCOMPATIBLE),
        *(EventKind.OTHER_HOST, EventKind.OTHER_NODE),
    }
)
_SHOWN = 5
_INERTIAL = tuple(
    f"{what}.{axis}" for what in ("angular_velocity", "linear_acceleration") for axis in "xyz"
)


@dataclass(slots=True)
class _Topic:
    """Statistics of one topic."""

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    pauses: list[tuple[int, int]] = field(default_factory=list)
    """Duration and start of each pause, ns."""
    before: object = None
    """IMU values of the previous message. ``equal`` counts how often they repeat."""
    equal: int = 0
    longest_equal: int = 0

    def take(self, at_ns: int) -> None:
        if self.count == 0:
            self.first_ns = at_ns
        else:
            wait_ns = at_ns - self.last_ns
            if wait_ns > PAUSE_S / _NANO:
                self.pauses.append((wait_ns, self.last_ns))
        self.last_ns = max(self.last_ns, at_ns)
        self.count += 1

    def compare(self, now: tuple[Any, ...] | None) -> None:
        """Count repeated values of an IMU; None: the message contains none."""
        if now is not None:
            self.equal = self.equal + 1 if now == self.before else 0
            self.before = now
            self.longest_equal = max(self.longest_equal, self.equal)

    @property
    def period_ns(self) -> float:
        """Mean period without the pauses, ns."""
        paused = sum(wait for wait, _ in self.pauses)
        return (self.last_ns - self.first_ns - paused) / max(self.count - 1 - len(self.pauses), 1)


def examine_log(path: Path) -> Examination:
    """Examine a log, or a capture of another program.

    Raises:
        LogReadError: the file is missing, cannot be read, or contains no supported data.

    """
    with readable(path) as log:
        return _Log(LogReader(log)).examine()


class _Log:
    """Reads one log and fills an examination."""

    def __init__(self, reader: LogReader) -> None:
        self._reader = reader
        self._topics: dict[str, _Topic] = {}
        self._raw = False
        self._version_1 = Version1() if is_version_1(reader) else None
        self._examination = Examination()
        self._begin_ns: int | None = None
        self._late: list[str] = []

    def examine(self) -> Examination:
        reader = self._reader
        first = next((m.topic for m in reader.messages(RAW_TOPICS)), "")
        self._raw = bool(first)
        medium = Medium.CAN if first == RAW_CAN else Medium.UART
        examination = self._examination = Examination(medium, raw=self._raw)
        for message in _in_order(reader.messages()):
            if self._begin_ns is None:
                self._begin_ns = message.log_ns
            self._take(message)
        self._about_file(examination)
        self._about_topics(examination)
        return examination

    def _take(self, message: LogMessage) -> None:
        topic = message.topic
        if topic in RAW_TOPICS:
            self._take_raw(message)
            return
        if topic == _EVENTS:
            raw_values = _values(message, "source", "kind", "text", "severity")
            if raw_values is not None:
                self._event(*map(str, raw_values))
            return
        known = self._topics.get(topic)
        if known is None:
            known = self._topics[topic] = _Topic()
        known.take(message.log_ns)
        if self._raw:
            return
        if topic.startswith(_DEVICE):
            self._decoded(topic.removeprefix(_DEVICE), message)
        elif message.channel.schema_name in {"sensor_msgs/msg/Imu", "sensor_msgs/Imu"}:
            known.compare(_values(message, *_INERTIAL))

    def _take_raw(self, message: LogMessage) -> None:
        record = wire_record(message)
        if record is not None:
            if self._version_1 is not None:
                record = self._version_1.rewrite(record)
            examination = self._examination
            take = examination.sent if record.outgoing else examination.received
            take(record.data, record.log_ns)

    def _event(self, source: str, kind: str, text: str, severity: str) -> None:
        """Handle an event of the session. Events report faults that the bytes do not show."""
        examination = self._examination
        if source == "link" and kind == EventKind.PORT_LOST:
            examination.port_lost.append(text)
        elif source == "session" and kind == EventKind.SCHEMA:
            if text not in examination.differences:
                examination.differences.append(text)
        elif source == "session" and kind == EventKind.LATE:
            self._late.append(text)
        elif source == "session" and kind in _FAILURES and severity == "error":
            examination.failure = kind, text

    def _decoded(self, name: str, message: LogMessage) -> None:
        """Handle a decoded message of the device, for the examination of robot and sensors."""
        spec = CATALOGUE.by_name.get(name)
        if spec is None:
            return
        raw_values = _values(message, "t_us", *(f.name for f in spec.fields))
        if raw_values is None or not all(
            isinstance(value, int | bytes | str) for value in raw_values
        ):
            return  # another program's topic of the same name
        t_us, *values = raw_values
        if isinstance(t_us, int):
            self._examination.wire.note_decoded(spec, spec.cls(*values), t_us, message.log_ns)

    # ---- findings about the file ------------------------------------------------------------

    def _about_file(self, examination: Examination) -> None:
        reader = self._reader
        if reader.truncated:
            text = "the end of the log is missing; the rest was read"
            examination.extra.append(Finding("truncated", Severity.WARNING, text))
        if reader.problems:
            text = f"the log is damaged: {reader.problems[0]}"
            problems = reader.problems[:_SHOWN]
            examination.extra.append(
                Finding("damaged_log", Severity.WARNING, text, {"problems": problems})
            )
        if not self._raw:
            text = "the log contains no raw bytes; link and clock were not examined"
            examination.extra.append(Finding("not_recorded", Severity.INFO, text))
        if self._late:
            text = f"the host recorded {len(self._late)} delays of its loop; the first: "
            text += self._late[0]
            times = {"times": len(self._late)}
            examination.extra.append(Finding("host_stall", Severity.WARNING, text, times))

    def _about_topics(self, examination: Examination) -> None:
        """Report pauses of topics. With raw bytes, the rules of the link report them instead."""
        if self._raw:
            return
        for name, topic in sorted(self._topics.items()):
            if topic.longest_equal >= FROZEN:
                text = f"{name} repeated the same values {topic.longest_equal} times"
                data: dict[str, Any] = {"topic": name, "equal": topic.longest_equal}
                examination.extra.append(Finding("imu", Severity.WARNING, text, data))
            pauses = [p for p in topic.pauses if p[0] > PAUSE_TIMES * topic.period_ns]
            if topic.count < MIN_MESSAGES or not pauses:
                continue
            wait_ns, at_ns = max(pauses)
            at_s = (at_ns - (self._begin_ns or at_ns)) * _NANO
            text = (
                f"{name} (period {topic.period_ns * 1e-6:.0f} ms) paused {len(pauses)} times; "
                f"the longest pause was {wait_ns * _NANO:.1f} s at {at_s:.1f} s"
            )
            data = {"topic": name, "pauses": len(pauses), "longest_s": wait_ns * _NANO}
            examination.extra.append(Finding("topic_gap", Severity.WARNING, text, data))


def _in_order(messages: Iterable[LogMessage]) -> Iterator[LogMessage]:
    """Sort messages by time, because some writers group the messages of a chunk by topic."""
    waiting: list[tuple[int, int, LogMessage]] = []
    newest_ns = 0
    for number, message in enumerate(messages):
        newest_ns = max(newest_ns, message.log_ns)
        heapq.heappush(waiting, (message.log_ns, number, message))
        while waiting[0][0] < newest_ns - WINDOW_NS:
            yield heapq.heappop(waiting)[2]
    while waiting:
        yield heapq.heappop(waiting)[2]


def _values(message: LogMessage, *names: str) -> tuple[Any, ...] | None:
    """Return fields of a message by dotted name; None if it is damaged or lacks a field."""
    try:
        decoded = message.decoded
    except ValueError:
        return None
    try:
        return tuple(attrgetter(name)(decoded) for name in names)
    except AttributeError:
        return None
