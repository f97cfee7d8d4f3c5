"""Reader of the data for a run's report in its log."""

from __future__ import annotations

import contextlib
import json
import math
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bridge.evaluation.metrics import CoverageMeter
from bridge.record.reader import LATEST_NS, MISREAD, LogReader
from bridge.run.mission import Phase
from bridge.session.event_kinds import EventKind
from bridge.view.report.run_track import load_track
from bridge.view.run_reading import LossCounter, PoseErrors, boot_id_of
from protocol.messages.values import StopCause, fault_labels, label
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import RateClass

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.evaluation.metrics import CoverageReport
    from bridge.record.reader import LogMessage
    from bridge.view.report.run_track import RunTrack

_NS = 1e9
_GAP_PERIODS = 3.0
"""Minimum length of a gap, in periods of the message. It is three, because one lost frame is normal
on a real link."""
_RESOLUTION_M = 0.005
"""Cell size of the coverage, m."""
_LARGEST = 1e15
"""Maximum value that is drawn. Axes cannot show larger values. The comparison also rejects NaN."""
_MAX_FRAMES = 1 << 32
"""Maximum number of damaged frames in one event. It is more than an hour at 3 Mbaud can contain."""
_MAX_SECONDS = 1_000_000
"""Maximum length of a log with one row for each second, s. It is eleven days."""
_LEVELS = {3: "warning", 4: "error", 5: "error"}
"""Map of a log line's level in ``foxglove.Log`` to its severity as an event."""


@dataclass(slots=True)
class MessageStream:
    """Statistics of one message type of the device."""

    name: str
    asked_hz: float
    """Default rate from the catalogue, Hz."""
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    gaps: int = 0
    """Number of pauses of more than three periods."""
    longest_s: float = 0.0

    @property
    def rate_hz(self) -> float | None:
        """Mean rate between the first and the last message, Hz."""
        span_s = (self.last_ns - self.first_ns) / _NS
        return (self.count - 1) / span_s if self.count > 1 and span_s > 0 else None

    def add(self, log_ns: int) -> None:
        """Add one message."""
        if self.count:
            pause_s = (log_ns - self.last_ns) / _NS
            self.longest_s = max(self.longest_s, pause_s)
            if self.asked_hz and pause_s > _GAP_PERIODS / self.asked_hz:
                self.gaps += 1
        else:
            self.first_ns = log_ns
        self.count += 1
        self.last_ns = log_ns


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """One event in the log."""

    time_s: float
    severity: str
    source: str
    kind: str
    text: str


@dataclass(slots=True)
class RunData:
    """The data of one run. Times are in seconds since the first message."""

    path: Path
    track: RunTrack
    meter: CoverageMeter | None
    coverage: CoverageReport | None
    """Coverage by the true path, or by the estimated path if the true path is unknown; None: there
    is no room or no path."""
    metadata: dict[str, str]
    whole: bool
    problems: list[str]
    file_bytes: int
    start_ns: int = 0
    end_ns: int = 0
    streams: dict[str, MessageStream] = field(default_factory=dict)
    power: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Time, battery voltage (V), current of the left and of the right motor (A)."""
    clock: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Time, error bound (ms), round-trip time (ms), drift (ppm)."""
    link: list[tuple[float, int, int]] = field(default_factory=list)
    """Second of the run, and numbers of received and of lost frames in this second."""
    pose_error: list[tuple[float, float]] = field(default_factory=list)
    """Time, distance between estimated and true position (m)."""
    happenings: list[LoggedEvent] = field(default_factory=list)
    damaged: int = 0
    """Number of damaged frames."""

    @property
    def summary(self) -> dict[str, Any]:
        """The run's summary; empty if the run did not end normally."""
        return self.track.summary

    @property
    def duration_s(self) -> float:
        """Duration of the log, s."""
        return (self.end_ns - self.start_ns) / _NS

    @property
    def lost(self) -> int:
        """Number of lost frames of the device, by the sequence numbers."""
        return sum(lost for _, _, lost in self.link)

    @property
    def motor_wh(self) -> float | None:
        """Energy into the motor drivers, Wh: battery voltage times motor current, integrated."""
        joules = 0.0
        for (t0, *_), (t1, volts, left, right) in zip(self.power, self.power[1:], strict=False):
            joules += (t1 - t0) * volts * (left + right)
        return joules / 3600.0 if len(self.power) > 1 else None

    def figure(self, *keys: str) -> float | None:
        """Return a number from the summary; None if it is missing."""
        value: Any = self.summary
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else None
        return float(value) if isinstance(value, (int, float)) else None


