"""Events of the recovery planner: one for each decision, and the final counts at the end."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.coverage.planner import Step
from bridge.coverage.recovery import events
from bridge.coverage.recovery.behaviours.obstacle_following import drive
from bridge.coverage.recovery.occlusions import OccludedRegion
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.evaluation.metrics import CoverageMeter
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, LegResult, StopReason
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, FastRun, run_fast
from support.observed import AT_REST
from support.recovery import context_at
from tools.rooms.generator import generate_room

if TYPE_CHECKING:
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.motion.observation import Observation

MODEL = RobotModel()
PLAN = generate_room(13, np.random.default_rng(13), "legs")


@pytest.fixture(scope="module")
def driven() -> FastRun:
    """Return one run without noise."""
    planner = RecoveryPlanner(MODEL)
    return run_fast(PLAN, planner, MODEL, seed=5, noise=LEVELS["none"], max_time_s=4000.0)


def test_every_chosen_lane_is_reported_as_ended(driven: FastRun) -> None:
    kinds = [event.kind for _, event in driven.events]
    chosen = [k for k, kind in enumerate(kinds) if kind in {"lane", "perimeter"}]
    assert kinds.count("lane") > 10
    for begin, following in zip(chosen, [*chosen[1:], len(kinds)], strict=True):
        reported = kinds[begin + 1 : following]
        end = "lane-end" if kinds[begin] == "lane" else "perimeter-end"
        assert ("blocked" in reported) != (end in reported) or kinds[begin] == "perimeter", reported
        assert {"blocked", end} & set(reported), reported


def test_lanes_report_swept_area_and_the_end_reports_the_rest(driven: FastRun) -> None:
    swept_cm2 = sum(
        float(event.data["new_cm2"]) for _, event in driven.events if event.kind == "lane-end"
    )
    finish = driven.events[-1][1]
    meter = CoverageMeter(PLAN, MODEL, 0.01)
    truth_m2 = meter.measure(driven.poses).coverage.mouth_sweepable * meter.sweepable_m2
    assert finish.kind == "finish"
    assert finish.data["swept_m2"] == pytest.approx(truth_m2, rel=0.05)
    assert 0.3 * truth_m2 < swept_cm2 * 1e-4 < truth_m2, "the outlines swept the rest"
    assert 0.0 <= float(finish.data["left_cm2"]) * 1e-4 < 0.05 * truth_m2
    found = sum(event.kind == "occlusion" for _, event in driven.events)
    closed = sum(event.reason.startswith("occluded region closed") for _, event in driven.events)
    assert found > closed > 0
    assert finish.data["occlusions_open"] == found - closed


def test_a_second_plan_does_not_report_the_end_of_the_first() -> None:
    planner = RecoveryPlanner(MODEL)
    planner.record.end_figures = {"swept_m2": 1.0}
    planner.start(observed(0.0))
    assert planner.record.end_figures == {}


def observed(uncertainty_deg: float, time_s: float = 0.0) -> Observation:
    """Return an observation without obstacles and with an uncertain heading."""
    return AT_REST._replace(time_s=time_s, heading_sigma_rad=math.radians(uncertainty_deg))


def seen(context: RecoveryContext, *uncertainties_deg: float) -> list[tuple[float, float]]:
    """Return the standard deviations before and after, as reported."""
    for k, uncertainty_deg in enumerate(uncertainties_deg):
        context.monitor.observe(observed(uncertainty_deg, 0.02 * k))
    reported = [event for event in context.record.drain() if event.kind == "re-zero"]
    return [(float(e.data["before_deg"]), float(e.data["uncertainty_deg"])) for e in reported]


def test_a_wall_that_gives_the_heading_is_reported_once() -> None:
    context = context_at()
    assert seen(context, 0.2, 0.4, 0.8, 0.39, 0.38, 0.3) == [(0.8, 0.39)]
    assert seen(context, 0.5, 0.2) == [(0.5, 0.2)], "and again, once it has grown again"


def test_a_heading_that_was_hardly_uncertain_or_hardly_helped_is_not_reported() -> None:
    assert seen(context_at(), 0.29, 0.05) == []
    assert seen(context_at(), 0.8, 0.41) == []


@pytest.mark.parametrize("reason", [StopReason.RANGE, StopReason.BUMPER, StopReason.CLIFF])
def test_an_obstacle_that_ended_a_lane_is_reported_once(reason: StopReason) -> None:
    context, leg = context_at(), Drive(0.0, 1.0, purpose="lane")
    context.monitor.observe(observed(0.0))
    part = drive(context, leg)
    assert next(part) is leg
    step = Step(LegResult(leg, reason, 0.5, 2.0, Pose2(0.5, 0.25, 0.0)), observed(0.0))
    with suppress(StopIteration):
        part.send(step)
    reported = [(event.kind, event.reason) for event in context.record.drain()]
    assert reported == [
        ("lane-end", f"lane ended early: {reason}"),
        ("obstacle", f"lane ended: {reason}"),
    ]


def test_the_end_of_a_leg_is_reported_with_its_place() -> None:
    leg = Drive(0.0, 1.0, purpose="lane")
    result = LegResult(leg, StopReason.RANGE, 0.5, 2.0, Pose2(0.5, 0.25, 0.0))
    ended = events.lane_ended(result, 0.0123)
    assert (ended.kind, ended.reason) == ("lane-end", "lane ended early: range")
    assert ended.data == {"length_m": 0.5, "new_cm2": 123}
    met = events.obstacle_found(result)
    assert (met.kind, met.reason) == ("obstacle", "lane ended: range")
    assert met.data == {"x_m": 0.5, "y_m": 0.25}


@pytest.mark.parametrize(
    ("arrived", "closed", "reason"),
    [
        (False, False, "no path to the occluded region"),
        (True, True, "occluded region closed: at least half of it swept"),
        (True, False, "occluded region partly swept"),
    ],
)
def test_result_of_a_recovery(reason: str, *, arrived: bool, closed: bool) -> None:
    occlusion = OccludedRegion(4, 0.0, 0.0, 0.0, 1.0, -0.1)
    reported = events.recovery_ended(occlusion, 0.02, arrived=arrived, closed=closed)
    assert (reported.kind, reported.reason) == ("recovery-end", reason)
    assert reported.data == {"occlusion": 4, "left_m": 0.0, "new_cm2": 200}
