"""Notices of a run: events that can start other programs (option ``--on``)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from bridge.errors import ExitStatus
from bridge.motion.geometry import Pose2
from bridge.session.event_kinds import EventKind
from bridge.session.records import DeviceMessage, EventRecord
from bridge.supervise import RuleInputs
from bridge.supervise.measured import Measured
from bridge.supervise.rules.electric import Battery
from protocol.messages.device import Power, Status
from protocol.messages.values import StopCause, label

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bridge.motion.robot_model import RobotModel
    from bridge.record.sink import Sink
    from bridge.run.ending import Ending
    from bridge.session.records import Record
    from bridge.supervise.settings import BatteryRule


class NoticeKind(StrEnum):
    """Kind of a notice. Its name and meaning are the same in every version."""

    FINISHED = "finished"
    """The run has ended, whatever its outcome, and its log is complete."""
    STOPPED_FOR_SAFETY = "stopped-for-safety"
    """A stop is latched with a cause other than `session_end`, or the run ends with status 5."""
    BATTERY_LOW = "battery-low"
    """The battery's voltage is low, by the supervision rule `battery`; at most once per run."""
    DEVICE_LOST = "device-lost"
    """The device is silent or its port is gone; the run searches for it again."""


@dataclass(frozen=True, slots=True)
class Notice:
    """An event for other programs. Fields that do not apply to its kind are None."""

    kind: NoticeKind
    time_ns: int
    """Unix time, ns."""
    text: str
    """Description for people."""
    cause: str | None = None
    """Name of the latched stop cause."""
    battery_v: float | None = None
    """Newest battery voltage, V."""
    exit_status: int | None = None
    """Exit status of the run."""
    summary: Mapping[str, Any] | None = None
    """The run's summary."""

    def to_dict(self) -> dict[str, Any]:
        """Return the notice as plain values for JSON, with the time in Unix seconds."""
        summary = None if self.summary is None else dict(self.summary)
        return {
            "event": self.kind.value,
            "time_unix_s": self.time_ns / 1e9,
            "text": self.text,
            "cause": self.cause,
            "battery_v": self.battery_v,
            "outcome": None if summary is None else summary["outcome"],
            "exit_status": self.exit_status,
            "summary": summary,
        }


class NoticeSink:
    """Sink that passes every record on and derives the notices of the run from them."""

    def __init__(
        self, sink: Sink, model: RobotModel, battery: BatteryRule, notify: Callable[[Notice], None]
    ) -> None:
        """Pass records on to ``sink``.

        Args:
            sink: receives every record.
            model: the robot.
            battery: limits of the battery.
            notify: called with each notice, in the thread that writes the records; it must not
                wait.

        """
        self._sink = sink
        self._notify = notify
        self._battery = Battery(battery)
        self._low_after_ns = round(battery.after_s * 1e9)
        self._measured = Measured(model)
        self._low_since_ns: int | None = None
        self._low_noticed = False
        self._status: Status | None = None
        self._battery_v: float | None = None
        self._stop_cause: int | None = None
        self._stop_noticed = False
        self._lost = False
        self._last_ns = 0

    def write(self, record: Record) -> None:
        """Pass a record on, and emit the notices that follow from it."""
        self._sink.write(record)
        self._last_ns = record[0]
        if isinstance(record, DeviceMessage):
            message = record.message
            if isinstance(message, Status):
                self._status_received(record.log_ns, message)
            elif isinstance(message, Power):
                self._power_received(record.log_ns, message)
        elif isinstance(record, EventRecord) and record.source == "session":
            if record.kind == EventKind.LOST and not self._lost:
                self._lost = True
                self._emit(NoticeKind.DEVICE_LOST, record.log_ns, record.text)
            elif record.kind == EventKind.READY:
                self._lost = False

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Close the sink with the run's summary."""
        self._sink.close(summary)

    def finish(self, ending: Ending, exit_status: int, summary: Mapping[str, Any]) -> None:
        """Emit the notices of the run's end."""
        if exit_status == ExitStatus.STOPPED and not self._stop_noticed:
            cause = label(StopCause, ending.gravity)
            self._emit(NoticeKind.STOPPED_FOR_SAFETY, self._last_ns, ending.reason, cause=cause)
        self._notify(
            Notice(
                NoticeKind.FINISHED,
                self._last_ns,
                ending.reason,
                battery_v=self._battery_v,
                exit_status=exit_status,
                summary=summary,
            )
        )

    def _emit(self, kind: NoticeKind, log_ns: int, text: str, cause: str | None = None) -> None:
        self._notify(Notice(kind, log_ns, text, cause=cause, battery_v=self._battery_v))

    def _status_received(self, log_ns: int, status: Status) -> None:
        self._status = status
        before, self._stop_cause = self._stop_cause, status.stop_cause
        # Ignore a stop that was latched before this run.
        if before is None or status.stop_cause <= max(before, StopCause.SESSION_END):
            return
        self._stop_noticed = True
        cause = label(StopCause, status.stop_cause)
        text = f"the device has latched a stop, cause {cause}"
        self._emit(NoticeKind.STOPPED_FOR_SAFETY, log_ns, text, cause)

    def _power_received(self, log_ns: int, power: Power) -> None:
        self._battery_v = round(power.battery_v, 2)
        if self._low_noticed:
            return
        inputs = RuleInputs(
            log_ns / 1e9, Pose2(0.0, 0.0, 0.0), 0.0, 0.0, power=power, status=self._status
        )
        if not self._battery.holds(inputs, self._measured):
            self._low_since_ns = None
            return
        if self._low_since_ns is None:
            self._low_since_ns = log_ns
        if log_ns - self._low_since_ns >= self._low_after_ns:
            self._low_noticed = True
            self._emit(NoticeKind.BATTERY_LOW, log_ns, self._battery.evidence()[0])
