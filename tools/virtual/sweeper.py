"""A virtual sweeper with a connected host in one object and in virtual time, for users' tests.

It reads like :class:`bridge.api.robot.Robot`, so that what is written for a robot can be tried on
it: ``sweeper.enable(); sweeper.drive(0.1, 0.0); sweeper.run(2.0)``. Nothing here waits: a
simulated minute takes as long as it takes to compute. Equal settings give equal runs.
"""

from __future__ import annotations

import itertools
import random
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from bridge.api.robot import ManualDrive
from bridge.config import load_robot
from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from bridge.errors import BridgeError, DeviceLostError, StoppedForSafetyError
from bridge.evaluation.metrics import CoverageMeter
from bridge.motion.observation import VelocityCommand
from bridge.record.sink import NullSink
from bridge.run.build import build_run
from bridge.run.ending import Ending, cannot_move
from bridge.run.mission import Phase
from bridge.run.options import HostOptions
from bridge.run.summary import run_summary
from bridge.session.states import State
from protocol.can.link import CanLink
from protocol.messages import Encoders, Imu, Power, Range, Status
from protocol.uart.link import Link
from protocol.values import StopCause
from sim_device.faults.kinds import parse_fault
from sim_device.line.line import STRAIGHT
from sim_device.rig import Rig
from sim_device.sweeper import VirtualSweeper
from tools.cli.rooms import load_room
from tools.virtual.loop import HOST_BOOT_NS, VirtualLoop
from tools.virtual.run import EPOCH_NS, stop_crashed
from tools.virtual.settings import Settings

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bridge.coverage.planner import Planner
    from bridge.motion.geometry import Pose2
    from bridge.record.sink import Sink
    from protocol.schema.message import Message
    from sim_device.body.truth import Truth

CONTROL_S = 0.02
"""How often a controller is asked, and a velocity repeated: the host's control period."""
READY_S = 5.0
ENABLE_S = 12.0
_TRUTH_MS = 20
"""Time between two true poses that are kept, ms."""
_STATUS_S = 0.25
"""Two of the device's statuses: what it latched is told by then."""
T = TypeVar("T", bound="Message")


class Newest(Generic[T]):
    """The newest message of one kind, as :class:`bridge.api.robot.Latest` gives it."""

    def __init__(self, sweeper: SimulatedSweeper, kind: type[T]) -> None:
        self._sweeper = sweeper
        self._kind = kind

    @property
    def latest(self) -> T | None:
        """The message, or None before the first of this session."""
        value = getattr(self._sweeper.host.state, self._kind.__name__.lower())
        return value if isinstance(value, self._kind) else None


