"""The recovery planner with the whole stack, in the rooms of the project."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.session.records import EventRecord
from tools.cli.rooms import load_room
from tools.virtual.run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.run.host import Host
    from bridge.session.records import Record

pytestmark = pytest.mark.slow

MODEL = RobotModel()


@pytest.mark.usefixtures("target")
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
    """Stores the times of heading fixes (runs along a known wall) and of contacts."""

    def __init__(self) -> None:
        self.measurements_s: list[float] = []
        self.contacts_s: list[float] = []

    def write(self, record: Record) -> None:
        if not isinstance(record, EventRecord):
            return
        at_s = (record.log_ns - EPOCH_NS) / 1e9
        if record.kind == "heading-fix":
            self.measurements_s.append(at_s)
        if record.kind == "bump":
            self.contacts_s.append(at_s)

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        del summary


SEEDS = (
    *(1, 2),
    *(pytest.param(seed, marks=pytest.mark.nightly) for seed in (3, 4, 5, 6, 7, 8)),
)
"""Seeds 1 to 8."""


@pytest.mark.parametrize("seed", SEEDS)
def test_in_open_floor_gyro_vibration_sends_the_robot_to_a_known_wall(seed: int) -> None:
    reported = Decisions()
    sigmas: list[tuple[float, float]] = []

    def look(t_s: float, host: Host) -> None:
        sigmas.append((t_s, math.degrees(host.localisation.heading_sigma_rad)))

    plan = load_room("empty")
    run_virtual(
        plan, MODEL, "recovery", reported, seed=seed, noise="harsh", max_time_s=290.0, progress=look
    )
    last_s = sigmas[-1][0]
    whole = [begun_s for begun_s in reported.measurements_s if begun_s < last_s - 25.0]
    assert whole, "the gyro's walk at harsh takes the heading beyond its limit in 290 s"
    assert len(reported.measurements_s) < 8, "not again and again"
    for begun_s in reported.measurements_s:
        assert max(sigma for t_s, sigma in sigmas if begun_s - 1.5 < t_s <= begun_s) > 0.75
    for begun_s in whole:
        if any(begun_s < t_s < begun_s + 10.0 for t_s in reported.contacts_s):
            continue  # the filter gives less weight to wall lines within 0.4 m of a contact
        assert min(sigma for t_s, sigma in sigmas if begun_s < t_s < begun_s + 25.0) < 0.6
    assert max(sigma for _, sigma in sigmas) < 1.5, "it is never left to grow"