def load_run(path: Path) -> RunData:
    """Read the data of a run from its log.

    Raises:
        LogReadError: the log is missing, cannot be read, or is no MCAP file.

    """
    reader = LogReader(path)
    track = load_track(path)
    meter = report = None
    if track.plan is not None and track.best:
        meter = CoverageMeter(track.plan, track.model, _RESOLUTION_M)
        begin_s, end_s = _drive(reader, track.start_ns)
        report = meter.measure((t, *pose) for t, pose in track.best if begin_s <= t <= end_s)
    metadata = {**reader.metadata.get("device", {}), **reader.run}
    data = RunData(
        path, track, meter, report, metadata, not reader.truncated, reader.problems, reader.bytes
    )
    gather = _Gatherer(data)
    for message in reader.messages(gather.topics):
        gather.take(message)
    gather.finish()
    data.problems = reader.problems
    errors = PoseErrors[float]()
    for time_s, pose in track.truth:
        errors.add_truth(time_s, pose.x_m, pose.y_m)
    for time_s, pose in track.estimate:
        errors.add_estimate(time_s, pose.x_m, pose.y_m)
    data.pose_error = list(errors.take())
    return data


def _drive(reader: LogReader, start_ns: int) -> tuple[float, float]:
    """Return the start and end of the drive on the track's clock; infinite: not recorded."""
    begin_s, end_s = -math.inf, math.inf
    for message in reader.messages({"/events"}):
        try:
            event = message.decoded
            is_phase = event.source == "session" and event.kind == EventKind.PHASE
            phase = _phase(event) if is_phase else None
        except MISREAD:
            continue
        if phase == Phase.DRIVING.value and begin_s == -math.inf:
            begin_s = (message.log_ns - start_ns) / _NS
        elif phase == Phase.ENDING.value:
            end_s = (message.log_ns - start_ns) / _NS
    return begin_s, end_s


def _phase(event: Any) -> object:  # noqa: ANN401 - type of a decoded value
    """Return the phase in a run's event. In logs of version 0.1 it is the last word of the text.

    Raises:
        ValueError: the data is not JSON; the event comes from another program.

    """
    data = json.loads(event.data_json or "{}")
    phase = data.get("phase") if isinstance(data, dict) else None
    return event.text.rpartition(" ")[2] if phase is None else phase


def frames_of(data_json: str) -> int:
    """Return the number of damaged frames in an event; older logs have one event for each frame.

    Raises:
        ValueError: the data is not JSON; the event comes from another program.

    """
    data = json.loads(data_json or "{}")
    frames = data.get("frames") if isinstance(data, dict) else None
    return min(max(frames, 0), _MAX_FRAMES) if isinstance(frames, int) else 1


