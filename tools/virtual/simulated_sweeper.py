"""A virtual sweeper with a connected host in virtual time, for users' tests.

It has the methods of :class:`bridge.api.robot.Robot`, so that code for a robot can be tested with
it: ``sweeper.enable(); sweeper.drive(0.1, 0.0); sweeper.run(2.0)``. Time is virtual: a simulated
minute takes only the time of its computation. Equal settings give equal runs.
"""

from __future__ import annotations

import itertools
import random
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from bridge.api.recording import Recording
from bridge.api.robot import ManualDrive
from bridge.api.robot_parts import EventTap
from bridge.config import load_robot
from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from bridge.errors import BridgeError, DeviceLostError, StoppedForSafetyError
from bridge.evaluation.metrics import CoverageMeter
from bridge.motion.observation import VelocityCommand
from bridge.record.names import VIRTUAL_PORT
from bridge.record.policy import RecordOptions, open_log
from bridge.record.recorder import DirectRecorder
from bridge.record.sink import NullSink
from bridge.run.build import build_run
from bridge.run.ending import Ending, cannot_move
from bridge.run.mission import Phase
from bridge.run.options import HostOptions
from bridge.run.summary import run_summary
from bridge.session.records import RunInfo, TruthRecord
from bridge.session.states import State
from protocol.can.link import CanLink
from protocol.messages.device import Encoders, Imu, Power, Range, Status
from protocol.messages.values import StopCause
from protocol.uart.link import Link
from sim_device.faults.kinds import parse_fault
from sim_device.line.line import STRAIGHT
from sim_device.rig import Rig
from sim_device.sweeper import Sweeper, VirtualSweeper
from tools.cli.fault_help import fault_record
from tools.cli.rooms import load_room
from tools.version import VERSION
from tools.virtual import core_target
from tools.virtual.loop import HOST_BOOT_NS, VirtualLoop
from tools.virtual.run import EPOCH_NS, stop_crashed
from tools.virtual.settings import SweeperSettings
from tools.virtual.wanted import Wanted

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bridge.coverage.planner import Planner
    from bridge.motion.geometry import Pose2
    from bridge.record.sink import Sink
    from protocol.schema.message import Message
    from sim_device.body.truth import Truth

CONTROL_S = 0.02
"""Period at which a controller is called and a velocity is repeated, s: the host's period."""
READY_S = 5.0
"""Maximum time of the handshake, s."""
ENABLE_S = 12.0
"""Maximum time from :meth:`SimulatedSweeper.enable` to motion, s: 3 s of standstill, and the time
to repeat unanswered commands."""
_TRUTH_MS = 20
"""Period of the true poses in ``path``, ms."""
_STATUS_S = 0.25
"""Time after a stop until the device's status shows the stop, s: two periods of the status."""
T = TypeVar("T", bound="Message")


class Newest(Generic[T]):
    """The newest message of one kind, like :class:`bridge.api.robot.Latest`."""

    def __init__(self, sweeper: SimulatedSweeper, kind: type[T]) -> None:
        self._sweeper = sweeper
        self._kind = kind

    def __repr__(self) -> str:
        """Return the message in SI units."""
        return f"<{self._kind.__name__.lower()}: {self.latest or 'nothing yet'}>"

    @property
    def latest(self) -> T | None:
        """The message, or None before the first of this session."""
        value = getattr(self._sweeper.host.state, self._kind.__name__.lower())
        return value if isinstance(value, self._kind) else None


