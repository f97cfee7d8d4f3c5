"""The recovery planner over the whole stack, in rooms that ship with the virtual sweeper."""

from __future__ import annotations

import pytest

from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from tools.rooms import load_room
from tools.virtual_run import run_virtual

MODEL = RobotModel()


@pytest.mark.parametrize(("room", "noise"), [("case-1", "none"), ("case-2", "typical")])
def test_a_room_is_swept_and_the_run_ends_by_itself(room: str, noise: str) -> None:
    plan = load_room(room)
    run = run_virtual(plan, MODEL, "recovery", NullSink(), seed=1, noise=noise, max_time_s=1200.0)
    ending = run.host.mission.ending
    assert ending is not None
    assert ending.outcome == "complete"
    report = run.track.report(None)
    assert report.coverage.mouth_sweepable > (0.975 if noise == "none" else 0.95)
    assert report.hole_inradius_m < 0.04
    assert report.path_ratio < 1.9
    assert report.time_ratio < 3.5
    assert run.device.plant.truth.collisions < 2.0 * report.sweepable_m2
