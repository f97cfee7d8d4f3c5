"""A robot as an object: what the newest data says, and commands, from ordinary code.

::

    with bridge.open("/dev/ttyUSB0") as robot:
        print(robot.imu.latest, robot.pose)
        robot.enable()
        robot.drive(0.1, 0.0)

A thread of its own runs the session; nothing moves before :meth:`Robot.enable`, and a
velocity that is not repeated within half a second is let go. Commands are acknowledged by the
device: a method returns when the device has said yes, and raises what it refused.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from bridge.api import arguments
from bridge.api.exchange import LoopExchange
from bridge.api.owner_service import OwnerService
from bridge.api.pump import Pump, Result
from bridge.api.recording import Recording
from bridge.api.robot_parts import SETPOINT_TIMEOUT_S, EventTap, Latest, ManualDrive, OwnPlanner
from bridge.config import parse_robot, to_toml
from bridge.errors import (
    BridgeError,
    DeviceLostError,
    DisagreementError,
    NoDeviceError,
    SeveralDevicesError,
    StoppedForSafetyError,
)
from bridge.io import clock
from bridge.io.identifiers import new_session_id
from bridge.io.owner_socket import OwnerSocket
from bridge.io.ports import DEFAULT_BAUD, check_local, link_of
from bridge.io.reopening import Opener, PortOptions
from bridge.io.stopping import stop_device
from bridge.motion.geometry import Pose2
from bridge.motion.observation import VelocityCommand
from bridge.motion.robot_model import RobotModel
from bridge.record.errors import LogError
from bridge.record.sink import NullSink
from bridge.run.build import build_run
from bridge.run.client import DeviceClient
from bridge.run.ending import Ending, cannot_move
from bridge.run.mission import Phase
from bridge.run.options import HostOptions
from bridge.run.snapshot import MissionSnapshot, StateSnapshot, snapshot
from bridge.run.summary import run_summary
from bridge.session.records import RunInfo
from bridge.session.states import State
from protocol.authentication import KEY_SIZE, key_words
from protocol.messages import Encoders, Imu, Power, Range, SetKey, Status
from protocol.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.record.sink import Sink
    from bridge.session.parameters import Parameter
    from bridge.session.records import EventRecord

__all__ = ["SETPOINT_TIMEOUT_S", "Latest", "ManualDrive", "Robot"]

OPEN_TIMEOUT_S = 5.0
ENABLE_TIMEOUT_S = 10.0
STATUS_TIMEOUT_S = 1.0
"""Ten of the device's statuses."""
LINK_TIMEOUT_S = 4.0
"""Time for a slow link to become quick, s; four pings take 0.4 s."""
HUNG_NS = 1_000_000_000
"""Age of the loop's newest turn from which it counts as hung, nanoseconds: four times its
longest wait. The device has stopped by then, for its velocity has expired."""
_POLL_S = 0.02

_UNREADY: dict[int, type[BridgeError]] = {
    kind.exit_status: kind for kind in (DisagreementError, SeveralDevicesError)
}
"""Error of a session that failed, by the status that its run ended with."""


