"""Parts of :class:`bridge.api.robot.Robot`: newest messages, manual driving, events, planner."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from bridge.coverage.planner import PlannerEvent
from bridge.coverage.planner import PlannerState as RunnerState
from bridge.errors import BridgeError, StoppedForSafetyError
from bridge.io import clock
from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.session.records import EventRecord, IdentityRecord, Severity
from protocol.messages.host import SetMode
from protocol.messages.values import Mode, OnboardPlanner, PlannerAction, StopCause, label

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.record.sink import Sink
    from bridge.run.client import DeviceClient
    from bridge.run.snapshot import StateSnapshot
    from bridge.session.records import Record
    from protocol.messages.device import PlannerState, Status
    from protocol.schema.message import Message

SETPOINT_TIMEOUT_S = 0.5
"""Time after which a velocity that is not repeated expires, s."""
EVENTS_KEPT = 1000
"""Maximum number of events that are stored for :meth:`EventTap.take`."""
_SHARED_EVENTS = 20
"""Number of newest events that the dashboard of another process receives."""
T = TypeVar("T", bound="Message")


class Latest(Generic[T]):
    """Newest message of one type."""

    def __init__(self, kind: type[T], state: Callable[[], StateSnapshot]) -> None:
        self._kind = kind
        self._state = state

    @property
    def latest(self) -> T | None:
        """The message; None before the first of this session."""
        value = getattr(self._state(), self._kind.__name__.lower())
        return value if isinstance(value, self._kind) else None

    @property
    def age_s(self) -> float | None:
        """Age of the message's sample, s; None before the first of this session."""
        at_s = self._state().arrived_s.get(self._kind)
        return None if at_s is None else clock.now() / 1e9 - at_s

    def __repr__(self) -> str:
        """Return the message in SI units and its age."""
        age_s = self.age_s
        name = self._kind.__name__.lower()
        return f"<{name}: nothing yet>" if age_s is None else f"<{self.latest}, {age_s:.2f} s old>"


class ManualDrive:
    """Runner that follows the last velocity until it expires."""

    finished = False
    finish_reason = None
    turns = 0
    lane_length_m = 0.0
    state = RunnerState("manual")

    def __init__(self) -> None:
        self._command: tuple[float, VelocityCommand] | None = None
        self.target = HALT

    def drive(self, command: VelocityCommand, now_s: float) -> None:
        """Follow ``command`` from the next control step on; ``now_s`` is the present time."""
        self._command = (now_s, command)

    def step(self, obs: Observation) -> VelocityCommand:
        """Return the velocity setpoint of one control step."""
        newest = self._command
        if newest is None:
            self.target = HALT
            return HALT
        since_s, command = newest
        if obs.time_s - since_s > SETPOINT_TIMEOUT_S:
            self._command = None
            self.target = HALT
            return HALT
        self.target = command
        return command

    def drain_events(self) -> list[PlannerEvent]:
        """Return no events."""
        return []


