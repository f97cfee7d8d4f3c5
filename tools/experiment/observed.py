"""A run of the whole stack with recorded true poses, estimates, energy and commands."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.coverage.runner import PlanRunner
from bridge.record.sink import NullSink
from bridge.run.ending import Ending
from bridge.session.records import CommandRecord, TruthRecord
from tools.experiment.settings import settings_of
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.planner import Planner
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from bridge.run.host import Host
    from bridge.session.records import Record
    from sim_device.noise import NoiseLevel
    from tools.experiment.trials import Trial
    from tools.virtual.run import VirtualRun

BOOT_S = HOST_BOOT_NS / 1e9
"""Host time minus device time, s. All times in this module are device time."""
_ROUNDING_S = 1e-6
"""Rounding error of the difference between host and device time, s. It matters for an energy sample
at the end of the drive."""


class _TruthSink(NullSink):
    """A sink that stores true poses and commands only."""

    def __init__(self) -> None:
        self.truth: list[tuple[float, Pose2]] = []
        self.commands: list[tuple[float, float, float]] = []

    def write(self, record: Record) -> None:
        """Store a true pose or a command."""
        if isinstance(record, TruthRecord):
            self.truth.append(((record.log_ns - EPOCH_NS) / 1e9, record.pose))
        elif isinstance(record, CommandRecord):
            sent = (record.target_v_m_s, record.v_m_s)
            self.commands.append(((record.log_ns - EPOCH_NS) / 1e9, *sent))


@dataclass(slots=True)
class Observed:
    """A finished run. All times are in seconds since the device's boot."""

    run: VirtualRun
    plan: FloorPlan
    model: RobotModel
    truth: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Time and true pose, m and rad, every 40 ms of the drive."""
    estimate: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Time and estimated pose, m and rad, at each control step of the drive."""
    energy: list[tuple[float, float]] = field(default_factory=list)
    """Time and energy drawn since boot, Wh, about once a second of the drive."""
    commands: list[tuple[float, float, float]] = field(default_factory=list)
    """Time, forward speed before and after smoothing, m/s."""

    def energy_at(self, time_s: float) -> float:
        """Return the energy drawn until a time, Wh."""
        before = 0.0
        for sampled_s, energy_wh in self.energy:
            if sampled_s > time_s:
                break
            before = energy_wh
        return before


def observe(  # noqa: PLR0913 - one parameter for each property of a run
    trial: Trial,
    plan: FloorPlan,
    *,
    max_time_s: float,
    model: RobotModel | None = None,
    planner: Planner | None = None,
    noise: str | NoiseLevel | None = None,
    prepare: Callable[[VirtualRun], None] = lambda _: None,
    enough: Callable[[float, float], bool] = lambda _time_s, _energy_wh: False,
) -> Observed:
    """Run a trial.

    Args:
        trial: what to run.
        plan: its room.
        max_time_s: time limit of the run, simulated seconds.
        model: replaces the robot of the trial.
        planner: replaces the planner that the trial names.
        noise: replaces the noise level of the trial.
        prepare: called before the first byte; may change both ends.
        enough: called once a second with the time of the drive, s, and the energy drawn since
            boot, Wh; returns whether to end the run.

    Raises:
        FloorPlanError: the robot does not fit at the room's start.

    """
    eye, model = _TruthSink(), model or trial.model
    settings = settings_of(trial.options)
    begun: list[VirtualRun] = []
    energy: list[tuple[float, float]] = []
    estimated: list[tuple[float, Pose2]] = []

    def ready(run: VirtualRun) -> None:
        begun.append(run)
        run.host.on_drive_pose = lambda time_s, pose: estimated.append((time_s, pose))
        prepare(run)

    def sample(time_s: float, _host: Host) -> None:
        energy.append((time_s, begun[0].device.truth.energy_wh))

    def ended() -> Ending | None:
        started_s = begun[0].host.mission.drive_started_s
        if started_s is None or not energy:
            return None
        time_s, energy_wh = energy[-1]
        if not enough(time_s - (started_s - BOOT_S), energy_wh):
            return None
        return Ending("timeout", "end of the comparison", 1)

    run = run_virtual(
        plan,
        model,
        "random" if trial.planner == "u-cycles" else trial.planner,
        eye,
        seed=trial.seed,
        noise=noise or trial.noise,
        max_time_s=max_time_s,
        progress=sample,
        ended=ended,
        runner=None if planner is None else PlanRunner(planner, model, settings.motion),
        prepare=ready,
        estimation=settings.estimation,
    )
    mission = run.host.mission
    first = mission.drive_started_s
    if first is None:
        return Observed(run, plan, model)
    last = mission.drive_ended_s
    low, high = first - BOOT_S, float("inf") if last is None else last - BOOT_S
    return Observed(
        run,
        plan,
        model,
        [(t, *pose) for t, pose in eye.truth if low <= t <= high],
        [(t - BOOT_S, *pose) for t, pose in estimated],
        [(t, wh) for t, wh in energy if low <= t <= high + _ROUNDING_S],
        [command for command in eye.commands if low <= command[0] <= high],
    )
