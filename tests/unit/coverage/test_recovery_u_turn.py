"""The U-turn between two lanes: when it is chosen, and what it drives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.coverage.planner import Step
from bridge.coverage.recovery.behaviours.u_turn import UTurn, offset
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.search import Choice
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, LegResult, StopReason, Turn
from support.observed import AT_REST
from support.recovery import context_at

if TYPE_CHECKING:
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.motion.legs import Leg

OPTIONS = RecoveryOptions()


def context(*, free_m: float = 0.3) -> RecoveryContext:
    """Return a context: the robot at the end of a lane along +x, on swept floor.

    The floor beyond ``free_m`` ahead is not swept.
    """
    made = context_at(AT_REST._replace(pose=Pose2(0.0, 0.0, 0.0)), options=OPTIONS)
    column, _ = made.evidence_map.to_cells(free_m, 0.0)
    made.evidence_map.swept[:, : int(column) + 1] = 1
    return made


def lane(x_m: float, y_m: float, heading_deg: float = 180.0) -> Choice:
    return Choice("lane", ((x_m, y_m),), math.radians(heading_deg), 1.0)


@pytest.mark.parametrize("side", [1, -1])
def test_the_lane_beside_the_robot_is_reached_on_one_arc(side: int) -> None:
    turn = UTurn.into(context(), lane(0.0, side * 0.14))
    assert turn is not None
    assert turn.across_m == pytest.approx(-side * 0.14)
    assert turn.radius_m == pytest.approx(0.07)
    assert turn.ahead_m == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("x_m", "y_m", "heading_deg"),
    [
        (0.0, 0.05, 180.0),  # too near
        (0.0, 0.30, 180.0),  # too far
        (0.9, 0.14, 180.0),  # it begins far ahead
        (-0.5, 0.14, 180.0),  # it begins far behind
        (0.0, 0.14, 90.0),  # another direction
        (0.0, 0.14, 0.0),
    ],
)
def test_other_lanes_need_a_transit(x_m: float, y_m: float, heading_deg: float) -> None:
    assert UTurn.into(context(), lane(x_m, y_m, heading_deg)) is None


def test_the_arc_is_smaller_with_less_floor_ahead() -> None:
    radii = [
        turn.radius_m if (turn := UTurn.into(context(free_m=free_m), lane(0.0, 0.14))) else None
        for free_m in (0.3, 0.055, 0.035, 0.01)
    ]
    assert radii == [pytest.approx(0.07), pytest.approx(0.049), pytest.approx(0.0315), None]


def test_an_obstacle_on_the_path_prevents_the_turn() -> None:
    made = context()
    made.evidence_map.add_point(0.07, 0.10)
    made.evidence_map.add_point(0.07, 0.10)
    made.evidence_map.add_point(0.25, 0.10)
    assert UTurn.into(made, lane(0.0, 0.14)) is None


def legs_of(made: RecoveryContext, turn: UTurn, *reasons: StopReason) -> tuple[list[Leg], bool]:
    """Drive a U-turn; each leg ends exactly. Return the legs and whether it reached the lane."""
    script, step = turn.drive(made), None
    legs: list[Leg] = []
    ends = iter(reasons)
    while True:
        try:
            leg = next(script) if step is None else script.send(step)
        except StopIteration as stop:
            return legs, stop.value
        legs.append(leg)
        pose = made.pose
        if isinstance(leg, Drive):
            assert leg.distance_m is not None
            length = leg.distance_m
            x_m, y_m = Pose2(pose.x_m, pose.y_m, leg.heading_rad).transform(length, 0.0)
            pose = Pose2(x_m, y_m, leg.heading_rad)
        elif isinstance(leg, Turn):
            error = math.remainder(leg.heading_rad - pose.theta_rad, math.tau)
            if error * leg.across_m > 0.0:
                error -= math.copysign(math.tau, error)
            radius = abs(leg.across_m) / (1.0 - math.cos(error))
            side = math.copysign(1.0, error)
            x_m, y_m = pose.transform(
                radius * math.sin(abs(error)), side * radius * (1.0 - math.cos(error))
            )
            pose = Pose2(x_m, y_m, leg.heading_rad)
        obs = made.obs._replace(pose=pose, time_s=made.obs.time_s + 1.0)
        made.monitor.observe(obs)
        reason = next(ends, StopReason.DONE)
        step = Step(
            LegResult(leg, reason, 0.1, 1.0, pose, bumper_left=reason is StopReason.BUMPER), obs
        )


@pytest.mark.parametrize("free_m", [0.3, 0.055])
@pytest.mark.parametrize(("x_m", "side"), [(0.0, 1), (0.0, -1), (-0.1, 1)])
def test_the_legs_lead_to_the_lane(free_m: float, x_m: float, side: int) -> None:
    made = context(free_m=free_m)
    turn = UTurn.into(made, lane(x_m, side * 0.14))
    assert turn is not None
    legs, arrived = legs_of(made, turn)
    assert arrived
    assert made.pose.y_m == pytest.approx(side * 0.14, abs=1e-6)
    assert abs(math.remainder(made.pose.theta_rad - math.pi, math.tau)) < 1e-6
    assert offset(made.pose, turn.choice.begin)[0] == pytest.approx(-x_m, abs=1e-6)
    assert len(legs) == (1 if free_m > 0.1 else 3)
    arcs = [leg.across_m for leg in legs if isinstance(leg, Turn)]
    assert all(across * side < 0.0 for across in arcs)


def test_a_lane_that_begins_ahead_is_reached_by_a_drive_before_the_arc() -> None:
    made = context(free_m=0.5)
    turn = UTurn.into(made, lane(0.2, 0.14))
    assert turn is not None
    legs, arrived = legs_of(made, turn)
    assert arrived
    assert isinstance(legs[0], Drive)
    assert legs[0].distance_m == pytest.approx(0.2)
    assert offset(made.pose, turn.choice.begin)[0] == pytest.approx(0.0, abs=1e-6)


def test_a_contact_ends_the_turn_and_the_robot_backs_off_against_its_heading() -> None:
    made = context()
    turn = UTurn.into(made, lane(0.0, 0.14))
    assert turn is not None
    legs, arrived = legs_of(made, turn, StopReason.BUMPER)
    assert not arrived
    back = legs[1]
    assert isinstance(back, Drive)
    assert back.distance_m is not None
    assert back.distance_m < 0.0
    assert "blocked" in [event.kind for event in made.record.drain()]


def test_a_robot_that_has_passed_the_line_turns_in_place() -> None:
    made = context(free_m=0.055)
    turn = UTurn.into(made, lane(0.0, 0.14))
    assert turn is not None
    script = turn.drive(made)
    leg = next(script)
    for pose in (Pose2(0.05, 0.05, 0.5 * math.pi), Pose2(0.05, 0.15, 0.5 * math.pi)):
        obs = made.obs._replace(pose=pose, time_s=made.obs.time_s + 1.0)
        made.monitor.observe(obs)
        leg = script.send(Step(LegResult(leg, StopReason.DONE, 0.1, 1.0, pose), obs))
    assert isinstance(leg, Turn)
    assert leg.across_m == 0.0
    assert leg.heading_rad == pytest.approx(-math.pi)


def test_a_path_is_swept_only_within_the_map() -> None:
    made = context()
    assert made.evidence_map.is_swept_path([(0.0, 0.0), (0.2, 0.1)])
    assert not made.evidence_map.is_swept_path([(0.0, 0.0), (0.4, 0.0)])
    assert not made.evidence_map.is_swept_path([(0.0, 0.0), (-99.0, 0.0)])
    made.evidence_map.block(0.2, 0.1, 0.03)
    assert not made.evidence_map.is_swept_path([(0.2, 0.1)])
