"""The recovery planner at cliffs: the robot does not fall, and the run ends."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from sim_device.body.footing import wheel_over
from support.selection import seeds
from tools.virtual.run import run_virtual

if TYPE_CHECKING:
    from bridge.run.host import Host
    from tools.virtual.run import VirtualRun

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("target")]

MODEL = RobotModel()
PITS = {
    "in the middle": [[1.0, 0.9], [1.4, 0.9], [1.4, 1.3], [1.0, 1.3]],
    "at a wall": [[1.2, 0.0], [1.7, 0.0], [1.7, 0.35], [1.2, 0.35]],
    "stairs down": [[2.0, 0.0], [2.4, 0.0], [2.4, 2.2], [2.0, 2.2]],
}


@pytest.mark.parametrize("seed", seeds(1, 1, first=1))
@pytest.mark.parametrize("pit", PITS)
def test_a_pit_is_swept_around_and_not_driven_into(pit: str, seed: int) -> None:
    walls = [[0.0, 0.0], [2.4, 0.0], [2.4, 2.2], [0.0, 2.2]]
    room = {"name": "pit", "walls": walls, "obstacles": [], "start": [0.3, 0.3, 0.2]}
    plan = parse_floorplan(json.dumps({**room, "cliffs": [PITS[pit]]}))
    runs: list[VirtualRun] = []
    fell: list[float] = []

    def look(t_s: float, host: Host) -> None:
        del host
        if wheel_over(runs[0].device.plant.pose, 0.5 * MODEL.wheel_base_m, plan.cliffs):
            fell.append(t_s)

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
    ending = run.host.mission.ending
    assert fell == []
    assert ending is not None
    assert ending.outcome == "complete"
    report = run.track.report(None)
    assert report.coverage.mouth_sweepable > 0.94
    assert report.time_ratio < 3.0
