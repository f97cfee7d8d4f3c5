"""Cliffs: the stored evidence, the forbidden positions of the axle, and the reaction."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.coverage.planner import Step
from bridge.coverage.recovery.behaviours.obstacle_following import drive, follow_obstacle
from bridge.coverage.recovery.behaviours.perimeter import follow_perimeter, turn
from bridge.coverage.recovery.cliffs import SPAN_RAD, Cliffs
from bridge.coverage.recovery.geometry import PlannerGeometry
from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.search import Chooser
from bridge.coverage.recovery.window import Buffers, SearchWindow
from bridge.motion.control.braking import Braking
from bridge.motion.control.hidden_ahead import HiddenAheadTuning
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, FollowWall, Leg, LegResult, StopReason, Turn
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST
from support.recovery import choose, context_at

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.motion.observation import Observation

MODEL = RobotModel()
OPTIONS = RecoveryOptions()
GEOMETRY = PlannerGeometry.from_model(MODEL, OPTIONS)
QUARTER = 0.5 * math.pi
ORIGIN = Pose2(0.0, 0.0, 0.0)
BRAKE = Braking(0.3, 0.1)
SPOT_M = MODEL.radius_m - 0.01
AHEAD_M, ASIDE_M = SPOT_M * math.cos(SPAN_RAD), SPOT_M * math.sin(SPAN_RAD)


def seen(pose: Pose2, time_s: float = 0.0, *, cliff: bool = False) -> Observation:
    return AT_REST._replace(time_s=time_s, pose=pose, v_m_s=0.2, cliff=cliff)


def nowhere(x_m: float, y_m: float) -> bool:
    del x_m, y_m
    return False


def open_at(memory: EvidenceMap, x_m: float, y_m: float) -> bool:
    rows, cols = memory.shape
    window = SearchWindow(memory, (0, rows, 0, cols), 2, Buffers())
    return bool(window.open[window.cell(x_m, y_m)] > 0)


def test_the_spots_may_all_be_without_a_floor() -> None:
    edges = Cliffs(OPTIONS, GEOMETRY)
    assert not edges
    edges.add(ORIGIN, nowhere)
    assert edges
    assert edges.marks == [
        pytest.approx((AHEAD_M, -ASIDE_M, 0.0)),
        pytest.approx((SPOT_M, 0.0, 0.0)),
        pytest.approx((AHEAD_M, ASIDE_M, 0.0)),
    ]
    edges.add(Pose2(0.01, 0.0, 0.1), nowhere)
    assert len(edges.poses) == len(edges.rims) == 1, "the same once more"
    edges.add(Pose2(0.01, 0.0, 0.4), nowhere)
    assert len(edges.poses) == 2


def test_a_spot_where_the_robot_was_has_a_floor_unless_all_had() -> None:
    edges = Cliffs(OPTIONS, GEOMETRY)
    edges.add(ORIGIN, lambda _x, y: y > 0.05)
    assert len(edges.marks) == 2
    assert all(mark.y_m < 0.05 for mark in edges.marks)
    edges = Cliffs(OPTIONS, GEOMETRY)
    edges.add(ORIGIN, lambda _x, _y: True)
    assert len(edges.marks) == 3, "one of them is wrong"


@pytest.mark.parametrize(
    ("x_m", "y_m", "left"),
    [
        (0.03, 0.0, 0),  # all three barriers have detected floor
        (0.03, 2.0 * ASIDE_M, 2),  # the right barrier is where the left barrier was
        (0.0, 0.0, 3),
        (-0.02, 0.0, 3),  # the robot backs off: floor before an edge
        (0.08, 0.0, 3),
        (0.03, 0.03, 3),
    ],
)
def test_floor_that_is_seen_beyond_is_there(x_m: float, y_m: float, left: int) -> None:
    for turned in (0.0, 2.0):
        edges = Cliffs(OPTIONS, GEOMETRY)
        edges.add(Pose2(1.0, 2.0, turned), nowhere)
        at = Pose2(1.0, 2.0, turned).transform(x_m, y_m)
        edges.see_floor(Pose2(*at, turned))
        assert len(edges.marks) == left


def test_abandoned_targets_are_removed() -> None:
    edges = Cliffs(OPTIONS, GEOMETRY)
    edges.add(ORIGIN, nowhere)
    edges.add(Pose2(1.0, 0.0, 0.0), nowhere)
    edges.clear(Pose2(0.1, 0.0, 0.0), 0.3)
    assert edges.poses == [Pose2(1.0, 0.0, 0.0)]
    assert edges.rims == [pytest.approx((1.0 + MODEL.radius_m, 0.0))]
    assert len(edges.marks) == 3
    assert not edges.beside(0.2, 0.0, 0.3)
    assert edges.beside(1.2, 0.0, 0.3)


@pytest.mark.parametrize(("away_m", "slow"), [(0.3, True), (0.45, True), (0.55, False)])
def test_near_a_known_cliff_the_robot_drives_slowly(away_m: float, *, slow: bool) -> None:
    memory = EvidenceMap(MODEL, RecoveryOptions(), ORIGIN)
    memory.add_cliff(ORIGIN)
    pace = memory.speed_limit_m_s(
        Pose2(away_m, 0.0, 0.0), 0, BRAKE, HiddenAheadTuning().contact_m_s
    )
    assert pace == pytest.approx(0.10 if slow else MODEL.max_speed_m_s)


def driven(*, to_m: float = 0.0, path_m: float, y_m: float = 0.01) -> EvidenceMap:
    """Return the map after a path along x."""
    memory = EvidenceMap(MODEL, RecoveryOptions(), Pose2(to_m - path_m, y_m, 0.0))
    for k in range(round(100 * path_m) + 1):
        memory.update(seen(Pose2(to_m - path_m + 0.01 * k, y_m, 0.0), 0.05 * k))
    return memory


def test_the_wheels_avoid_possibly_missing_floor_even_where_the_axle_was() -> None:
    memory = driven(path_m=0.5)
    assert open_at(memory, -0.03, 0.01)
    memory.add_cliff(ORIGIN)
    for y_m in (0.0, 0.02):  # the two rows on either side of its path
        assert not open_at(memory, SPOT_M - GEOMETRY.cliff_m + 0.02, y_m), (
            "though it has been there"
        )
    assert open_at(memory, SPOT_M - GEOMETRY.cliff_m - 0.03, 0.01)
    # beside the outer barriers the wheels might pass over an edge
    assert not open_at(memory, AHEAD_M, ASIDE_M + 0.19)
    assert open_at(memory, AHEAD_M, ASIDE_M + 0.25)
    assert not memory.clear_bumps(0.2), "it is no bump"
    assert not open_at(memory, AHEAD_M, ASIDE_M + GEOMETRY.cliff_m - 0.03)
    # even if the barrier becomes known, the mark of all of them stays
    memory.cliffs.marks.clear()
    assert not open_at(memory, 0.10, 0.01)
    assert open_at(memory, 0.10, 0.15)
    memory.clear(ORIGIN, 0.3, 0.6)
    assert open_at(memory, 0.10, 0.01)


@pytest.mark.parametrize(("y_m", "marks"), [(ASIDE_M + 0.07, 2), (ASIDE_M + 0.13, 3)])
def test_where_the_robot_was_beside_a_spot_there_is_floor(y_m: float, marks: int) -> None:
    memory = driven(to_m=0.3, path_m=0.6, y_m=y_m)
    memory.add_cliff(ORIGIN)
    assert len(memory.cliffs.marks) == marks


def test_floor_beyond_clears_a_forbidden_place() -> None:
    memory = EvidenceMap(MODEL, RecoveryOptions(), ORIGIN)
    memory.add_cliff(ORIGIN)
    beside_m = ASIDE_M + GEOMETRY.cliff_m - 0.03
    memory.update(seen(Pose2(0.03, 0.0, 0.0), 1.0, cliff=True))
    assert not open_at(memory, AHEAD_M, beside_m)
    memory.update(seen(Pose2(0.03, 0.0, 0.0), 1.1))
    assert open_at(memory, AHEAD_M, beside_m)


def test_a_robot_within_a_cliffs_margin_is_not_walled_in() -> None:
    """A former place that is now forbidden does not mean that the evidence is wrong."""
    memory = driven(path_m=3.0)
    memory.attempts[:] = 9  # nothing remains to be swept
    for k in range(13):
        memory.add_cliff(Pose2(-0.2 * k, 0.0, QUARTER))
    chooser = Chooser(RecoveryOptions())
    assert choose(chooser, memory, Pose2(-3.0, 0.01, 0.0), 0.0) is None
    assert not chooser.enclosed


def test_beside_a_cliff_a_lane_is_chosen_and_no_perimeter_pass() -> None:
    memory = driven(path_m=0.5)
    kinds = []
    for edge in (False, True):
        if edge:
            memory.add_cliff(ORIGIN)
        else:
            memory.block(MODEL.radius_m, 0.0, 0.1)
        choice = choose(Chooser(RecoveryOptions()), memory, Pose2(-0.1, 0.01, 0.0), 0.0)
        assert choice is not None
        kinds.append(choice.kind)
        memory.clear(ORIGIN, 0.0, 0.5)
    assert kinds == ["perimeter", "lane"]


def test_no_perimeter_pass_is_begun_beside_a_cliff() -> None:
    memory = EvidenceMap(MODEL, RecoveryOptions(), ORIGIN)
    rows, cols = memory.shape
    window = SearchWindow(memory, (0, rows, 0, cols), 2, Buffers())
    window.paths[:] = 7
    assert window.perimeter_lengths is window.paths
    memory.add_cliff(ORIGIN)
    window = SearchWindow(memory, (0, rows, 0, cols), 2, Buffers())
    window.paths[:] = 7
    rim = window.cell(MODEL.radius_m, 0.0)
    ways = window.perimeter_lengths
    assert ways[rim] == -1
    assert ways[rim[0] + 20, rim[1]] == -1
    assert ways[rim[0] + 22, rim[1]] == 7
    assert window.paths[rim] == 7, "lanes may begin there"


def ends(context: RecoveryContext, leg: Leg, x_m: float, time_s: float, *, cliff: bool) -> Step:
    """Return the end of the leg at this place."""
    reason = StopReason.CLIFF if isinstance(leg, FollowWall) else StopReason.DISTANCE
    if isinstance(leg, Drive) and (leg.distance_m or 1.0) > 0.0:
        reason = StopReason.CLIFF
    pose = Pose2(x_m, 0.0, 0.0)
    obs = seen(pose, time_s, cliff=cliff)
    context.monitor.observe(obs)
    return Step(LegResult(leg, reason, 0.0, 1.0, pose), obs)


@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize("backs", [1, 2, 4])
def test_the_robot_backs_off_until_there_is_floor_and_follows_nothing(
    backs: int, *, follows: bool
) -> None:
    """It marks where the floor was first missed, not where the robot stopped."""
    context = context_at(seen(ORIGIN))
    part: Generator[Leg, Step, object] = follow_perimeter(context, left=True)
    if not follows:
        part = drive(context, Drive(0.0, 2.0, purpose="lane"))
    leg = next(part)
    context.monitor.observe(seen(Pose2(0.40, 0.0, 0.0), 1.0))
    context.monitor.observe(seen(Pose2(0.41, 0.0, 0.0), 1.1, cliff=True))
    legs = []
    try:
        leg = part.send(ends(context, leg, 0.45, 1.3, cliff=True))
        for k in range(1, 9):
            legs.append(leg)
            leg = part.send(ends(context, leg, 0.45 - 0.03 * k, 1.3 + k, cliff=k < backs))
    except StopIteration:
        pass
    ways = [leg.distance_m for leg in legs if isinstance(leg, Drive)]
    assert ways == [-0.03] * backs + [-0.05]
    assert {leg.purpose for leg in legs} == {"back-off"}
    assert context.evidence_map.cliffs.poses == [Pose2(0.41, 0.0, 0.0)]


def test_backing_off_ends_if_no_floor_is_found() -> None:
    """A person holds the robot up."""
    context = context_at(seen(ORIGIN))
    part = drive(context, Drive(0.0, 2.0, purpose="lane"))
    leg = next(part)
    count = 0
    try:
        while count < 50:
            leg = part.send(ends(context, leg, -0.03 * count, 1.0 + count, cliff=True))
            count += 1
    except StopIteration:
        pass
    assert count == 5


def test_the_robot_backs_off_from_a_cliff_that_appears_in_a_turn_and_turns_on() -> None:
    """A corner of a pit can be between two barriers, and nearer than the wheels."""
    context = context_at(seen(ORIGIN))
    part = turn(context, QUARTER)
    leg = next(part)
    appeared = Pose2(0.0, 0.0, 0.5)
    context.monitor.observe(seen(appeared, 1.0, cliff=True))
    obs = context.obs
    legs = [part.send(Step(LegResult(leg, StopReason.CLIFF, 0.0, 1.0, appeared), obs))]
    for k, pose in enumerate((Pose2(-0.026, -0.014, 0.5), Pose2(-0.07, -0.038, 0.5))):
        legs.append(part.send(ends_at(context, legs[-1], pose, 2.0 + k)))
    first, second, last = legs
    back_m_s = context.options.back_off_m_s
    assert first == Drive(0.5, -0.03, speed_m_s=back_m_s, purpose="back-off")
    assert second == Drive(0.5, -0.05, speed_m_s=back_m_s, purpose="back-off")
    assert last == Turn(QUARTER, flowing=True, ends_at_cliff=True)
    assert context.evidence_map.cliffs.poses == [appeared]
    with pytest.raises(StopIteration):
        part.send(ends_at(context, last, Pose2(-0.07, -0.038, QUARTER), 5.0))


def ends_at(context: RecoveryContext, leg: Leg, pose: Pose2, time_s: float) -> Step:
    """Return the end of the leg at a pose with floor ahead."""
    context.monitor.observe(seen(pose, time_s))
    reason = StopReason.DONE if isinstance(leg, Turn) else StopReason.DISTANCE
    return Step(LegResult(leg, reason, 0.0, 1.0, pose), context.obs)


def test_a_cliff_is_not_followed() -> None:
    context = context_at(seen(ORIGIN))
    result = LegResult(Drive(0.0, 2.0), StopReason.CLIFF, 0.5, 3.0, Pose2(0.5, 0.0, 0.0))
    with pytest.raises(StopIteration) as ended:
        next(follow_obstacle(context, result))
    assert ended.value.value is False
