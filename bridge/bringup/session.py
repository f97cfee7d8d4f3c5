"""A session with one device for bring-up: requests, measurements and small motions.

Sans-I/O: a :class:`bridge.bringup.port.BringupPort` transfers bytes and returns the time. So the
same procedure runs on a port and, in virtual time, with the emulated device. Time passes only
during calls of the port. The session has one thread. It has no planner, log or estimate, unlike
:class:`bridge.run.host.Host`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Self, TypeVar, cast

from bridge.bringup.port import InterruptedByPersonError
from bridge.errors import (
    BridgeError,
    DeviceLostError,
    IncompatibleError,
    NoDeviceError,
    PortError,
    Remedy,
    SeveralDevicesError,
    StoppedForSafetyError,
)
from bridge.run.client import DeviceClient
from bridge.run.commands import Dialogue
from bridge.session.event_kinds import EventKind
from bridge.session.sample_times import SampleTimes
from bridge.session.session import Session
from bridge.session.states import CommandEnded, Data, Failed, SessionReady, State, StateChanged
from bridge.session.stop_request import stop_request
from protocol.clock import DeviceUs, HostNs, extend_us
from protocol.imu import ImuReader
from protocol.messages.device import Encoders, Hello, LogText, ParameterValue, Status
from protocol.messages.host import ClearStop, SetMode
from protocol.messages.values import LogLevel, Mode, StopCause, label

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from bridge.bringup.port import BringupPort
    from bridge.bringup.recorded import BringupRecords
    from bridge.session.states import SessionEvent
    from protocol.messages.host import Stop
    from protocol.retransmission import Outcome
    from protocol.schema.message import Message

CYCLE_NS = 20_000_000
"""Period of repeated velocities and duties, ns. It is the catalogue's default of 50 Hz."""
TTL_MS = 200
"""Time to live of a repeated velocity or duty, ms: ten periods of repetition."""
CONFIRM_S = 1.0
"""Maximum wait for the confirmation of a stop, s. It is the same as at a run's end."""
ANSWER_S = 8.0
"""Maximum wait for an answer, s. It is longer than six attempts with doubled timeouts and a flash
erase."""
STALE_S = 0.3
"""Age of an encoder reading at which a motion is stopped, s. It is fifteen periods of the
readings."""
_NEWEST_S = 3.0
"""Maximum wait for the first message of a kind, s."""
LINK_S = 4.0
"""Maximum time until the link counts as fast enough for the first motion, s; four pings take 0.4 s.
"""
SILENT_NS = 100_000_000
"""Time without any frame after which the link's speed is not evaluated, ns. It is ten periods of
the fastest stream. The session itself detects a silent device within a second."""
_INCOMPATIBLE = frozenset({EventKind.INCOMPATIBLE, EventKind.VERSION})
"""Failures of a session with a device that answers but is incompatible."""
M = TypeVar("M", bound="Message")
R = TypeVar("R")


