"""The paper's test of path keeping with the whole stack: its Figs. 12, 14 and 15."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.coverage.planner import Script, ScriptedPlanner
from bridge.coverage.runner import PlanRunner
from bridge.motion.geometry import Pose2
from tools.experiment.observed import BOOT_S, observe
from tools.experiment.u_cycles import UCycles

if TYPE_CHECKING:
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel
    from tools.experiment.trials import Trial
    from tools.virtual.run import VirtualRun

PAPER_END_MM = 7.0
"""Offset after seven cycles in the paper, mm: section 5.1."""
_SHOWN_S = 24.0
"""Duration of the part of the first cycle in Fig. 12, s: a lane, the turns and the lane back."""


class _CyclesPlanner(ScriptedPlanner):
    """Drives the planned cycles and records the time at the end of each."""

    def __init__(self, model: RobotModel, cycles: UCycles) -> None:
        super().__init__(model)
        self._cycles = cycles
        self.done_s: list[float] = []
        """Host time at the end of each cycle, s."""

    def script(self, obs: Observation) -> Script:  # noqa: ARG002 - the plan is fixed
        """Yield the legs of the cycles; the pose does not change the plan."""
        for complete, leg in self._cycles.legs():
            step = yield leg
            if complete > len(self.done_s):
                self.done_s.append(step.obs.time_s)
        return "all cycles driven"


def run_cycles(trial: Trial) -> dict[str, Any]:
    """Drive seven cycles and return the offset of each cycle's end from its planned end."""
    from tools.experiment.curves import thinned
    from tools.experiment.trials import HOUR_S, room_of

    plan = room_of(trial.room)
    cycles = UCycles(plan.start)
    planners: list[_CyclesPlanner] = []

    def take_over(run: VirtualRun) -> None:
        planners.append(_CyclesPlanner(run.host.model, cycles))
        run.host.mission.runner = PlanRunner(planners[0], run.host.model)

    longest_s = HOUR_S if trial.max_time_s is None else trial.max_time_s
    seen = observe(trial, plan, max_time_s=longest_s, prepare=take_over)
    ends = [_pose_at(seen.truth, time_s - BOOT_S) for time_s in planners[0].done_s]
    started_s = seen.truth[0][0] if seen.truth else 0.0
    offsets = [
        {
            "cycle": offset.cycle,
            "time_s": round(offset.time_s - started_s, 2),
            "along_mm": round(1000.0 * offset.along_m, 3),
            "across_mm": round(1000.0 * offset.across_m, 3),
            "offset_mm": round(1000.0 * offset.offset_m, 3),
            "heading_mrad": round(1000.0 * offset.heading_rad, 3),
        }
        for offset in cycles.offsets(ends)
    ]
    ending = seen.run.host.mission.ending
    row: dict[str, Any] = {
        "outcome": ending.outcome if ending is not None else "fault",
        "path_m": round(cycles.path_m, 3),
        "duration_s": round(seen.truth[-1][0] - started_s, 2) if seen.truth else None,
        "offsets": offsets,
        "path": thinned([pose[1:3] for pose in seen.truth]),
    }
    if trial.seed == 0:
        shown = [
            (round(t - started_s, 3), round(wanted, 4), round(sent, 4))
            for t, wanted, sent in seen.commands
            if t - started_s <= _SHOWN_S
        ]
        row["smoothing"] = shown
    return row


def _pose_at(truth: list[tuple[float, float, float, float]], time_s: float) -> tuple[float, Pose2]:
    """Return the first time and true pose at or after a time."""
    from bisect import bisect_left

    index = min(bisect_left(truth, (time_s,)), len(truth) - 1)
    time, *pose = truth[index]
    return time, Pose2(*pose)
