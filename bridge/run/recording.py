"""Conversion of a host's data and events to records of the log."""

from __future__ import annotations

from collections import Counter
from itertools import takewhile
from typing import TYPE_CHECKING, Any

from bridge.motion.estimation.disturbance import DisturbanceKind
from bridge.run.mission import LOST_TIMEOUT_S
from bridge.session.event_kinds import EventKind
from bridge.session.records import (
    ClockRecord,
    CommandRecord,
    CoverageRecord,
    EventRecord,
    IdentityRecord,
    LogRecord,
    PlannerRecord,
    PoseRecord,
    RawBytes,
    RawCan,
    Severity,
)
from bridge.session.redaction import KeyRedactor, redacted_can
from protocol.can.frames import RECORD
from protocol.messages.values import LogLevel, ResetCause, StopCause, fault_labels, label

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.coverage.planner import PlannerState
    from bridge.coverage.swept_map import SweptMap
    from bridge.motion.estimation.disturbance import Disturbance
    from bridge.motion.estimation.estimator import PoseEstimator
    from bridge.motion.geometry import Pose2
    from bridge.motion.observation import VelocityCommand
    from bridge.record.sink import Sink
    from bridge.run.runner import Runner
    from bridge.session.link_stats import WireStatistics
    from bridge.session.states import SessionReady
    from bridge.session.timesync import TimeSync
    from protocol.link import Rejected
    from protocol.messages.device import Hello, LogText, Status
    from protocol.uart.framing import DamagedFrame

_LEVELS = {
    LogLevel.DEBUG: Severity.DEBUG,
    LogLevel.INFO: Severity.INFO,
    LogLevel.WARNING: Severity.WARNING,
    LogLevel.ERROR: Severity.ERROR,
}
_FELT = {
    DisturbanceKind.BUMP: "the robot hit an obstacle: speed step of {:.3f} m/s",
    DisturbanceKind.STALL: "the robot stands still while its wheels turn at {:.3f} m/s",
    DisturbanceKind.SLIP_LEFT: "the left wheel slips by {:.3f} m/s",
    DisturbanceKind.SLIP_RIGHT: "the right wheel slips by {:.3f} m/s",
}
LINK_PERIOD_NS = 10_000_000_000
"""Interval of the link statistics in the log, ns."""
GATHER_NS = 250_000_000
"""Time over which damaged and rejected frames are collected into one record, ns. A serial link at 3
Mbaud can transfer 75 000 damaged frames per second. Their raw bytes are recorded separately."""
SHOWN_BYTES = 16
"""Number of bytes of the first damaged frame that its record shows."""
_new = tuple.__new__


class Tally:
    """Collects frames into one record.

    The first frame is recorded at once; after that there is one record per :data:`GATHER_NS`.
    """

    def __init__(self) -> None:
        """Create an empty tally."""
        self.counts: Counter[str] = Counter()
        """Number of frames by error."""
        self.length = 0
        """Number of bytes of all frames."""
        self.first: dict[str, int | str] = {}
        """Data of the first frame."""
        self.due_ns = 0
        """Earliest time of the next record."""

    def take(self, now_ns: int) -> tuple[int, int, str, dict[str, int | str]]:
        """Return the numbers of frames and bytes, the errors as text, and all as data.

        Then reset.
        """
        counts, length = self.counts, self.length
        frames = counts.total()
        kinds = next(iter(counts))
        if frames > 1:
            kinds = ", ".join(f"{kind} {count}" for kind, count in counts.most_common())
        data = {**self.first, "frames": frames, "bytes": length, **counts}
        self.counts, self.length, self.first = Counter(), 0, {}
        self.due_ns = now_ns + GATHER_NS
        return frames, length, kinds, data