class BringupSession:
    """A session with one device. At its end as a context manager, it stops the device."""

    def __init__(  # noqa: PLR0913 - options of a session
        self,
        wire: BringupPort,
        new_session_id: Callable[[], int],
        *,
        node: int | None = None,
        key: bytes | None = None,
        timeout_s: float = 10.0,
        records: BringupRecords | None = None,
    ) -> None:
        """Open a session with the device; nothing moves.

        ``key`` signs motion commands if the device has a key.

        ``records`` receives every record of the session.

        Raises:
            NoDeviceError: no device answered.
            IncompatibleError: the device is incompatible.

        """
        self._wire, self._records = wire, records
        self._new_session_id = new_session_id
        self.session = Session(
            new_session_id, name="sweepctl bringup", node=node, link=wire.link, key=key
        )
        self.commands = Dialogue(self.session)
        self.client = DeviceClient(self)
        """Client for commands to the device. Time passes during each command."""
        self.newest: dict[type[Message], Message] = {}
        self._times = SampleTimes()
        self._imu = ImuReader()
        self._taps: list[tuple[tuple[type[Message], ...], list[tuple[float, Message]]]] = []
        self._duty: tuple[float, float] | None = None
        self._steer: Callable[[], tuple[float, float]] | None = None
        self._stops: list[Outcome] = []
        """Outcomes of the newest stop, and of earlier stops that ended since its start."""
        self._failed: Failed | None = None
        self._unsafe = ""
        """Reason why the robot was stopped or must be stopped; empty: no reason."""
        self._moved = self._interrupted = False
        self._free = False
        """True while no stop should be latched. If a stop is latched in this state, the device
        itself has caused it."""
        self._cause = StopCause.SESSION_END
        """The highest stop cause so far."""
        self._cycle_ns = wire.now()
        self._t_us = DeviceUs(0)
        self._error = ""
        """Text of the newest error in the device's log."""
        self._polled_ns = wire.now()
        if records is not None:
            records.opened(self._polled_ns)
        self.session.open(self._polled_ns)
        if not self._spin(timeout_s, lambda: self.ready):
            wire.close()
            raise self._no_device_error(timeout_s)

    def _no_device_error(self, timeout_s: float) -> BridgeError:
        failed = self._failed
        if failed is None:
            return NoDeviceError(f"no sweeper answered within {timeout_s:g} s")
        if failed.kind is EventKind.SEVERAL:
            error = SeveralDevicesError(failed.text)
            error.remedy = Remedy.NODE
            return error
        kind = IncompatibleError if failed.kind in _INCOMPATIBLE else NoDeviceError
        return kind(failed.text)

    @property
    def ready(self) -> bool:
        """True if the session is ready."""
        return self.session.state is State.READY

    @property
    def now_s(self) -> float:
        """The port's time, s."""
        return self._wire.now() / 1e9

    # ---- time -----------------------------------------------------------------------------

    def run(self, duration_s: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass.

        Return True as soon as ``until`` returns True, False at the end of the time.

        Raises:
            DeviceLostError: the device was lost or has booted.
            StoppedForSafetyError: the device latched a stop by itself, or its encoder stream ended.
            InterruptedByPersonError: see :meth:`interrupt`.

        """
        held = self._spin(duration_s, until)
        self._check()
        return held

    def interrupt(self) -> None:
        """End the procedure in the next pass of the loop. Called from a signal handler."""
        self._interrupted = True

    def _spin(self, duration_s: float, until: Callable[[], bool]) -> bool:
        wire, session = self._wire, self.session
        end_ns = wire.now() + round(duration_s * 1e9)
        while not until():
            now_ns = wire.now()
            if now_ns >= end_ns or self._interrupted or self._failed or self._unsafe:
                return False
            if now_ns >= self._cycle_ns:
                self._cycle_ns = HostNs(max(self._cycle_ns + CYCLE_NS, now_ns))
                self._cycle(now_ns)
                if not self._well(now_ns):
                    return False
            due_ns = session.next_deadline() or end_ns
            until_ns = HostNs(min(end_ns, self._cycle_ns, max(due_ns, now_ns)))
            going = session.data_to_send()
            if going and self._records is not None:  # at the time when the session created it
                self._records.passed(going, self._polled_ns, outgoing=True)
            came = wire.turn(going, until_ns)
            now_ns = wire.now()
            if came and self._records is not None:
                self._records.passed(came, now_ns, outgoing=False)
            self._digest(session.receive(came, now_ns), now_ns)
            self._digest(session.poll(now_ns), now_ns)
            self._polled_ns = now_ns
        return True

    def _cycle(self, now_ns: HostNs) -> None:
        if not self.ready:
            return
        if self._duty is not None:
            self.session.duty(*self._duty, TTL_MS, now_ns)
        elif self._steer is not None:
            self.session.setpoint(*self._steer(), TTL_MS, now_ns)

    def _well(self, now_ns: HostNs) -> bool:
        link = self.session.round_trip.trouble(now_ns) if self._free and self.ready else None
        if link is not None and now_ns - self.session.last_frame_ns <= SILENT_NS:
            self._cause = StopCause.LINK
            self._unsafe = link.text
            return False
        moving = self._duty is not None or self._steer is not None
        now_s = now_ns / 1e9
        if moving and now_s - self._times.taken_s.get(Encoders, now_s) > STALE_S:
            self._unsafe = "no fresh encoder readings from the device any more"
            return False
        return True

    def _check(self) -> None:
        if self._interrupted:
            raise InterruptedByPersonError("interrupted")
        if self._unsafe:
            raise StoppedForSafetyError(self._unsafe)
        if self._failed is not None:
            raise DeviceLostError(self._failed.text)

    # ---- news -----------------------------------------------------------------------------

    def record_line(self, text: str) -> None:
        """Record a line that the person reads."""
        if self._records is not None:
            self._records.record_line(text)

    def _digest(self, events: list[SessionEvent], now_ns: HostNs) -> None:
        if events and self._records is not None:
            self._records.received(events, now_ns)
        for event in events:
            match event:
                case Data():
                    self._take(event, now_ns)
                case CommandEnded():
                    if not self.commands.ended(event.outcome):
                        self._stops.append(event.outcome)
                case Failed():
                    self._failed = event
                case StateChanged() if event.old is State.READY and event.new is not State.CLOSED:
                    self._failed = Failed(EventKind.LOST, f"the device was lost: {event.why}")
                    self._times.forget()
                    self.commands.lost()
                case SessionReady():
                    self.newest[Hello] = event.hello
                case _:
                    pass

    def _take(self, event: Data, now_ns: HostNs) -> None:
        message, t_us = self._imu.take(event.received.message), event.received.frame.t_us
        self._t_us = extend_us(self._t_us, t_us)
        if message is None:
            return
        kind = type(message)
        self.newest[kind] = message
        self._times.take(kind, self._t_us, now_ns / 1e9)
        for kinds, kept in self._taps:
            if kind in kinds:
                kept.append((self._t_us / 1e6, message))
        if isinstance(message, ParameterValue):
            self.commands.parameter(message)
        elif isinstance(message, LogText):
            if message.level == LogLevel.ERROR:
                self._error = message.line
        elif isinstance(message, Status) and self._free and message.stop_cause != StopCause.NONE:
            cause = label(StopCause, message.stop_cause)
            why = f": {self._error}" if self._error else ""
            self._free = False
            self._unsafe = f"the device latched a stop (cause: {cause}){why}"

    def latest(self, kind: type[M]) -> M | None:
        """The newest message of a kind."""
        return found if isinstance(found := self.newest.get(kind), kind) else None

    def await_newest(self, kind: type[M]) -> M:
        """Return the newest message of a kind; wait if there is none yet.

        Raises:
            DeviceLostError: no such message arrived.

        """
        self.run(_NEWEST_S, lambda: kind in self.newest)
        found = self.latest(kind)
        if found is None:
            raise DeviceLostError(f"no {kind.__name__.lower()} data from the device")
        return found

    def collect(self, kind: type[M], duration_s: float) -> list[tuple[float, M]]:
        """Return the messages of one kind during ``duration_s``, each with the device time (s)."""
        kept: list[tuple[float, Message]] = []
        tap = ((kind,), kept)
        self._taps.append(tap)
        try:
            self.run(duration_s)
        finally:
            self._taps.remove(tap)
        return [(t_s, message) for t_s, message in kept if isinstance(message, kind)]

    def watch(self, *kinds: type[Message]) -> list[tuple[float, Message]]:
        """Return a list that collects these messages from now on, until :meth:`unwatch`."""
        kept: list[tuple[float, Message]] = []
        self._taps.append((kinds, kept))
        return kept

    def unwatch(self, kept: list[tuple[float, Message]]) -> None:
        """Stop collecting into a list."""
        self._taps = [tap for tap in self._taps if tap[1] is not kept]

    # ---- commands -------------------------------------------------------------------------

    @property
    def status(self) -> Status | None:
        """The device's newest status."""
        return self.latest(Status)

    def now(self) -> HostNs:
        """Return the port's time."""
        return self._wire.now()

    def call(self, action: Callable[[], R]) -> R:
        """Run ``action`` directly, because there is no other thread."""
        return action()

    def wait(self, begin: Callable[[Callable[[], None]], None], what: str) -> None:
        """Run ``begin``, and let time pass until its argument has been called.

        Raises:
            DeviceLostError: the argument was not called in time, or the device was lost.

        """
        answered: list[bool] = []
        begin(lambda: answered.append(True))
        if not self.run(ANSWER_S, lambda: bool(answered)):
            raise DeviceLostError(f"the device did not answer {what}")

    def enable(self, mode: Mode, *, clear_stop: bool = False) -> None:
        """Enable motion in this mode.

        A latched stop is cleared only if its cause is a clean session end, or with ``clear_stop``.

        Raises:
            StoppedForSafetyError: another stop is latched, or the link is too slow.
            CommandRejectedError: the device rejected the command.

        """
        trip, now = self.session.round_trip, self._wire.now
        if not self.run(LINK_S, lambda: trip.trouble(now()) is None):
            link = trip.trouble(now())
            raise StoppedForSafetyError("the link was lost" if link is None else link.text)
        status = self.await_newest(Status)
        if status.stop_cause not in {StopCause.NONE, StopCause.SESSION_END} and not clear_stop:
            cause = label(StopCause, status.stop_cause)
            held = StoppedForSafetyError(
                f"the robot holds a stop (cause: {cause}); see that it is safe"
            )
            held.remedy = Remedy.CLEAR_STOP
            raise held
        self._moved = True
        if status.stop_cause != StopCause.NONE:
            self.client.command(ClearStop, status.stop_cause)
        self.client.command(SetMode, mode, what=f"{label(Mode, mode)} mode")
        self.run(1.0, lambda: self._in_mode(mode))
        self._free = True

    def _in_mode(self, mode: Mode) -> bool:
        status = self.latest(Status)
        return status is not None and status.mode == mode and status.stop_cause == StopCause.NONE

    def duties(self, left: float, right: float) -> None:
        """Repeat these motor duties (-1..1, limited by the device) while time passes."""
        self._steer = None
        self._duty = (left, right)

    def steer(self, wanted: Callable[[], tuple[float, float]]) -> None:
        """Repeatedly send speed (m/s) and yaw rate (rad/s) from ``wanted`` while time passes."""
        self._duty = None
        self._steer = wanted

    def stop_sending(self) -> None:
        """Stop sending duties and velocities. The device then decelerates to standstill."""
        self._duty = self._steer = None

    def stop(self, cause: StopCause = StopCause.SESSION_END) -> None:
        """Latch a stop, and wait until the device has confirmed it.

        If the session is lost or receives no confirmation, the stop is sent without a session.

        Raises:
            DeviceLostError: the device has not confirmed it.
            PortError: the port is gone.

        """
        self.stop_sending()
        self._free = False
        self._interrupted = False
        self._failed, self._unsafe = None, ""
        cause = max(cause, self._cause)
        if not (self.ready and self._stop_in_session(cause)) and not self._stop_without(cause):
            raise DeviceLostError("the device did not confirm the stop; see that the robot stands")

    def _stop_in_session(self, cause: StopCause) -> bool:
        self.newest.pop(Status, None)  # an older status is not valid any more
        try:
            self._stops.clear()
            command_id = self.session.stop(cause, self._wire.now())
            self._spin(CONFIRM_S, lambda: self._ending_of(command_id) is not None)
        except PortError:
            raise
        except Exception:  # noqa: BLE001 - after any failure in the session the robot must stop
            return False
        outcome = self._ending_of(command_id)
        return outcome is not None and outcome.accepted

    def _ending_of(self, command_id: int) -> Outcome | None:
        """Return the outcome of the stop with this id; None: it has not ended yet."""
        stops = ((cast("Stop", each.message), each) for each in self._stops)
        return next((each for stop, each in stops if stop.command_id == command_id), None)

    def _stop_without(self, cause: StopCause) -> bool:
        """Repeat a stop that needs no session. Return True if the device has confirmed it."""
        wire = self._wire
        stop = stop_request(wire.link, cause, self._new_session_id(), self.session.node)
        end_ns = wire.now() + round(CONFIRM_S * 1e9)
        while stop.confirmed_by is None and wire.now() < end_ns:
            going = stop.data_to_send(wire.now())
            came = wire.turn(going, HostNs(min(end_ns, stop.next_deadline())))
            stop.receive(came, wire.now())
        return stop.confirmed_by is not None

    # ---- its end --------------------------------------------------------------------------

    def close(self) -> None:
        """Stop the robot if it may have moved, and close the port.

        Raises:
            DeviceLostError: the device has not confirmed the stop.
            PortError: the port is gone.

        """
        try:
            if self._moved:
                self._moved = False
                self.stop()
        finally:
            self.session.close()
            self._wire.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except PortError as failed:
            if isinstance(error, BridgeError) and str(error) != str(failed):
                raise DeviceLostError(f"{error}; {failed}") from error
            raise
