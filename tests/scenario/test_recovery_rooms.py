"""The recovery planner over the whole stack, in rooms that ship with the virtual sweeper."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.telemetry import EventRecord
from tools.rooms import load_room
from tools.virtual_run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.host import Host
    from bridge.telemetry import Record

pytestmark = pytest.mark.slow

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


class Decisions:
    """Keeps the moments at which a run set out for a wall."""

    def __init__(self) -> None:
        self.sights_s: list[float] = []

    def write(self, record: Record) -> None:
        if isinstance(record, EventRecord) and record.kind == "sight":
            self.sights_s.append((record.log_ns - EPOCH_NS) / 1e9)

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        del summary


def test_in_the_middle_of_a_room_a_shaken_gyro_sends_the_robot_to_a_known_wall() -> None:
    sights = 0
    for seed in (1, 3, 5, 6):
        told = Decisions()
        doubts: list[tuple[float, float]] = []

        def look(t_s: float, host: Host, seen: list[tuple[float, float]] = doubts) -> None:
            seen.append((t_s, math.degrees(host.heading_doubt_rad)))

        plan = load_room("empty")
        run_virtual(
            plan, MODEL, "recovery", told, seed=seed, noise="harsh", max_time_s=290.0, progress=look
        )
        sights += len(told.sights_s)
        assert len(told.sights_s) < 8, "not again and again"
        for begun_s in told.sights_s:
            before = max(doubt for t_s, doubt in doubts if begun_s - 1.5 < t_s <= begun_s)
            after = [doubt for t_s, doubt in doubts if begun_s < t_s < begun_s + 25.0]
            assert before > 0.75
            if begun_s < doubts[-1][0] - 25.0:
                assert min(after) < 0.6
    assert sights >= 4
