"""The recovery planner at cliffs: the robot does not fall, and the run ends."""

from __future__ import annotations

import functools
import json
from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple

import pytest

from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from sim_device.body.footing import wheel_over
from tools.virtual.run import VirtualRun, run_virtual

if TYPE_CHECKING:
    from bridge.run.host import Host

pytestmark = pytest.mark.slow

MODEL = RobotModel()
SEEDS = (1, 2)
PITS = {
    "in the middle": [[1.0, 0.9], [1.4, 0.9], [1.4, 1.3], [1.0, 1.3]],
    "at a wall": [[1.2, 0.0], [1.7, 0.0], [1.7, 0.35], [1.2, 0.35]],
    "stairs down": [[2.0, 0.0], [2.4, 0.0], [2.4, 2.2], [2.0, 2.2]],
}


class Swept(NamedTuple):
    """A run, and the times (s) at which a wheel was over the pit."""

    run: VirtualRun
    fell_s: list[float]


@functools.cache
def swept(pit: str, seed: int, target: str) -> Swept:
    """Sweep a room with a pit, with the virtual robot that the fixture ``target`` has chosen."""
    del target
    walls = [[0.0, 0.0], [2.4, 0.0], [2.4, 2.2], [0.0, 2.2]]
    room = {"name": "pit", "walls": walls, "obstacles": [], "start": [0.3, 0.3, 0.2]}
    plan = parse_floorplan(json.dumps({**room, "cliffs": [PITS[pit]]}))
    runs: list[VirtualRun] = []
    fell_s: list[float] = []

    def look(t_s: float, host: Host) -> None:
        del host
        if wheel_over(runs[0].device.plant.pose, 0.5 * MODEL.wheel_base_m, plan.cliffs):
            fell_s.append(t_s)

    run = run_virtual(
        plan,
        MODEL,
        "recovery",
        NullSink(),
        seed=seed,
        noise="typical",
        max_time_s=500.0,
        progress=look,
        prepare=runs.append,
    )
    return Swept(run, fell_s)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("pit", PITS)
def test_a_pit_is_swept_around_and_not_driven_into(target: str, pit: str, seed: int) -> None:
    run, fell_s = swept(pit, seed, target)
    ending = run.host.mission.ending
    assert fell_s == []
    assert ending is not None
    assert ending.outcome == "complete"
    assert run.track.report(None).time_ratio < 3.0


@pytest.mark.parametrize("pit", PITS)
def test_the_floor_before_a_pit_is_swept(target: str, pit: str) -> None:
    """The lanes that reach the edge first decide where the next ones end: a mean of two runs."""
    reports = [swept(pit, seed, target).run.track.report(None) for seed in SEEDS]
    assert fmean(report.coverage.mouth_sweepable for report in reports) > 0.94
