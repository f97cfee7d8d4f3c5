"""A robot as a Python object: newest data and commands.

::

    with bridge.open("/dev/ttyUSB0") as robot:
        print(robot.imu.latest, robot.pose)
        robot.enable()
        robot.drive(0.1, 0.0)

A thread runs the session. The robot does not move before :meth:`Robot.enable`, and a velocity
expires after :data:`SETPOINT_TIMEOUT_S`. Commands are acknowledged: a method returns after the
device has accepted the command, and raises an error if the device rejects it.
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
from bridge.api.pump import LoopResult, Pump
from bridge.api.recording import Recording
from bridge.api.robot_parts import SETPOINT_TIMEOUT_S, EventTap, Latest, ManualDrive, OwnPlanner
from bridge.config import parse_robot, to_toml
from bridge.errors import (
    BridgeError,
    DeviceLostError,
    IncompatibleError,
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
from bridge.record.policy import RecordOptions, open_log
from bridge.record.recorder import ThreadedRecorder
from bridge.record.sink import NullSink
from bridge.run.build import build_run
from bridge.run.client import DeviceClient
from bridge.run.ending import Ending, cannot_move
from bridge.run.mission import Phase
from bridge.run.options import HostOptions
from bridge.run.snapshot import MissionSnapshot, Snapshot, StateSnapshot, snapshot_to_dict
from bridge.run.summary import run_summary
from bridge.session.records import RunInfo
from bridge.session.states import State
from protocol.authentication import KEY_SIZE, key_words
from protocol.messages.device import Encoders, Imu, Power, Range, Status
from protocol.messages.host import SetKey
from protocol.messages.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.record.sink import Sink
    from bridge.session.parameters import Parameter
    from bridge.session.records import EventRecord

__all__ = ["SETPOINT_TIMEOUT_S", "Latest", "ManualDrive", "Robot"]

OPEN_TIMEOUT_S = 5.0
"""Maximum wait for a device at opening, and for the end of the loop, s."""
ENABLE_TIMEOUT_S = 10.0
"""Maximum time of :meth:`Robot.enable`, s."""
STATUS_TIMEOUT_S = 1.0
"""Maximum wait for a status, s: ten periods."""
LINK_TIMEOUT_S = 4.0
"""Maximum wait for a fast link, s. Four pings take 0.4 s."""
HUNG_NS = 1_000_000_000
"""Age of the loop's newest pass at which the loop counts as hung, ns. It is four times the loop's
longest wait. Before this time the velocity has expired and the device has stopped."""
_POLL_S = 0.02
"""Poll interval of waits, s."""

_UNREADY: dict[int, type[BridgeError]] = {
    kind.exit_status: kind for kind in (IncompatibleError, SeveralDevicesError)
}
"""Error class of a failed session, by the exit status of its run."""


class Robot:
    """An open robot; use it as a context manager. Its methods may be called from any thread.

    A call with an argument of the wrong type or range raises an
    :class:`bridge.errors.ArgumentError` before anything is sent or opened.
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
    def __init__(  # noqa: PLR0913 - the options of a port
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
        """Open the port and connect to the device.

        Args:
            port: Device path, ``socket://HOST:PORT``, ``rfc2217://HOST:PORT`` or
                ``can:INTERFACE:CHANNEL``.
            model: Dimensions and limits of the robot; None: the default robot.
            sink: Receives every record of the session.
            node: Node of the device, 1 to 15; needed if a bus has several devices.
            baud: Baud rate of a serial port.
            dtr: Activate DTR. Off by default, because many boards reset on it.
            rts: Activate RTS. Also off by default.
            bitrate: Bit rate of a CAN bus, bit/s; None: the adapter's default.
            lan: Allow a virtual bus that other machines on the network can reach.
            key: 16-byte key that signs motion commands if the device requires it.
            timeout_s: Maximum wait for the device, s.

        Raises:
            ArgumentError: an argument has the wrong type or range.
            PortError: the port cannot be opened.
            NoDeviceError: no device answered.
            SeveralDevicesError: several devices answered, and ``node`` is missing.
            IncompatibleError: the device is incompatible.

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
        """Open the port and connect; the robot stands at ``start``."""
        self._drive = ManualDrive()
        options = HostOptions(
            self._offset_ns, "manual", start, self._node, link_of(self._name), self._key
        )
        self.host = build_run(self.model, self._events, options, new_session_id)
        self._mission = self.host.mission
        self._pump = Pump(self.host, self._open(), self._open)
        self.client = DeviceClient(LoopExchange(self.host, self._pump.call))
        self._owner: OwnerSocket | None = None
        with suppress(BridgeError):  # the robot works without the socket
            self._owner = OwnerSocket(self._name, OwnerService(self.host, self._pump, self._events))
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)
        self._thread.start()
        try:
            ready = self._until(
                lambda: self._pump.snapshot.session.state is State.READY, self._timeout_s
            )
        except BaseException:  # for example Ctrl-C: close the port
            self._end(Ending("stopped", "interrupted during opening", 0))
            raise
        if not ready:
            ending = self._seen.ending
            self._end(Ending("stopped", "no compatible device", 0))
            text = ending.reason if ending else f"no compatible device within {self._timeout_s:g} s"
            status = ending.exit_status if ending else NoDeviceError.exit_status
            error = _UNREADY.get(status, NoDeviceError)(f"{self._name}: {text}")
            error.remedy = ending.remedy if ending else None
            raise error

    def __repr__(self) -> str:
        """Return port, session, run and pose in SI units."""
        seen = self._pump.snapshot
        x_m, y_m, theta_rad = seen.estimator.pose
        return (
            f"<Robot {self._name}: {seen.session.state.value}, {seen.mission.phase.value}, "
            f"x_m={x_m:.3f}, y_m={y_m:.3f}, theta_rad={theta_rad:.3f}>"
        )

    def _run(self) -> None:
        try:
            self._pump.run()
        finally:
            if self._owner is not None:
                self._owner.close()

    # ---- state ------------------------------------------------------------------------------

    @property
    def imu(self) -> Latest[Imu]:
        """Newest IMU sample, 100 per second.

        ``robot.imu.latest`` has ``accel_x_m_s2`` (y, z), ``gyro_x_rad_s`` (y, z) and
        ``temperature_deg_c``. It is None before the first sample.
        """
        return self._imu

    @property
    def encoders(self) -> Latest[Encoders]:
        """Newest wheel counts, 50 per second: ``left`` and ``right``, 0 to 65535, which wrap."""
        return self._encoders

    @property
    def range(self) -> Latest[Range]:
        """Newest ranges and contacts, 20 per second.

        ``robot.range.latest`` has ``ultrasonic_m``, ``infrared_left_m`` and ``infrared_right_m``
        (None: no echo) and ``contacts``, the bits of ``protocol.messages.values.Contact``.
        """
        return self._range

    @property
    def power(self) -> Latest[Power]:
        """Newest ``battery_v``, ``logic_v``, ``motor_left_a``, ``motor_right_a``, 5 per second."""
        return self._power

    @property
    def status(self) -> Latest[Status]:
        """Newest ``mode``, ``stop_cause``, ``faults`` and ``load``, 10 per second."""
        return self._status

    @property
    def planner(self) -> OwnPlanner:
        """The device's own planner: start, pause, resume, abort, and its state."""
        return self._planner

    @property
    def pose(self) -> Pose2:
        """Estimated pose relative to the pose at opening: x and y (m) and heading (rad)."""
        return self._pump.snapshot.estimator.pose

    @property
    def state(self) -> StateSnapshot:
        """Newest messages of this session and the times of their samples."""
        return self._pump.snapshot.state

    @property
    def session(self) -> State:
        """State of the session. Commands are answered while it is ``READY``."""
        return self._pump.snapshot.session.state

    @property
    def _seen(self) -> MissionSnapshot:
        """State of the run."""
        return self._pump.snapshot.mission

    @property
    def enabled(self) -> bool:
        """True while :meth:`drive` can move the robot."""
        return self._seen.phase is Phase.DRIVING and self._thread.is_alive()

    def events(self) -> list[EventRecord]:
        """Return and remove the events since the last call: losses, stops, rejections, faults."""
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
        """Record everything from now on into an MCAP file, as ``sweepctl connect`` does.

        Use it as a context manager, or let :meth:`close` complete the log and its summary. A full
        disk does not stop the robot: ``error`` and ``dropped`` of the recording report it, and its
        ``close`` raises an error::

            with bridge.open("/dev/ttyUSB0") as robot, robot.record("drive.mcap"):
                robot.enable()

        Args:
            path: File to create.
            room: Floor plan to attach.
            robot_toml: Text of a robot file to attach; None: written from the model.
            force: Overwrite an existing file.

        Raises:
            OutputExistsError: the file exists, and ``force`` is False.
            LogWriteError: the file cannot be opened or written.
            ConfigError: ``robot_toml`` is not a valid robot file.

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
                self._in_loop(summed)  # it updates counts that the loop owns
            except DeviceLostError:
                if not self._thread.is_alive():
                    summed()
            return found

        path = Path(path)
        recorder = ThreadedRecorder(open_log(path, info, RecordOptions(), force=force))
        recording = Recording(path, info, recorder, self._events, summarise)
        self._recordings.append(recording)
        return recording

    def _log_offset_ns(self) -> int:
        """Return the difference between Unix time and host time for a log that starts now, ns.

        The system clock may have changed since the opening. If another log or the caller's sink is
        open, its offset is used, so that no log contains a step.
        """
        if not self._has_sink and all(recording.closed for recording in self._recordings):
            offset_ns = clock.unix_offset_ns()
            with suppress(DeviceLostError):  # if the loop has ended, there are no records
                self._in_loop(lambda: self.host.use_unix_offset(offset_ns))
                self._offset_ns = offset_ns
        return self._offset_ns

    def look(self) -> Snapshot:
        """Return session, run, sensors and pose as one immutable object."""
        return self._pump.snapshot

    def snapshot(self) -> dict[str, Any]:
        """Return the robot's current state for JSON."""
        return snapshot_to_dict(self._pump.snapshot, clock.now() / 1e9)

    @arguments.checked(timeout_s=arguments.SECONDS)
    def wait_for_status(self, timeout_s: float = STATUS_TIMEOUT_S) -> Status:
        """Return the device's newest status; wait if there is none yet.

        Raises:
            DeviceLostError: no status within ``timeout_s``.

        """
        self._until(lambda: self._pump.snapshot.state.status is not None, timeout_s)
        status = self._pump.snapshot.state.status
        if status is None:
            raise DeviceLostError(f"no status from the device within {timeout_s:g} s")
        return status

    @arguments.checked(timeout_s=arguments.SECONDS)
    def wait_for_link(self, timeout_s: float = LINK_TIMEOUT_S) -> None:
        """Wait until the link is measured and fast enough for motion.

        Raises:
            StoppedForSafetyError: the link is too slow, or not enough pings are answered.

        """
        if not self._until(lambda: self._seen.link is None, timeout_s):
            link = self._seen.link
            raise StoppedForSafetyError("the link was lost" if link is None else link.text)

    # ---- motion ---------------------------------------------------------------------------

    @arguments.checked(clear_stop=arguments.FLAG)
    def enable(self, *, clear_stop: bool = False) -> None:
        """Enable motion. It takes about 3 s at standstill, for the gyro bias.

        After a stop that ended the session, it opens the port again.

        Args:
            clear_stop: Clear a latched safety stop. Set it only after checking the robot.

        Raises:
            StoppedForSafetyError: a safety stop is latched, the link is too slow, or the robot is
                closed.
            CommandRejectedError: the device rejected motion.
            DeviceLostError: the device is silent.
            PortError: the port cannot be opened again, or no device answers.

        """
        self._reopen()
        self._in_loop(lambda: self._mission.start(self._drive, clear_stop=clear_stop))
        if self._seen.phase is Phase.HOLDING:
            raise DeviceLostError(f"{self._name}: the device is silent; wait until it answers")
        self._until(lambda: self.enabled or self._seen.ending is not None, ENABLE_TIMEOUT_S)
        if not self.enabled:
            raise cannot_move(self._seen.ending)

    @arguments.checked(v_m_s=arguments.NUMBER, yaw_rate_rad_s=arguments.NUMBER)
    def drive(self, v_m_s: float, yaw_rate_rad_s: float) -> None:
        """Set the velocity; repeat it at least twice per second.

        Args:
            v_m_s: Forward speed, m/s; limited to the model's maximum.
            yaw_rate_rad_s: Yaw rate, rad/s, counter-clockwise; limited to the model's maximum.

        Raises:
            ArgumentError: a velocity is not a finite number. The error is a ``ValueError`` too.
            StoppedForSafetyError: motion is not enabled, or not any more.
            DeviceLostError: the device is silent.

        """
        if not self.enabled:
            raise cannot_move(self._seen.ending)
        if clock.now() - self._pump.turn_ns > HUNG_NS:
            raise DeviceLostError(f"{self._name}: the session's loop does not respond")
        command = VelocityCommand(
            _limited(v_m_s, self.model.max_speed_m_s),
            _limited(yaw_rate_rad_s, self.model.max_yaw_rate_rad_s),
        )
        # Run in the loop's thread, so that no control step uses the old velocity.
        now_s = clock.now() / 1e9
        self._pump.call(lambda: self._drive.drive(command, now_s))

    def _reopen(self) -> None:
        """Open a new session after a stop; the robot keeps its pose."""
        if self._closed:
            raise cannot_move(self._seen.ending)
        if not self._thread.is_alive():
            self._begin(self.pose)

    def stop(self) -> None:
        """Stop and latch with cause ``operator``, and end the session.

        Returns after the device has confirmed the stop. If the session has ended or gets no
        confirmation, the port is opened again and the stop is sent for up to 3 s. To continue, call
        :meth:`enable` with ``clear_stop``, or :meth:`clear_stop` without motion.

        Raises:
            DeviceLostError: the session's loop does not respond, so nothing can be sent.
            NoDeviceError: the device did not confirm the stop. It stops by itself when the last
                velocity expires; check that it stands still.
            PortError: the session had ended, and its port cannot be opened.

        """
        ending = Ending("stopped", "stopped by the program", 5, StopCause.OPERATOR)
        if not self._thread.is_alive():
            self._stop_without_session()
            return
        result = self._end(ending)
        if result is None:
            text = "the session's loop does not respond; switch the robot off"
            raise DeviceLostError(f"{self._name}: {text}")
        if result.confirmed < ending.cause:
            self._stop_without_session()

    def _stop_without_session(self) -> None:
        stop_device(self._name, self._open, self._pump.snapshot.session.node)

    def clear_stop(self) -> StopCause:
        """Clear the latched stop and return its cause. Call it only after checking the robot.

        It causes no motion. After a stop that ended the session, it opens the port again.

        Raises:
            CommandRejectedError: the device rejected the command, for example because the cause
                persists.
            DeviceLostError: the device did not answer.
            PortError: the port cannot be opened again, or no device answers.

        """
        self._reopen()
        self.wait_for_status()
        return self.client.clear_stop()

    # ---- parameters and other commands ------------------------------------------------------

    def list_parameters(self) -> list[Parameter]:
        """Read all parameters of the device, sorted by number.

        Raises:
            CommandRejectedError: the device has no parameters.
            DeviceLostError: the device did not answer.

        """
        return self.client.list_parameters()

    @arguments.checked(name=arguments.PARAMETER)
    def get_parameter(self, name: str | int) -> Parameter:
        """Read one parameter by name or number.

        Raises:
            ParameterError: unknown name.
            CommandRejectedError: unknown number.
            DeviceLostError: the device did not answer.

        """
        return self.client.get_parameter(name)

    @arguments.checked(name=arguments.PARAMETER, value=arguments.VALUE)
    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Set a parameter until the next boot; return it as the device reports it.

        Args:
            name: Name or number.
            value: New value in the parameter's unit.

        Raises:
            ParameterError: unknown parameter, or a value of the wrong kind or range.
            CommandRejectedError: the device rejected the value.
            DeviceLostError: the device did not answer.

        """
        return self.client.set_parameter(name, value)

    def save_parameters(self) -> None:
        """Save the current values, so that they survive a reboot.

        Raises:
            CommandRejectedError: the device rejected the command, for example because motion is
                enabled.
            DeviceLostError: the device did not answer.

        """
        self.client.save_parameters()

    @arguments.checked(stream=arguments.TEXT, rate_hz=arguments.HERTZ)
    def stream_rate(self, stream: str, rate_hz: float) -> None:
        """Set the rate of a stream until the session ends.

        Args:
            stream: Name of the stream's message, for example ``"imu"``.
            rate_hz: Rate, 0.1 to 1000 Hz; 0 switches the stream off.

        Raises:
            ParameterError: unknown stream, or a rate outside the range.
            CommandRejectedError: the device rejected the rate.
            DeviceLostError: the device did not answer.

        """
        self.client.stream_rate(stream, rate_hz)

    @arguments.checked(factory_reset=arguments.FLAG)
    def reboot(self, *, factory_reset: bool = False) -> None:
        """Reboot the device; the session then reconnects by itself.

        Args:
            factory_reset: Delete the saved parameters.

        Raises:
            CommandRejectedError: the device rejected the command, for example because motion is
                enabled.
            DeviceLostError: the device did not answer.

        """
        self.client.reboot(factory_reset=factory_reset)

    @arguments.checked(key=arguments.KEY | arguments.NONE)
    def set_key(self, key: bytes | None) -> None:
        """Set the device's 16-byte key, which must then sign motion commands; None: remove it.

        A device accepts a key over its local UART only and never reports it. If it already has a
        key, the robot must be opened with that key. A stop needs no signature.

        Raises:
            ArgumentError: the key is not 16 bytes, or is 16 zeros. The error is a ``ValueError``
                too.
            KeyExposedError: the port is a bus or a network.
            CommandRejectedError: the device rejected the key.
            DeviceLostError: the device did not answer.

        """
        check_local(self._name)
        self.client.command(SetKey, *key_words(key or bytes(KEY_SIZE)))
        self._key = key
        session = self.host.session
        self._in_loop(lambda: session.set_key(key, clock.now()))
        # Read from the session itself, because a snapshot may be older than the key.
        if key is not None and not self._until(lambda: session.signs, STATUS_TIMEOUT_S):
            raise DeviceLostError("the device sent no challenge for its new key")

    # ---- end --------------------------------------------------------------------------------

    def close(self) -> None:
        """Stop the robot, end the session and close the port and all recordings.

        It waits for the device's confirmation for at most 1 s. Without a confirmation it raises no
        error, because the device stops by itself when the last velocity expires. Call :meth:`stop`
        for a confirmed stop. The end of the ``with`` block calls this method.

        Raises:
            LogError: a recording could not be completed.

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

    def _end(self, ending: Ending) -> LoopResult | None:
        """End the session and wait for its end; None: the session's loop does not respond."""
        self._pump.request_end(ending)
        result = self._pump.wait_over(OPEN_TIMEOUT_S)
        self._thread.join(timeout=OPEN_TIMEOUT_S)
        return result

    def _in_loop(self, action: Callable[[], None]) -> None:
        """Run ``action`` in the loop's thread and wait for it.

        Raises:
            DeviceLostError: the loop has ended or does not respond.

        """
        answer = self._pump.call(action)
        try:
            answer.result(OPEN_TIMEOUT_S)
        except TimeoutError:
            answer.cancel()
            raise DeviceLostError(f"{self._name}: the session's loop does not respond") from None

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
            if kind is None:  # an exception of the block has priority
                raise

    def _until(self, true: Callable[[], bool], timeout_s: float) -> bool:
        deadline_ns = clock.now() + round(timeout_s * 1e9)
        while not true() and self._thread.is_alive() and clock.now() < deadline_ns:
            clock.pause(_POLL_S)
        return true()


def _version() -> str:
    """Return the version of the installed package, or "unknown" for a plain checkout."""
    try:
        return version("sweepctl")
    except PackageNotFoundError:
        return "unknown"


def _limited(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