class _Gatherer:
    """Collects the data of a report from the messages of a log."""

    def __init__(self, data: RunData) -> None:
        self._data = data
        self._stop, self._faults = -1, 0
        self._losses, self._second = LossCounter(), 0
        self._seconds: Counter[int] = Counter()
        self._lost: Counter[int] = Counter()
        self._rates = {
            spec.name: spec.default_hz if spec.rate is RateClass.STREAM else 0.0
            for spec in CATALOGUE
        }
        self.topics = _Wanted()

    def take(self, message: LogMessage) -> None:
        """Handle one message; skip it if it cannot be decoded."""
        data, topic, log_ns = self._data, message.channel.topic, message.log_ns
        if log_ns > LATEST_NS:
            return
        if data.start_ns == 0:
            data.start_ns = log_ns
        data.end_ns = max(data.end_ns, log_ns)
        if topic.startswith("/device/"):
            self._count(message, topic.removeprefix("/device/"))
        with contextlib.suppress(*MISREAD):
            self._read(topic, (log_ns - data.start_ns) / _NS, message)

    def _read(self, topic: str, time_s: float, message: LogMessage) -> None:
        data = self._data
        match topic:
            case "/device/power":
                power = message.decoded
                left_a, right_a = _number(power.motor_left_a), _number(power.motor_right_a)
                data.power.append((time_s, _number(power.battery_v), left_a, right_a))
            case "/device/status":
                self._status(time_s, message.decoded)
            case "/clock/sync":
                sync = message.decoded
                bound_ms, trip_ms = sync.bound_ns * 1e-6, sync.round_trip_ns * 1e-6
                drift_ppm = _number(sync.drift_ppm)
                data.clock.append((time_s, _number(bound_ms), _number(trip_ms), drift_ppm))
            case "/events":
                event = message.decoded
                if event.source == "link" and event.kind == EventKind.DAMAGED:
                    data.damaged += frames_of(event.data_json)
                words = event.severity, event.source, event.kind, event.text
                data.happenings.append(LoggedEvent(time_s, *map(str, words)))
            case "/log" if (level := _LEVELS.get(message.decoded.level)) is not None:
                line = message.decoded
                words = level, line.name, "log", line.message
                data.happenings.append(LoggedEvent(time_s, *map(str, words)))

    def _count(self, message: LogMessage, name: str) -> None:
        stream = self._data.streams.get(name)
        if stream is None:
            stream = self._data.streams[name] = MessageStream(name, self._rates.get(name, 0.0))
        stream.add(message.log_ns)
        second = int((message.log_ns - self._data.start_ns) // 1_000_000_000)
        self._seconds[second] += 1
        if second != self._second:
            self._lost[self._second] += self._losses.update()
            self._second = second
        self._losses.add(message.sequence, boot_id_of(message))

    def _status(self, time_s: float, status: Any) -> None:  # noqa: ANN401 - type of a decoded value
        if status.stop_cause != self._stop:
            if self._stop >= 0 or status.stop_cause:
                name = label(StopCause, status.stop_cause)
                self._note(time_s, "info", "stop", f"the device's stop cause is now {name}")
            self._stop = status.stop_cause
        new = fault_labels(status.faults & ~self._faults)
        if new:
            self._note(time_s, "warning", "new fault", f"the device reports: {', '.join(new)}")
        self._faults = status.faults

    def _note(self, time_s: float, severity: str, kind: str, text: str) -> None:
        self._data.happenings.append(LoggedEvent(time_s, severity, "device", kind, text))

    def finish(self) -> None:
        """Compute the row of each second, and remove events that the host has also recorded."""
        data = self._data
        self._lost[self._second] += self._losses.update()
        seen = {(happening.source, happening.kind) for happening in data.happenings}
        double = set()
        if ("safety", "latch") in seen:
            double = {("device", "stop"), ("device", "new fault")}
        data.happenings = [h for h in data.happenings if (h.source, h.kind) not in double]
        last = max(self._seconds, default=-1)
        # A damaged stamp may be years later. Then only seconds with frames have a row.
        seconds = range(last + 1) if last < _MAX_SECONDS else sorted(self._seconds)
        self._data.link = [(float(s), self._seconds[s], self._lost[s]) for s in seconds]


def _number(value: Any) -> float:  # noqa: ANN401 - of a decoded message
    """Return a value that a curve can show.

    Raises:
        ValueError: the value is too large or NaN.

    """
    number = float(value)
    if not abs(number) < _LARGEST:
        raise ValueError(f"{number} is no measurement")
    return number


class _Wanted:
    def __contains__(self, topic: object) -> bool:
        return topic in _TOPICS or str(topic).startswith("/device/")


_TOPICS = {"/events", "/log", "/clock/sync"}