class Robot:
    """One open robot; use it as a context manager.

    A call with an argument of the wrong type or beyond its range raises an
    :class:`bridge.errors.ArgumentError`, before anything is sent or opened.
    """

    @arguments.checked(
        port=arguments.TEXT,
        model=arguments.MODEL | arguments.NONE,
        sink=arguments.SINK | arguments.NONE,
        node=arguments.NODE | arguments.NONE,
        baud=arguments.BITS_PER_S,
        dtr=arguments.FLAG,
        rts=arguments.FLAG,
        bitrate=arguments.BITS_PER_S | arguments.NONE,
        lan=arguments.FLAG,
        key=arguments.KEY | arguments.NONE,
        timeout_s=arguments.SECONDS,
    )
    def __init__(  # noqa: PLR0913 - what a port can be asked for
        self,
        port: str,
        *,
        model: RobotModel | None = None,
        sink: Sink | None = None,
        node: int | None = None,
        baud: int = DEFAULT_BAUD,
        dtr: bool = False,
        rts: bool = False,
        bitrate: int | None = None,
        lan: bool = False,
        key: bytes | None = None,
        timeout_s: float = OPEN_TIMEOUT_S,
    ) -> None:
        """Open the port and agree with the device.

        ``sink`` gets every record of the session; ``node`` chooses one of several devices on
        a bus, ``bitrate`` is the bus's. ``dtr`` and ``rts`` are left inactive unless asked
        for: many boards reset on them. ``key`` (16 bytes) signs what moves the robot, where the
        device has one.

        Raises:
            PortError: the port cannot be opened.
            NoDeviceError: no sweeper answered.
            SeveralDevicesError: several did, and ``node`` was not given.
            DisagreementError: it speaks another protocol.

        """
        self.model = model or RobotModel()
        self._name, self._timeout_s = port, timeout_s
        self._events, self._node, self._key = EventTap(sink or NullSink()), node, key
        self._open = Opener(
            port, PortOptions(baud=baud, dtr=dtr, rts=rts, bitrate=bitrate, lan=lan)
        )
        self._closed = False
        self._offset_ns = clock.unix_offset_ns()
        self._has_sink = sink is not None

        def newest() -> StateSnapshot:
            return self.state

        self._imu, self._encoders = Latest(Imu, newest), Latest(Encoders, newest)
        self._range, self._power = Latest(Range, newest), Latest(Power, newest)
        self._status, self._planner = Latest(Status, newest), OwnPlanner(self)
        self._recordings: list[Recording] = []
        self._begin(Pose2(0.0, 0.0, 0.0))

    def _begin(self, start: Pose2) -> None:
        """Open the port and agree; the robot stands at ``start``."""
        self._drive = ManualDrive()
        options = HostOptions(
            self._offset_ns, "manual", start, self._node, link_of(self._name), self._key
        )
        self.host = build_run(self.model, self._events, options, new_session_id)
        self._mission = self.host.mission
        self._pump = Pump(self.host, self._open(), self._open)
        self.client = DeviceClient(LoopExchange(self.host, self._pump.call))
        self._owner: OwnerSocket | None = None
        with suppress(BridgeError):  # the robot works without other shells
            self._owner = OwnerSocket(self._name, OwnerService(self.host, self._pump))
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)
        self._thread.start()
        try:
            ready = self._until(
                lambda: self._pump.snapshot.session.state is State.READY, self._timeout_s
            )
        except BaseException:  # Ctrl-C for one: the port is given back
            self._end(Ending("stopped", "interrupted while it was opened", 0))
            raise
        if not ready:
            ending = self._seen.ending
            self._end(Ending("stopped", "no agreement", 0))
            text = ending.reason if ending else f"no agreement within {self._timeout_s:g} s"
            status = ending.exit_status if ending else NoDeviceError.exit_status
            error = _UNREADY.get(status, NoDeviceError)(f"{self._name}: {text}")
            error.remedy = ending.remedy if ending else None
            raise error

    def _run(self) -> None:
        try:
            self._pump.run()
        finally:
            if self._owner is not None:
                self._owner.close()

    # ---- what is so -----------------------------------------------------------------------

    @property
    def imu(self) -> Latest[Imu]:
        """Newest reading of the inertial sensor, 100 a second.

        ``robot.imu.latest`` has ``accel_x_m_s2`` (y, z), ``gyro_x_rad_s`` (y, z) and
        ``temperature_deg_c``; it is None before the first.
        """
        return self._imu

    @property
    def encoders(self) -> Latest[Encoders]:
        """Newest wheel counts, 50 a second: ``left`` and ``right``, 0 to 65535, which wrap."""
        return self._encoders

    @property
    def range(self) -> Latest[Range]:
        """Newest ranges and contacts, 20 a second.

        ``robot.range.latest`` has ``ultrasonic_m``, ``infrared_left_m`` and ``infrared_right_m``
        (None: nothing in range) and ``contacts``, the bits of ``protocol.values.Contact``.
        """
        return self._range

    @property
    def power(self) -> Latest[Power]:
        """Newest ``battery_v``, ``logic_v``, ``motor_left_a`` and ``motor_right_a``, 5 a second."""
        return self._power

    @property
    def status(self) -> Latest[Status]:
        """Newest ``mode``, ``stop_cause``, ``faults`` and ``load``, 10 a second."""
        return self._status

    @property
    def planner(self) -> OwnPlanner:
        """The device's own planner: start, pause, resume, abort, and what it reports."""
        return self._planner

    @property
    def pose(self) -> Pose2:
        """Estimated pose, from where the robot stood as it was opened."""
        return self._pump.snapshot.estimator.pose

    @property
    def state(self) -> StateSnapshot:
        """The newest of everything that the device told in this session, with its ages."""
        return self._pump.snapshot.state

    @property
    def session(self) -> State:
        """Where the session stands; commands are answered while it is ``READY``."""
        return self._pump.snapshot.session.state

    @property
    def _seen(self) -> MissionSnapshot:
        """Where the run stands."""
        return self._pump.snapshot.mission

    @property
    def enabled(self) -> bool:
        """True while :meth:`drive` moves the robot; false once the session's loop has ended."""
        return self._seen.phase is Phase.DRIVING and self._thread.is_alive()

    def events(self) -> list[EventRecord]:
        """Fetch and forget what happened since the last call: losses, stops, refusals, faults."""
        return self._events.take()

    @arguments.checked(
        path=arguments.PATH,
        room=arguments.ROOM | arguments.NONE,
        robot_toml=arguments.TEXT | arguments.NONE,
        force=arguments.FLAG,
    )
    def record(
        self,
        path: str | Path,
        *,
        room: FloorPlan | None = None,
        robot_toml: str | None = None,
        force: bool = False,
    ) -> Recording:
        """Record everything from now on, as ``sweepctl connect`` does, into an MCAP file.

        Use it as a context manager, or let :meth:`close` end it: the log is then whole, with its
        summary. A full disk does not stop the robot: ``error`` and ``dropped`` of the recording
        report it, and its ``close`` raises. ``room`` and ``robot_toml`` (a robot file's text; the
        model otherwise) are attached::

            with bridge.open("/dev/ttyUSB0") as robot, robot.record("drive.mcap"):
                robot.enable()

        Raises:
            LogExistsError: the file exists and ``force`` is not set.
            LogWriteError: it cannot be opened or written.
            ConfigError: ``robot_toml`` is no robot file.

        """
        offset_ns = self._log_offset_ns()
        if robot_toml is None:
            model, robot_toml = self.model, to_toml(self.model)
        else:
            model = parse_robot(robot_toml)
        opened_ns = clock.now() + offset_ns
        info = RunInfo(
            self._name,
            "manual",
            None,
            _version(),
            opened_ns,
            offset_ns,
            model,
            robot_toml,
            room,
        )

        def summarise(room_name: str | None, log: str) -> dict[str, Any]:
            found: dict[str, Any] = {}

            def summed() -> None:
                host = self.host
                found.update(
                    run_summary(host, room=room_name, planner="manual", seed=None, log=log)
                )

            try:
                self._in_loop(summed)  # it counts what the loop counts
            except DeviceLostError:
                if not self._thread.is_alive():
                    summed()
            return found

        recording = Recording(Path(path), info, self._events, summarise, force=force)
        self._recordings.append(recording)
        return recording

    def _log_offset_ns(self) -> int:
        """Unix time less the host's clock for a log that begins now.

        The system clock may have been set since the robot was opened. While another log or the
        caller's sink takes records, all keep its offset: within one there is no step.
        """
        if not self._has_sink and all(recording.closed for recording in self._recordings):
            offset_ns = clock.unix_offset_ns()
            with suppress(DeviceLostError):  # no loop, no records
                self._in_loop(lambda: self.host.use_unix_offset(offset_ns))
                self._offset_ns = offset_ns
        return self._offset_ns

    def snapshot(self) -> dict[str, Any]:
        """What is known of the robot now, for JSON."""
        return snapshot(self._pump.snapshot, clock.now() / 1e9)

    @arguments.checked(timeout_s=arguments.SECONDS)
    def wait_for_status(self, timeout_s: float = STATUS_TIMEOUT_S) -> Status:
        """The device's newest status, waited for where none has come yet.

        Raises:
            DeviceLostError: none came.

        """
        self._until(lambda: self._pump.snapshot.state.status is not None, timeout_s)
        status = self._pump.snapshot.state.status
        if status is None:
            raise DeviceLostError("the device does not tell its status")
        return status

    @arguments.checked(timeout_s=arguments.SECONDS)
    def wait_for_link(self, timeout_s: float = LINK_TIMEOUT_S) -> None:
        """Wait until the link is known to be quick enough for motion.

        Raises:
            StoppedForSafetyError: it is too slow, or too few pings are answered.

        """
        if not self._until(lambda: self._seen.link is None, timeout_s):
            link = self._seen.link
            raise StoppedForSafetyError("the link was lost" if link is None else link.text)

    # ---- motion ---------------------------------------------------------------------------

    @arguments.checked(clear_stop=arguments.FLAG)
    def enable(self, *, clear_stop: bool = False) -> None:
        """Ask the device for leave to move; takes about 3 s at rest for the gyro.

        A stop that was latched for safety is cleared only with ``clear_stop``. Where a stop has
        ended the session, the port is opened anew.

        Raises:
            StoppedForSafetyError: such a stop is latched, the link is too slow, or the robot is
                closed.
            CommandRejectedError: the device refused.
            DeviceLostError: it fell silent.
            PortError: the port cannot be opened again, or nothing answers on it.

        """
        self._reopen()
        self._in_loop(lambda: self._mission.start(self._drive, clear_stop=clear_stop))
        self._until(lambda: self.enabled or self._seen.ending is not None, ENABLE_TIMEOUT_S)
        if not self.enabled:
            raise cannot_move(self._seen.ending)

    @arguments.checked(v_m_s=arguments.NUMBER, yaw_rate_rad_s=arguments.NUMBER)
    def drive(self, v_m_s: float, yaw_rate_rad_s: float) -> None:
        """Set the velocity; repeat it at least twice a second.

        What is beyond the model's limits is taken as the limit.

        Raises:
            ArgumentError: a velocity that is not a finite number; it is a ValueError too.
            StoppedForSafetyError: the robot may not move (any more).
            DeviceLostError: it fell silent.

        """
        if not self.enabled:
            raise cannot_move(self._seen.ending)
        if clock.now() - self._pump.turn_ns > HUNG_NS:
            raise DeviceLostError(f"{self._name}: the session's loop hangs")
        command = VelocityCommand(
            _limited(v_m_s, self.model.max_speed_m_s),
            _limited(yaw_rate_rad_s, self.model.max_yaw_rate_rad_s),
        )
        # In the loop's thread, or a step between could take the older one for the newer.
        self._pump.call(lambda: self._drive.drive(command))

    def _reopen(self) -> None:
        """A stop has ended the session: begin another where the robot stands."""
        if self._closed:
            raise cannot_move(self._seen.ending)
        if not self._thread.is_alive():
            self._begin(self.pose)

    def stop(self) -> None:
        """Stop and latch, cause ``operator``, and end the session: no data comes any more.

        Returns once the device has confirmed the stop. Where the session has ended, or gets no
        confirmation, the port is opened anew and the stop is sent on it for 3 s. :meth:`enable`
        goes on, with ``clear_stop``; :meth:`clear_stop` without motion.

        Raises:
            DeviceLostError: the session's loop hangs, and nothing can be sent.
            NoDeviceError: the device did not confirm the stop. It ramps to rest by itself when
                the last velocity expires; see that it stands.
            PortError: the session had ended, and its port cannot be opened.

        """
        ending = Ending("stopped", "stopped by the program", 5, StopCause.OPERATOR)
        if not self._thread.is_alive():
            self._stop_without_session()
            return
        result = self._end(ending)
        if result is None:
            raise DeviceLostError(f"{self._name}: the session's loop hangs; stop the robot by hand")
        if result.confirmed < ending.cause:
            self._stop_without_session()

    def _stop_without_session(self) -> None:
        stop_device(self._name, self._open, self._pump.snapshot.session.node)

    def clear_stop(self) -> StopCause:
        """Release the latched stop, for a person who looked; gives its cause.

        Nothing moves for it. Where a stop has ended the session, the port is opened anew.

        Raises:
            CommandRejectedError: the device refused; what stopped it still holds, for one.
            DeviceLostError: it did not answer.
            PortError: the port cannot be opened again, or nothing answers on it.

        """
        self._reopen()
        self.wait_for_status()
        return self.client.clear_stop()

    # ---- parameters and the rest ----------------------------------------------------------

    def list_parameters(self) -> list[Parameter]:
        """Every parameter of the device, by number.

        Raises:
            CommandRejectedError: it has none.
            DeviceLostError: it did not answer.

        """
        return self.client.list_parameters()

    @arguments.checked(name=arguments.PARAMETER)
    def get_parameter(self, name: str | int) -> Parameter:
        """One, by name or number.

        Raises:
            ParameterError: there is none of this name.
            CommandRejectedError: there is none of this number.
            DeviceLostError: the device did not answer.

        """
        return self.client.get_parameter(name)

    @arguments.checked(name=arguments.PARAMETER, value=arguments.VALUE)
    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Change one until the next boot, in its unit; gives what the device has then.

        Raises:
            ParameterError: no such parameter, or it does not take the value.
            CommandRejectedError: the device refused.
            DeviceLostError: it did not answer.

        """
        return self.client.set_parameter(name, value)

    def save_parameters(self) -> None:
        """Make the present values the next boot's.

        Raises:
            CommandRejectedError: the device refused; while it may move, for one.
            DeviceLostError: it did not answer.

        """
        self.client.save_parameters()

    @arguments.checked(stream=arguments.TEXT, rate_hz=arguments.HERTZ)
    def stream_rate(self, stream: str, rate_hz: float) -> None:
        """Have a stream ("imu", "power", …) sent this often until the session ends; 0: not at all.

        Raises:
            ParameterError: no stream has this name, or the wire cannot say the rate.
            CommandRejectedError: the device refused.
            DeviceLostError: it did not answer.

        """
        self.client.stream_rate(stream, rate_hz)

    @arguments.checked(factory_reset=arguments.FLAG)
    def reboot(self, *, factory_reset: bool = False) -> None:
        """Have the device boot anew; the session finds it again by itself.

        Raises:
            CommandRejectedError: the device refused; while it may move, for one.
            DeviceLostError: it did not answer.

        """
        self.client.reboot(factory_reset=factory_reset)

    @arguments.checked(key=arguments.KEY | arguments.NONE)
    def set_key(self, key: bytes | None) -> None:
        """Have the device obey only what is signed with this key, 16 bytes; None: no key any more.

        A device takes a key over its local UART only, and never tells it. Where it has one
        already, this robot must have been opened with it. A stop is obeyed without it.

        Raises:
            ArgumentError: not 16 bytes, or 16 zeros; it is a ValueError too.
            KeyExposedError: the port is a bus or a network.
            CommandRejectedError: the device refused.
            DeviceLostError: it did not answer.

        """
        check_local(self._name)
        self.client.command(SetKey, *key_words(key or bytes(KEY_SIZE)))
        self._key = key
        session = self.host.session
        self._in_loop(lambda: session.set_key(key, clock.now()))
        # Of the session itself: a snapshot may still be the one before the key.
        if key is not None and not self._until(lambda: session.signs, STATUS_TIMEOUT_S):
            raise DeviceLostError("the device did not answer with its challenge")

    # ---- the end --------------------------------------------------------------------------

    def close(self) -> None:
        """End the session in order, the robot stopped, and give the port back for good.

        Waits for the device's confirmation, a second at most, and raises nothing where none
        comes: the device then stops by itself, when the last velocity expires. Call :meth:`stop`
        where you must know. Leaving the ``with`` block is this call. Recordings are closed too.

        Raises:
            LogError: a recording could not be written to its end.

        """
        self._closed = True
        self._end(Ending("stopped", "closed by the program", 0))
        failed = None
        for recording in self._recordings:
            try:
                recording.close()
            except LogError as error:
                failed = failed or error
        self._recordings.clear()
        if failed is not None:
            raise failed

    def _end(self, ending: Ending) -> Result | None:
        """End the session and wait for it; None: its loop hangs."""
        self._pump.request_end(ending)
        result = self._pump.wait_over(OPEN_TIMEOUT_S)
        self._thread.join(timeout=OPEN_TIMEOUT_S)
        return result

    def _in_loop(self, action: Callable[[], None]) -> None:
        """Have something run in the loop's thread, and wait for it.

        Raises:
            DeviceLostError: the loop has ended, or hangs.

        """
        answer = self._pump.call(action)
        try:
            answer.result(OPEN_TIMEOUT_S)
        except TimeoutError:
            answer.cancel()
            raise DeviceLostError(f"{self._name}: the session's loop hangs") from None

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
        except LogError:
            if kind is None:  # an error of the block comes before one of a log
                raise

    def _until(self, true: Callable[[], bool], timeout_s: float) -> bool:
        deadline_ns = clock.now() + round(timeout_s * 1e9)
        while not true() and self._thread.is_alive() and clock.now() < deadline_ns:
            clock.pause(_POLL_S)
        return true()


def _version() -> str:
    """The distribution's version; of a checkout that is not installed none is known."""
    try:
        return version("sweepctl")
    except PackageNotFoundError:
        return "unknown"


def _limited(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
