"""A run on the whole stack, with the truth and the commands kept as they come by."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.coverage.runner import PlanRunner
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.run.ending import Ending
from bridge.session.records import CommandRecord, TruthRecord
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.planner import Planner
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.run.host import Host
    from bridge.session.records import Record
    from sim_device.noise import NoiseLevel
    from tools.experiment.trials import Trial
    from tools.virtual.run import VirtualRun

BOOT_S = HOST_BOOT_NS / 1e9
"""Host's time less the device's, which all times here are of (s)."""
_ROUNDING_S = 1e-6
"""Of the two clocks' difference: a drive may end with a sample of its energy."""


class _Eye(NullSink):
    """Keeps what figures need, and nothing else."""

    def __init__(self) -> None:
        self.truth: list[tuple[float, Pose2]] = []
        self.commands: list[tuple[float, float, float]] = []

    def write(self, record: Record) -> None:
        """Keep a pose or a command."""
        if isinstance(record, TruthRecord):
            self.truth.append(((record.log_ns - EPOCH_NS) / 1e9, record.pose))
        elif isinstance(record, CommandRecord):
            sent = (record.target_v_m_s, record.v_m_s)
            self.commands.append(((record.log_ns - EPOCH_NS) / 1e9, *sent))


@dataclass(slots=True)
class Observed:
    """A finished run. Times are in seconds since the device's boot."""

    run: VirtualRun
    plan: FloorPlan
    model: RobotModel
    truth: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Time and true pose (m, rad) every 20 ms of the drive."""
    estimate: list[tuple[float, float, float, float]] = field(default_factory=list)
    """The same as the host believed it, at its control steps."""
    energy: list[tuple[float, float]] = field(default_factory=list)
    """Time and energy drawn since boot (Wh), about once a second of the drive."""
    commands: list[tuple[float, float, float]] = field(default_factory=list)
    """Time, forward speed wanted and forward speed sent (m/s)."""

    def energy_at(self, time_s: float) -> float:
        """Drawn by a time, Wh."""
        before = 0.0
        for sampled_s, energy_wh in self.energy:
            if sampled_s > time_s:
                break
            before = energy_wh
        return before


def observe(  # noqa: PLR0913 - what a run can be asked for
    trial: Trial,
    plan: FloorPlan,
    *,
    max_time_s: float,
    planner: Planner | None = None,
    noise: str | NoiseLevel | None = None,
    prepare: Callable[[VirtualRun], None] = lambda _: None,
    enough: Callable[[float, float], bool] = lambda _time_s, _energy_wh: False,
) -> Observed:
    """Run a trial.

    Args:
        trial: what to run.
        plan: its room.
        max_time_s: of the drive; after it the run is ended.
        planner: in place of the one that the trial names.
        noise: level in place of the trial's, by its name or itself.
        prepare: may change both ends before the first byte.
        enough: asked once a second with the drive's time (s) and the energy drawn since boot
            (Wh): whether to end it.

    Raises:
        FloorPlanError: the robot does not fit at the room's start.

    """
    eye, model = _Eye(), RobotModel()
    begun: list[VirtualRun] = []
    energy: list[tuple[float, float]] = []
    believed: list[tuple[float, Pose2]] = []

    def ready(run: VirtualRun) -> None:
        begun.append(run)
        run.host.on_drive_pose = lambda time_s, pose: believed.append((time_s, pose))
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
        return Ending("timeout", "as far as it is compared", 1)

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
        runner=None if planner is None else PlanRunner(planner, model),
        prepare=ready,
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
        [(t - BOOT_S, *pose) for t, pose in believed],
        [(t, wh) for t, wh in energy if low <= t <= high + _ROUNDING_S],
        [command for command in eye.commands if low <= command[0] <= high],
    )