class SimulatedSweeper:
    """Device, line, faults and host; made connected, at rest, at time of the agreement."""

    def __init__(self, settings: Settings | None = None, *, sink: Sink | None = None) -> None:
        """Switch the device on and connect.

        Raises:
            FloorPlanError: no such room, or the robot does not fit at its start.
            UnknownNoiseLevelError: no such noise level.
            FaultSpecError: a fault that is none, or that cannot be on this device.
            StoppedForSafetyError: the two ends did not agree; a fault at time 0 can do that.

        """
        self.settings = settings = settings or Settings()
        self.plan = load_room(settings.room)
        self.model, _ = load_robot(None)
        faults = [parse_fault(text) for text in settings.faults]
        self._link = CanLink if settings.link in {"slcan", "udpcan"} else Link
        self.device = VirtualSweeper(
            self.plan,
            self.model,
            seed=settings.seed,
            noise=settings.noise,
            node=settings.node,
            link=self._link,
        )
        self.rig = Rig(self.device, STRAIGHT, faults, seed=settings.seed)
        self.imu = Newest(self, Imu)
        self.encoders = Newest(self, Encoders)
        self.range = Newest(self, Range)
        self.power = Newest(self, Power)
        self.status = Newest(self, Status)
        self.path: list[tuple[float, Pose2]] = []
        """Time (s since boot) and true pose, every 20 ms."""
        self._loop = VirtualLoop(self.device, self.rig, on_tick=self._remember)
        self._sink = sink or NullSink()
        self._ids = itertools.count(0x5EED_0001)
        self._connect(self.plan.start)
        if not self.run(READY_S, until=lambda: self.connected):
            raise StoppedForSafetyError(f"host and device did not agree within {READY_S:g} s")

    def _connect(self, start: Pose2) -> None:
        self._drive = ManualDrive()
        self._planner = ""
        options = HostOptions(EPOCH_NS - HOST_BOOT_NS, "manual", start, None, self._link)
        self.host = build_run(self.model, self._sink, options, lambda: next(self._ids))
        self._loop.connect(self.host)

    def _remember(self, last_ms: int, now_ms: int, pose: Pose2) -> None:
        if now_ms // _TRUTH_MS != last_ms // _TRUTH_MS:
            self.path.append((now_ms / 1e3, pose))

    # ---- what is so -----------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Since the device was switched on."""
        return self._loop.now_us / 1e6

    @property
    def truth(self) -> Truth:
        """Where the robot really is, and what it met: pose, speeds, collisions, energy."""
        return self.rig.truth

    @property
    def pose(self) -> Pose2:
        """Where the host believes it to be, in the room's frame."""
        return self.host.estimator.pose

    @property
    def pose_error_m(self) -> float:
        """Distance of the two."""
        return self.pose.distance_m(self.truth.pose)

    @property
    def connected(self) -> bool:
        """True while both ends agree."""
        return self.host.session.state is State.READY

    @property
    def enabled(self) -> bool:
        """True while :meth:`drive` moves the robot."""
        return self.host.mission.phase is Phase.DRIVING

    @property
    def stop_cause(self) -> StopCause:
        """What the device last told to be latched; ``NONE``: free to move."""
        status = self.status.latest
        return StopCause.NONE if status is None else StopCause(status.stop_cause)

    @property
    def ending(self) -> Ending | None:
        """How the run ended; None while it goes on."""
        return self.host.mission.ending

    # ---- time -----------------------------------------------------------------------------

    def run(self, duration_s: float, *, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass; True once ``until`` holds, False where the time ran out before."""
        loop = self._loop
        loop.wake()
        end_us = loop.now_us + round(duration_s * 1e6)
        while not until():
            if loop.now_us >= end_us:
                return False
            loop.step(end_us)
        return True

    # ---- by hand --------------------------------------------------------------------------

    def enable(self, *, clear_stop: bool = False) -> None:
        """Ask the device for leave to move; about 3 s at rest for the gyro.

        Raises:
            StoppedForSafetyError: a stop is latched that needs ``clear_stop``, or the device
                refused or fell silent; the text says which.

        """
        self._begin()
        self.host.mission.start(self._drive, clear_stop=clear_stop)
        self.run(ENABLE_S, until=lambda: self.enabled or self.ending is not None)
        self._check()

    def _begin(self) -> None:
        """After an end, a new host where the old one believed to be."""
        mission = self.host.mission
        if mission.runner is not None or mission.done:
            if not mission.done:
                self._end(Ending("stopped", "something else begins", 0))
            self._connect(self.pose)
            self.run(READY_S, until=lambda: self.connected)

    def _check(self) -> None:
        if not self.enabled:
            raise cannot_move(self.ending)

    def drive(self, v_m_s: float, yaw_rate_rad_s: float, for_s: float | None = None) -> None:
        """Set the velocity; the host lets go of it after half a second, unless it is repeated.

        With ``for_s`` it is repeated for that long, and then let go: time passes.

        Raises:
            StoppedForSafetyError: the robot may not move (any more).

        """
        self._check()
        command = VelocityCommand(v_m_s, yaw_rate_rad_s)
        if for_s is None:
            self._drive.drive(command)
            return
        self.follow(lambda _: (v_m_s, yaw_rate_rad_s), for_s)
        self._drive.drive(VelocityCommand(0.0, 0.0))

    def follow(
        self,
        controller: Callable[[SimulatedSweeper], tuple[float, float]],
        duration_s: float,
        *,
        until: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Ask ``controller`` for speed and yaw rate (m/s, rad/s) 50 times a second.

        True once ``until`` holds, False where the time ran out before.

        Raises:
            StoppedForSafetyError: the robot may not move (any more).

        """
        end_s = self.time_s + duration_s
        while self.time_s < end_s - 1e-9:
            self._check()
            self._drive.drive(VelocityCommand(*controller(self)))
            if self.run(min(CONTROL_S, end_s - self.time_s), until=until):
                return True
        return False

    def stop(self, cause: StopCause = StopCause.OPERATOR) -> None:
        """Stop and latch; :meth:`enable` goes on, with ``clear_stop`` where the cause asks for it.

        Time passes until the device has confirmed it.

        Raises:
            DeviceLostError: it did not.

        """
        self._end(Ending("stopped", "stopped by the test", 5, cause))
        mission = self.host.mission
        self.run(_STATUS_S)
        if mission.confirmed < cause:
            reason = mission.ending.reason if mission.ending else "the run goes on"
            raise DeviceLostError(f"the device did not confirm the stop: {reason}")

    def _end(self, ending: Ending) -> None:
        self.host.end(ending, self._loop.host_ns)
        self.run(5.0, until=lambda: self.host.mission.done)

    # ---- by a plan ------------------------------------------------------------------------

    def clean(
        self,
        planner: str | Planner = "paper",
        *,
        max_time_s: float = 3600.0,
        clear_stop: bool = False,
    ) -> dict[str, Any]:
        """Run a planner, by name or one of your own, to its end; the summary of ``simulate``.

        ``outcome`` in it is ``complete``, ``timeout``, ``stopped`` or ``fault``; the last also
        where the planner raised an exception, which ``reason`` then names.

        Raises:
            UnknownPlannerError: no planner of this name.
            PlannerError: your own lacks a method; nothing has moved.

        """
        name = planner if isinstance(planner, str) else type(planner).__name__
        if isinstance(planner, str):
            planner = make_planner(planner, self.model, random.Random(self.settings.seed))
        runner = PlanRunner(planner, self.model)
        self._begin()
        began = len(self.path)
        self._loop.forget_errors()
        mission = self.host.mission
        mission.start(runner, clear_stop=clear_stop)
        try:
            if not self.run(max_time_s, until=lambda: mission.done):
                self._end(Ending("timeout", f"not done after {max_time_s:g} s", 1))
        except BridgeError:
            raise
        except Exception as error:  # noqa: BLE001 - a planner's own, whatever it is
            stop_crashed(self.host, self.rig, error)
            self.run(_STATUS_S)
        return self._summary(name, began)

    def _summary(self, planner: str, began: int) -> dict[str, Any]:
        """The run's figures, from the truth of its drive, which is that from ``began`` on."""
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

    # ---- faults ---------------------------------------------------------------------------

    def fault(self, text: str) -> None:
        """Let a fault begin: ``kind`` alone at once, ``kind@+2`` in two seconds.

        Raises:
            FaultSpecError: it is none, or cannot be on this device.

        """
        self.rig.faults.start(text)

    def clear_faults(self, kind: str | None = None) -> None:
        """End faults of this kind, or all of them.

        Raises:
            FaultSpecError: there is no such kind.

        """
        self.rig.faults.clear(kind)

    @property
    def active_faults(self) -> Sequence[str]:
        """Texts of the faults that are in force."""
        return [spec.text for spec in self.rig.faults.active]
