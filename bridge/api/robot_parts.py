"""Parts of :class:`bridge.api.robot.Robot`: newest messages, driving by hand, events, planner."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from bridge.coverage.planner import PlannerEvent
from bridge.coverage.planner import PlannerState as RunnerState
from bridge.errors import BridgeError, StoppedForSafetyError
from bridge.io import clock
from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.session.records import EventRecord, IdentityRecord
from protocol.messages import PlannerState, SetMode
from protocol.values import Mode, OnboardPlanner, PlannerAction, StopCause, label

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.record.sink import Sink
    from bridge.run.client import DeviceClient
    from bridge.run.snapshot import StateSnapshot
    from bridge.session.records import Record
    from protocol.messages import Status
    from protocol.schema.message import Message

SETPOINT_TIMEOUT_S = 0.5
EVENTS_KEPT = 1000
T = TypeVar("T", bound="Message")


class Latest(Generic[T]):
    """The newest message of one kind."""

    def __init__(self, kind: type[T], state: Callable[[], StateSnapshot]) -> None:
        self._kind = kind
        self._state = state

    @property
    def latest(self) -> T | None:
        """The message, or None before the first of this session."""
        value = getattr(self._state(), self._kind.__name__.lower())
        return value if isinstance(value, self._kind) else None

    @property
    def age_s(self) -> float | None:
        """Seconds since its sample was taken; None before the first of this session."""
        at_s = self._state().arrived_s.get(self._kind)
        return None if at_s is None else clock.now() / 1e9 - at_s

    def __repr__(self) -> str:
        """The message in SI units, and its age."""
        age_s = self.age_s
        name = self._kind.__name__.lower()
        return f"<{name}: nothing yet>" if age_s is None else f"<{self.latest}, {age_s:.2f} s old>"


class ManualDrive:
    """A runner that follows what it was last told, for half a second."""

    finished = False
    finish_reason = None
    turns = 0
    lane_length_m = 0.0
    state = RunnerState("manual")

    def __init__(self) -> None:
        self._command: tuple[float, VelocityCommand] | None = None
        self.target = HALT

    def drive(self, command: VelocityCommand) -> None:
        """Follow this from the next control step on."""
        self._command = (-1.0, command)

    def step(self, obs: Observation) -> VelocityCommand:
        """The velocity for this control step."""
        newest = self._command
        if newest is None:
            self.target = HALT
            return HALT
        since_s, command = newest
        if since_s < 0.0:
            self._command = (obs.time_s, command)
        elif obs.time_s - since_s > SETPOINT_TIMEOUT_S:
            self._command = None
            self.target = HALT
            return HALT
        self.target = command
        return command

    def drain_events(self) -> list[PlannerEvent]:
        """A person's decisions are not explained."""
        return []


class EventTap:
    """Passes every record on, and keeps the newest events for whoever asks."""

    def __init__(self, sink: Sink) -> None:
        self._sinks: tuple[Sink, ...] = (sink,)
        """Replaced as a whole: the loop's thread goes through them."""
        self._events: deque[EventRecord] = deque(maxlen=EVENTS_KEPT)
        self.newest_identity: IdentityRecord | None = None
        """The device of the session, for a log that begins later."""

    def attach(self, sink: Sink) -> None:
        """Pass every record on to this one too."""
        self._sinks = (*self._sinks, sink)

    def detach(self, sink: Sink) -> None:
        """Pass no more records on to it."""
        self._sinks = tuple(each for each in self._sinks if each is not sink)

    def write(self, record: Record) -> None:
        """Take one record."""
        for sink in self._sinks:
            sink.write(record)
        if isinstance(record, EventRecord):
            self._events.append(record)
        elif isinstance(record, IdentityRecord):
            self.newest_identity = record

    def close(self, summary: object = None) -> None:
        """The sink is closed by whoever opened it."""

    def take(self) -> list[EventRecord]:
        """Fetch and forget the events so far, the newest thousand of them."""
        events: list[EventRecord] = []
        while self._events:
            events.append(self._events.popleft())
        return events


class Drivable(Protocol):
    """A robot that a program drives, as its own planner needs it."""

    client: DeviceClient

    @property
    def state(self) -> StateSnapshot:
        """The newest messages."""

    def wait_for_link(self) -> None:
        """Wait until the link is measured; raises where it is too slow to drive over."""

    def wait_for_status(self) -> Status:
        """Wait for the first status; raises where none comes."""


class OwnPlanner:
    """The device's own planner; nothing here watches it (``sweepctl connect --supervise`` does).

    Every method raises :class:`CommandRejectedError` where the device refuses and
    :class:`DeviceLostError` where it does not answer.
    """

    def __init__(self, robot: Drivable) -> None:
        self._robot = robot

    @property
    def latest(self) -> PlannerState | None:
        """What the planner last told; None before the first of this session."""
        return self._robot.state.planner

    def start(self, planner: str = "recovery") -> None:
        """Start one by name: it rests 2.5 s, and the robot moves.

        A stop that was latched for safety is not cleared: :meth:`Robot.clear_stop` does that.

        Raises:
            BridgeError: no planner has this name, or the status is not known yet.
            StoppedForSafetyError: such a stop is latched, or the link is too slow.

        """
        number = planner_number(planner)
        robot = self._robot
        robot.wait_for_link()
        status = robot.wait_for_status()
        if status.stop_cause not in {StopCause.NONE, StopCause.SESSION_END}:
            name = label(StopCause, status.stop_cause)
            raise StoppedForSafetyError(
                f"the robot holds a stop (cause: {name}); see that it is safe, then call "
                "clear_stop()"
            )
        if status.stop_cause == StopCause.SESSION_END:
            robot.client.clear_stop()
        robot.client.command(SetMode, Mode.ONBOARD)
        robot.client.planner(PlannerAction.START, number)

    def pause(self) -> None:
        """Hold still, the plan kept."""
        self._robot.client.planner(PlannerAction.PAUSE)

    def resume(self) -> None:
        """Go on where it was held."""
        self._robot.client.planner(PlannerAction.RESUME)

    def abort(self) -> None:
        """End the plan."""
        self._robot.client.planner(PlannerAction.ABORT)


def planner_number(name: str) -> OnboardPlanner:
    """The wire's number of a planner's name.

    Raises:
        BridgeError: no planner has this name.

    """
    try:
        return OnboardPlanner[name.upper().replace("-", "_")]
    except (AttributeError, KeyError):  # no text, or no planner's name
        names = ", ".join(p.name.lower().replace("_", "-") for p in OnboardPlanner)
        raise BridgeError(f"{name!r} is no planner; there are {names}") from None