class HostRecords:
    """Writes a host's records with their times in Unix time."""

    def __init__(self, sink: Sink, unix_offset_ns: int, planner: str, *, bus: bool = False) -> None:
        self._write = sink.write
        self.unix_offset_ns = unix_offset_ns
        """Unix time minus host time, ns; the same for all records of a log."""
        self._planner = planner
        self._planner_state: PlannerState | None = None
        self._bus = bus
        self._link_ns = 0
        self._faults = 0
        self._stop_cause = -1
        self._other_host = False
        self._disturbance: Disturbance | None = None
        self._damaged, self._rejected = Tally(), Tally()
        self._keys = KeyRedactor()
        self.counts: Counter[tuple[str, str]] = Counter()
        """Number of events by source and kind."""

    def event(
        self,
        now_ns: int,
        severity: Severity,
        source: str,
        kind: EventKind,
        text: str,
        **data: float | str | bool,
    ) -> None:
        """Record an event."""
        self.named(now_ns, severity, source, kind, text, data)

    def named(  # noqa: PLR0913, PLR0917 - the parts of an event
        self,
        now_ns: int,
        severity: Severity,
        source: str,
        kind: str,
        text: str,
        data: dict[str, Any],
    ) -> None:
        """Record an event of a source that defines its own kinds of events."""
        log_ns = now_ns + self.unix_offset_ns
        self.counts[source, str(kind)] += 1
        self._write(EventRecord(log_ns, severity, source, kind, text, data))

    def damaged(self, found: Sequence[DamagedFrame], now_ns: int) -> None:
        """Count damaged frames that were received together."""
        tally = self._damaged
        tally.counts.update(event.damage.value for event in found)
        tally.length += sum(event.length for event in found)
        if not tally.first:
            first = found[0]
            tally.first = {"offset": first.offset, "first": first.data[:SHOWN_BYTES].hex()}
        if now_ns >= tally.due_ns:
            self._report_damaged(now_ns)

    def rejected(self, event: Rejected, now_ns: int) -> None:
        """Count an intact frame that the link rejected."""
        if self._bus and event.reason == "direction" and not self._other_host:
            self._other_host = True
            text = "another host sends on this bus, which allows one host; stop the other host"
            self.event(now_ns, Severity.WARNING, "link", EventKind.OTHER_HOST, text)
        tally, frame = self._rejected, event.frame
        tally.counts[event.reason] += 1
        tally.length += len(frame.payload)
        if not tally.first:
            tally.first = {"type": frame.type_id, "first": frame.payload[:SHOWN_BYTES].hex()}
        if now_ns >= tally.due_ns:
            self._report_rejected(now_ns)

    def flush(self, now_ns: int, *, at_once: bool = False) -> None:
        """Record the collected damaged and rejected frames if they are due."""
        if self._damaged.counts and (at_once or now_ns >= self._damaged.due_ns):
            self._report_damaged(now_ns)
        if self._rejected.counts and (at_once or now_ns >= self._rejected.due_ns):
            self._report_rejected(now_ns)

    def _report_damaged(self, now_ns: int) -> None:
        frames, length, kinds, data = self._damaged.take(now_ns)
        parts = "" if frames == 1 else f" in {frames} parts"
        text = f"received {length} bytes{parts} that are not a frame ({kinds})"
        self.event(now_ns, Severity.DEBUG, "link", EventKind.DAMAGED, text, **data)

    def _report_rejected(self, now_ns: int) -> None:
        frames, _, kinds, data = self._rejected.take(now_ns)
        what = "frame" if frames == 1 else f"{frames} frames, the first"
        text = f"{what} of type {data['type']:#04x} rejected: {kinds}"
        self.event(now_ns, Severity.DEBUG, "link", EventKind.REJECTED, text, **data)

    def uart(self, data: bytes, now_ns: int, *, outgoing: bool) -> None:
        """Record bytes of a serial port, without keys."""
        data = self._keys.outgoing(data) if outgoing else self._keys.incoming(data)
        self._write(_new(RawBytes, (now_ns + self.unix_offset_ns, outgoing, data)))

    def can(self, data: bytes, now_ns: int, *, outgoing: bool) -> None:
        """Record frames of a CAN bus, without keys."""
        log_ns = now_ns + self.unix_offset_ns
        for can_id, length, content in RECORD.iter_unpack(data):
            self._write(RawCan(log_ns, outgoing, can_id, redacted_can(can_id, content[:length])))

    def log_text(self, message: LogText, now_ns: int) -> None:
        """Record a line of the device's log."""
        severity = _LEVELS.get(LogLevel(message.level & 3), Severity.INFO)
        log_ns = now_ns + self.unix_offset_ns
        self._write(LogRecord(log_ns, severity, "device", message.line))

    def status(self, status: Status, now_ns: int) -> None:
        """Record new faults and a new stop cause."""
        faults = status.faults
        if faults != self._faults:
            new = fault_labels(faults & ~self._faults)
            if new:
                self.event(now_ns, Severity.WARNING, "device", EventKind.FAULT, ", ".join(new))
            self._faults = faults
        if status.stop_cause != self._stop_cause:
            self._stop_cause = status.stop_cause
            name = label(StopCause, status.stop_cause)
            self.event(now_ns, Severity.INFO, "safety", EventKind.LATCH, f"stop cause: {name}")

    def link(self, wire: WireStatistics, now_ns: int) -> None:
        """Record the link statistics every :data:`LINK_PERIOD_NS`."""
        if now_ns >= self._link_ns:
            self._link_ns = now_ns + LINK_PERIOD_NS
            log_ns = now_ns + self.unix_offset_ns
            text = "rate, loss, order and age of each message; round-trip time"
            self._write(
                EventRecord(
                    log_ns, Severity.DEBUG, "link", EventKind.STATISTICS, text, wire.to_dict()
                )
            )

    def again(self, event: SessionReady, now_ns: int) -> None:
        """Record the return of a lost device: same boot, new boot, or new schema."""
        hello = event.hello
        if event.rebooted:
            cause = label(ResetCause, hello.reset_cause)
            text = f"the device rebooted while it was lost (cause: {cause})"
            self.event(
                now_ns, Severity.WARNING, "session", EventKind.NEW_BOOT, text, reset_cause=cause
            )
        else:
            text = "the device is back without a reboot"
            self.event(now_ns, Severity.INFO, "session", EventKind.SAME_BOOT, text)
        if event.other_schema:
            text = f"the device is back with another schema ({hello.catalogue_hash:08x})"
            self.event(now_ns, Severity.WARNING, "session", EventKind.NEW_SCHEMA, text)

    def asking(self, now_ns: int) -> None:
        """Record that the run waits for the operator after a loss."""
        within = f"within {LOST_TIMEOUT_S:g} s"
        text = f"check the robot, then press r to continue or s to end the run ({within})"
        self.event(now_ns, Severity.WARNING, "session", EventKind.ASKING, text)

    def identity(self, event: SessionReady, now_ns: int) -> None:
        """Record the connected device."""
        hello = event.hello
        self._write(
            IdentityRecord(
                now_ns + self.unix_offset_ns,
                event.node,
                hello.uid,
                hello.boot_id,
                hello.session_id,
                label(ResetCause, hello.reset_cause),
                f"{hello.name} {hello.version_major}.{hello.version_minor}.{hello.version_patch}",
                hello.catalogue_hash,
            )
        )

    def command(self, command: VelocityCommand, target: VelocityCommand, now_ns: int) -> None:
        """Record a velocity setpoint and its target before smoothing."""
        self._write(_new(CommandRecord, (now_ns + self.unix_offset_ns, *command, *target)))

    def pose(self, pose: Pose2, estimator: PoseEstimator, now_ns: int) -> None:
        """Record the estimate of a control step."""
        (xx, xy, xt), (yx, yy, yt), (tx, ty, tt) = estimator.covariance
        self._write(
            _new(
                PoseRecord,
                (
                    now_ns + self.unix_offset_ns,
                    pose,
                    estimator.v_m_s,
                    estimator.yaw_rate_rad_s,
                    (xx, xy, xt, yx, yy, yt, tx, ty, tt),
                    estimator.gyro_bias_rad_s,
                    estimator.wheel_scale,
                ),
            )
        )

    def disturbances(self, found: Sequence[Disturbance], now_ns: int) -> None:
        """Record the disturbances that the estimator found since the last call."""
        last, self._disturbance = self._disturbance, found[-1] if found else self._disturbance
        fresh = list(takewhile(lambda each: each is not last, reversed(found)))
        for each in reversed(fresh):
            kind, text = each.kind.value, _FELT[each.kind].format(each.size)
            data = {"size": round(each.size, 3)}
            self.named(now_ns, Severity.INFO, "estimator", kind, text, data)

    def plan(self, runner: Runner, now_ns: int) -> None:
        """Record the planner's events since the last call, and its state if it changed."""
        for decision in runner.drain_events():
            what = decision.kind, decision.reason, decision.data
            self.named(now_ns, Severity.INFO, "planner", *what)
        state, known = runner.state, self._planner_state
        if state is not known and state != known:
            self._planner_state = state
            self._write(PlannerRecord(now_ns + self.unix_offset_ns, self._planner, state))

    def swept(self, swept: SweptMap, now_ns: int) -> None:
        """Record the map of the swept floor."""
        grid = swept.to_occupancy()
        self._write(
            CoverageRecord(
                now_ns + self.unix_offset_ns,
                grid.cells,
                grid.origin_x_m,
                grid.origin_y_m,
                grid.resolution_m,
            )
        )

    def clock(self, sync: TimeSync, hello: Hello, now_ns: int) -> None:
        """Record the clock fit if there is one."""
        fit = sync.fit
        if fit is None:
            return
        offset_ns = self.unix_offset_ns
        self._write(
            ClockRecord(
                now_ns + offset_ns,
                round(fit.host_ns) + offset_ns - fit.device_us * 1000,
                fit.drift * 1e6,
                round(fit.bound_ns),
                sync.round_trip_ns,
                sync.samples,
                hello.boot_id,
            )
        )