class EventTap:
    """Passes every record on and stores the newest events."""

    def __init__(self, sink: Sink) -> None:
        self._sinks: tuple[Sink, ...] = (sink,)
        """Sinks that receive every record. The tuple is replaced, never changed, because the loop's
        thread iterates over it."""
        self._events: deque[EventRecord] = deque(maxlen=EVENTS_KEPT)
        self.newest_identity: IdentityRecord | None = None
        """The session's device, for a log that starts later."""
        self._first_ns: int | None = None
        self._lines: deque[tuple[int, EventRecord]] = deque(maxlen=_SHARED_EVENTS)
        """The newest events with their time since the first record, ns."""

    def attach(self, sink: Sink) -> None:
        """Pass every record to this sink too."""
        self._sinks = (*self._sinks, sink)

    def detach(self, sink: Sink) -> None:
        """Pass no more records to this sink."""
        self._sinks = tuple(each for each in self._sinks if each is not sink)

    def write(self, record: Record) -> None:
        """Handle one record."""
        for sink in self._sinks:
            sink.write(record)
        if self._first_ns is None:
            self._first_ns = record.log_ns
        if isinstance(record, EventRecord):
            self._events.append(record)
            if record.severity is not Severity.DEBUG:
                self._lines.append((record.log_ns - self._first_ns, record))
        elif isinstance(record, IdentityRecord):
            self.newest_identity = record

    def close(self, summary: object = None) -> None:
        """Do nothing: the creator of a sink closes it."""

    def about(self) -> dict[str, Any]:
        """Return the data that another process shows about a program's session, for JSON."""
        return {}

    def news(self) -> dict[str, Any]:
        """Return the newest events as lines, for JSON."""
        lines = [
            [event.severity.value, f"{since_ns / 1e9:8.2f}  {event.source}: {event.text}"]
            for since_ns, event in list(self._lines)
        ]
        return {"events": lines, "coverage": None}

    def take(self) -> list[EventRecord]:
        """Return and remove the events, at most :data:`EVENTS_KEPT`."""
        events: list[EventRecord] = []
        while self._events:
            events.append(self._events.popleft())
        return events


class Drivable(Protocol):
    """Interface of a robot for :class:`OwnPlanner`."""

    client: DeviceClient

    @property
    def state(self) -> StateSnapshot:
        """Newest messages."""

    def wait_for_link(self) -> None:
        """Wait until the link is measured; raise an error if it is too slow for motion."""

    def wait_for_status(self) -> Status:
        """Wait for the first status; raise an error if none arrives."""


class OwnPlanner:
    """The device's own planner. Only ``sweepctl connect --supervise`` supervises it.

    Every method raises :class:`CommandRejectedError` if the device rejects the command, and
    :class:`DeviceLostError` if the device does not answer.
    """

    def __init__(self, robot: Drivable) -> None:
        self._robot = robot

    def __repr__(self) -> str:
        """Return the newest state in SI units."""
        return f"<planner of the device: {self.latest or 'nothing yet'}>"

    @property
    def latest(self) -> PlannerState | None:
        """Newest planner state; None before the first of this session."""
        return self._robot.state.planner

    def start(self, planner: str = "recovery") -> None:
        """Start a planner by name. The robot stands still for 2.5 s and then moves.

        It clears the stop of a clean end. It does not clear a safety stop; call
        :meth:`Robot.clear_stop` first.

        Raises:
            BridgeError: unknown planner, or no status received.
            StoppedForSafetyError: a safety stop is latched, or the link is too slow.

        """
        number = planner_number(planner)
        robot = self._robot
        robot.wait_for_link()
        status = robot.wait_for_status()
        if status.stop_cause not in {StopCause.NONE, StopCause.SESSION_END}:
            name = label(StopCause, status.stop_cause)
            raise StoppedForSafetyError(
                f"the robot has a latched stop (cause: {name}); check that it is safe, then call "
                "clear_stop()"
            )
        if status.stop_cause == StopCause.SESSION_END:
            robot.client.clear_stop()
        robot.client.command(SetMode, Mode.ONBOARD)
        robot.client.planner(PlannerAction.START, number)

    def pause(self) -> None:
        """Pause the plan; the robot stands still."""
        self._robot.client.planner(PlannerAction.PAUSE)

    def resume(self) -> None:
        """Continue the paused plan."""
        self._robot.client.planner(PlannerAction.RESUME)

    def abort(self) -> None:
        """End the plan."""
        self._robot.client.planner(PlannerAction.ABORT)


def planner_number(name: str) -> OnboardPlanner:
    """Return the device's number of a planner.

    Raises:
        BridgeError: unknown planner.

    """
    try:
        return OnboardPlanner[name.upper().replace("-", "_")]
    except (AttributeError, KeyError):  # not a string, or unknown
        names = ", ".join(p.name.lower().replace("_", "-") for p in OnboardPlanner)
        raise BridgeError(f"unknown planner {name!r}; use one of {names}") from None