class SimulatedSweeper:
    """Virtual device, link, faults and host; connected and at rest after the construction."""

    def __init__(
        self, settings: SweeperSettings | None = None, *, sink: Sink | None = None
    ) -> None:
        """Switch the device on and connect.

        Args:
            settings: properties of the virtual sweeper; None: the defaults.
            sink: gets every record of the host; None: nothing is recorded.

        Raises:
            FloorPlanError: no such room, or the robot does not fit at its start.
            UnknownNoiseLevelError: no such noise level.
            FaultSpecError: a fault is invalid, or this device does not support it.
            FirmwareLibraryError: the settings' firmware is no firmware library.
            StoppedForSafetyError: no handshake within 5 s; a fault at time 0 can prevent it.

        """
        self.settings = settings = settings or SweeperSettings()
        self.plan = load_room(settings.room)
        self.model, self._robot_toml = load_robot(None)
        faults = [parse_fault(text) for text in settings.faults]
        self._link = CanLink if settings.link in {"slcan", "udpcan"} else Link
        self.device = self._device()
        self.rig = Rig(self.device, STRAIGHT, faults, seed=settings.seed)
        self.imu = Newest(self, Imu)
        self.encoders = Newest(self, Encoders)
        self.range = Newest(self, Range)
        self.power = Newest(self, Power)
        self.status = Newest(self, Status)
        self.path: list[tuple[float, Pose2]] = []
        """Time, s since boot, and true pose, every 20 ms."""
        self._recordings: list[Recording] = []
        self._loop = VirtualLoop(
            self.device, self.rig, on_tick=self._remember, on_step=self._log_faults
        )
        self._sink = EventTap(sink or NullSink())
        self._ids = itertools.count(0x5EED_0001)
        self._connect(self.plan.start)
        if not self.run(READY_S, until=lambda: self.connected):
            raise StoppedForSafetyError(f"no handshake with the device within {READY_S:g} s")

    def _device(self) -> Sweeper[Any]:
        settings = self.settings
        if settings.target == "core":
            wanted = Wanted(
                plan=self.plan,
                model=self.model,
                seed=settings.seed,
                noise=settings.noise,
                node=settings.node,
                link=self._link,
            )
            library = None if settings.firmware is None else Path(settings.firmware)
            return core_target.make(wanted, library)
        return VirtualSweeper(
            self.plan,
            self.model,
            seed=settings.seed,
            noise=settings.noise,
            node=settings.node,
            link=self._link,
        )

    def _connect(self, start: Pose2) -> None:
        self._drive = ManualDrive()
        self._planner = ""
        options = HostOptions(EPOCH_NS - HOST_BOOT_NS, "manual", start, None, self._link)
        self.host = build_run(self.model, self._sink, options, lambda: next(self._ids))
        self._loop.connect(self.host)

    def _remember(self, last_ms: int, now_ms: int, pose: Pose2) -> None:
        if now_ms // _TRUTH_MS != last_ms // _TRUTH_MS:
            self.path.append((now_ms / 1e3, pose))
            for recording in self._recordings:
                recording.write(TruthRecord(EPOCH_NS + now_ms * 1_000_000, pose))

    def _log_faults(self) -> None:
        for event in self.rig.faults.take_events():
            for recording in self._recordings:
                recording.write(fault_record(event, EPOCH_NS + event.t_us * 1000))

    # ---- state ----------------------------------------------------------------------------

    def __repr__(self) -> str:
        """Return room, time and true pose in SI units."""
        x_m, y_m, theta_rad = self.truth.pose
        return (
            f"<SimulatedSweeper {self.plan.name}: time_s={self.time_s:.2f}, "
            f"x_m={x_m:.3f}, y_m={y_m:.3f}, theta_rad={theta_rad:.3f}>"
        )

    @property
    def time_s(self) -> float:
        """Time since the device was switched on, s."""
        return self._loop.now_us / 1e6

    @property
    def truth(self) -> Truth:
        """True state of the robot: pose, speeds, collisions, energy."""
        return self.rig.truth

    @property
    def pose(self) -> Pose2:
        """Estimated pose, in the room's frame."""
        return self.host.estimator.pose

    @property
    def pose_error_m(self) -> float:
        """Distance of estimated and true position, m."""
        return self.pose.distance_m(self.truth.pose)

    @property
    def connected(self) -> bool:
        """True while the session with the device is established."""
        return self.host.session.state is State.READY

    @property
    def enabled(self) -> bool:
        """True while :meth:`drive` moves the robot."""
        return self.host.mission.phase is Phase.DRIVING

    @property
    def stop_cause(self) -> StopCause:
        """Cause of the latched stop in the newest status; ``NONE``: the device may move."""
        status = self.status.latest
        return StopCause.NONE if status is None else StopCause(status.stop_cause)

    @property
    def ending(self) -> Ending | None:
        """How the run ended; None: the run has not ended."""
        return self.host.mission.ending

    # ---- time -----------------------------------------------------------------------------

    def run(self, duration_s: float, *, until: Callable[[], bool] = lambda: False) -> bool:
        """Advance the virtual time.

        Returns:
            True as soon as ``until`` is true; False if ``duration_s`` has passed before.

        """
        loop = self._loop
        loop.wake()
        end_us = loop.now_us + round(duration_s * 1e6)
        while not until():
            if loop.now_us >= end_us:
                return False
            loop.step(end_us)
        return True

    # ---- manual driving -------------------------------------------------------------------

    def enable(self, *, clear_stop: bool = False) -> None:
        """Enable motion, after about 3 s at rest for the gyro bias.

        Raises:
            StoppedForSafetyError: a latched stop needs ``clear_stop``, or the device rejected the
                command or does not answer; the text contains the reason.

        """
        self._begin()
        self.host.mission.start(self._drive, clear_stop=clear_stop)
        self.run(ENABLE_S, until=lambda: self.enabled or self.ending is not None)
        self._check()

    def _begin(self) -> None:
        """After a run, connect a new host that starts at the estimated pose of the old one."""
        mission = self.host.mission
        if mission.runner is not None or mission.done:
            if not mission.done:
                self._end(Ending("stopped", "another run begins", 0))
            self._connect(self.pose)
            self.run(READY_S, until=lambda: self.connected)

    def _check(self) -> None:
        if not self.enabled:
            raise cannot_move(self.ending)

    def drive(self, v_m_s: float, yaw_rate_rad_s: float, for_s: float | None = None) -> None:
        """Set the velocity; unless it is repeated, the host stops the robot after 0.5 s.

        Args:
            v_m_s: forward speed, m/s.
            yaw_rate_rad_s: yaw rate, rad/s, positive to the left.
            for_s: time to advance with this velocity before a stop, s; None: return at once.

        Raises:
            StoppedForSafetyError: motion is not enabled, or no longer.

        """
        self._check()
        command = VelocityCommand(v_m_s, yaw_rate_rad_s)
        if for_s is None:
            self._drive.drive(command, self._loop.host_ns / 1e9)
            return
        self.follow(lambda _: (v_m_s, yaw_rate_rad_s), for_s)
        self._drive.drive(VelocityCommand(0.0, 0.0), self._loop.host_ns / 1e9)

    def follow(
        self,
        controller: Callable[[SimulatedSweeper], tuple[float, float]],
        duration_s: float,
        *,
        until: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Drive with the speed and yaw rate (m/s, rad/s) that ``controller`` returns at 50 Hz.

        Returns:
            True as soon as ``until`` is true; False if ``duration_s`` has passed before.

        Raises:
            StoppedForSafetyError: motion is not enabled, or no longer.

        """
        end_s = self.time_s + duration_s
        while self.time_s < end_s - 1e-9:
            self._check()
            self._drive.drive(VelocityCommand(*controller(self)), self._loop.host_ns / 1e9)
            if self.run(min(CONTROL_S, end_s - self.time_s), until=until):
                return True
        return False

    def stop(self, cause: StopCause = StopCause.OPERATOR) -> None:
        """Stop the robot and latch the stop; time advances until the device confirms it.

        Afterwards :meth:`enable` works again, with ``clear_stop`` if the cause needs it.

        Raises:
            DeviceLostError: the device did not confirm the stop.

        """
        self._end(Ending("stopped", "stopped by the test", 5, cause))
        mission = self.host.mission
        self.run(_STATUS_S)
        if mission.confirmed < cause:
            reason = mission.ending.reason if mission.ending else "the run has not ended"
            raise DeviceLostError(f"the device did not confirm the stop: {reason}")

    def _end(self, ending: Ending) -> None:
        self.host.end(ending, self._loop.host_ns)
        self.run(5.0, until=lambda: self.host.mission.done)

    # ---- planners -------------------------------------------------------------------------

    def clean(
        self,
        planner: str | Planner = "paper",
        *,
        max_time_s: float = 3600.0,
        clear_stop: bool = False,
    ) -> dict[str, Any]:
        """Run a planner to its end.

        Args:
            planner: name of a planner, or an object of your own.
            max_time_s: time limit, s.
            clear_stop: clear a latched safety stop first.

        Returns:
            The summary, as ``sweepctl simulate --json`` prints it. Its ``outcome`` is ``complete``,
            ``timeout``, ``stopped`` or ``fault``; if the planner raised an exception, it is
            ``fault`` and ``reason`` names the exception.

        Raises:
            UnknownPlannerError: no planner has this name.
            PlannerError: your planner lacks a method; the robot has not moved.

        """
        name = planner if isinstance(planner, str) else type(planner).__name__
        if isinstance(planner, str):
            planner = make_planner(planner, self.model, random.Random(self.settings.seed))
        runner = PlanRunner(planner, self.model)
        self._begin()
        began = len(self.path)
        self._loop.forget_errors()
        self._planner = name
        mission = self.host.mission
        mission.start(runner, clear_stop=clear_stop)
        try:
            if not self.run(max_time_s, until=lambda: mission.done):
                self._end(Ending("timeout", f"not done after {max_time_s:g} s", 1))
        except BridgeError:
            raise
        except Exception as error:  # noqa: BLE001 - a user's planner may raise anything
            stop_crashed(self.host, self.rig, error)
            self.run(_STATUS_S)
        return self._summary(name, began)

    def _summary(self, planner: str, began: int) -> dict[str, Any]:
        """Return the summary of the run whose true path starts at index ``began``."""
        mission, truth = self.host.mission, self.truth
        report = None
        if mission.drive_started_s is not None:
            boot_s = HOST_BOOT_NS / 1e9
            from_s = mission.drive_started_s - boot_s
            until_s = (mission.drive_ended_s or self.time_s + boot_s) - boot_s
            driven = [(t, *pose) for t, pose in self.path[began:] if from_s <= t <= until_s]
            lane_m = mission.runner.lane_length_m if mission.runner else 0.0
            report = CoverageMeter(self.plan, self.model).measure(driven, lane_m)
        loop = self._loop
        return run_summary(
            self.host,
            room=self.plan.name,
            planner=planner,
            seed=self.settings.seed,
            log=None,
            report=report,
            error_m=(loop.end_error_m, loop.max_error_m),
            collisions=truth.collisions,
            contact_s=truth.contact_s,
            energy_wh=truth.energy_wh,
        )

    # ---- recording ------------------------------------------------------------------------

    def record(self, path: str | Path, *, force: bool = False) -> Recording:
        """Record everything from now on into an MCAP file, the true pose included.

        Use it as a context manager, or let :meth:`close` complete the log and its summary::

            with sweeper.record("drive.mcap"):
                sweeper.enable()
                sweeper.drive(0.1, 0.0, for_s=2.0)

        Args:
            path: file to create.
            force: overwrite an existing file.

        Raises:
            OutputExistsError: the file exists, and ``force`` is False.
            LogWriteError: the file cannot be opened or written.

        """
        path, began = Path(path), len(self.path)
        extra = {"noise": self.settings.noise}
        if self.settings.faults:
            extra["faults"] = " ".join(self.settings.faults)
        info = RunInfo(
            VIRTUAL_PORT,
            "manual",
            self.settings.seed,
            VERSION,
            EPOCH_NS + self._loop.now_us * 1000,
            EPOCH_NS - HOST_BOOT_NS,
            self.model,
            self._robot_toml,
            self.plan,
            extra,
        )

        def summarise(_room: str | None, log: str) -> dict[str, Any]:
            return {**self._summary(self._planner or "manual", began), "log": log}

        recorder = DirectRecorder(open_log(path, info, RecordOptions(), force=force))
        recording = Recording(path, info, recorder, self._sink, summarise)
        self._recordings.append(recording)
        return recording

    def close(self) -> None:
        """Complete all recordings, and end the process of a firmware library.

        Raises:
            LogError: a recording could not be completed.

        """
        self.device.close()
        recordings, self._recordings = self._recordings, []
        for recording in recordings:
            recording.close()

    # ---- faults ---------------------------------------------------------------------------

    def fault(self, text: str) -> None:
        """Start a fault: ``kind`` starts it at once, ``kind@+2`` in two seconds.

        Raises:
            FaultSpecError: the text is invalid, or this device does not support the fault.

        """
        self.rig.faults.start(text)

    def clear_faults(self, kind: str | None = None) -> None:
        """End the faults of this kind; without ``kind`` end all faults.

        Raises:
            FaultSpecError: no kind has this name.

        """
        self.rig.faults.clear(kind)

    @property
    def active_faults(self) -> Sequence[str]:
        """Texts of the active faults."""
        return [spec.text for spec in self.rig.faults.active]
