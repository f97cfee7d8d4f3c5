"""The decisions of the planners for given results of legs."""

from __future__ import annotations

import itertools
import math
import random

import pytest

from bridge.coverage.baselines.lanes import LaneOptions
from bridge.coverage.baselines.paper import PaperOptions, PaperPlanner
from bridge.coverage.baselines.random_bounce import RandomOptions, RandomPlanner
from bridge.coverage.baselines.u_shape import UShapePlanner
from bridge.coverage.planner import Finish, Planner, PlannerEvent
from bridge.coverage.registry import PLANNERS, UnknownPlannerError, make_planner
from bridge.coverage.runner import PlanRunner
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, Dwell, GoTo, Leg, LegResult, StopReason, Turn
from bridge.motion.observation import HALT, Observation
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST

MODEL = RobotModel()
END = 99


def seen(pose: Pose2, time_s: float = 0.0) -> Observation:
    return AT_REST._replace(time_s=time_s, pose=pose)


class Corridor:
    """Returns leg results: lanes end after listed distances, side steps are complete by default."""

    def __init__(self, planner: Planner, lanes: list[float], blocked: dict[int, float]) -> None:
        self.planner, self.lanes, self.blocked = planner, list(lanes), blocked
        self.pose = Pose2(0.0, 0.0, 0.0)
        self.log: list[tuple[str, float, float]] = []
        self.steps = 0
        self.finish: str | None = None
        self.events: list[PlannerEvent] = []
        leg = planner.start(seen(self.pose))
        for _ in range(500):
            self.events += planner.drain_events()
            if isinstance(leg, Finish):
                self.finish = leg.reason
                return
            if isinstance(leg, Drive) and leg.purpose == "lane" and not self.lanes:
                return
            result = self.answer(leg)
            leg = planner.next(result, seen(self.pose))
        pytest.fail("no end")

    def answer(self, leg: Leg) -> LegResult:
        if isinstance(leg, Turn):
            self.pose = self.pose._replace(theta_rad=leg.heading_rad)
            return LegResult(leg, StopReason.DONE, 0.0, 1.0, self.pose)
        if isinstance(leg, Dwell):
            return LegResult(leg, StopReason.DONE, 0.0, leg.duration_s, self.pose)
        if isinstance(leg, GoTo):
            self.log.append(("goto", leg.x_m, leg.y_m))
            self.pose = Pose2(leg.x_m, leg.y_m, self.pose.theta_rad)
            return LegResult(leg, StopReason.DONE, 1.0, 1.0, self.pose)
        assert isinstance(leg, Drive)
        if leg.distance_m is None:
            distance, reason = self.lanes.pop(0), StopReason.RANGE
            self.log.append(("lane", round(self.pose.y_m, 6), distance))
        else:
            distance, reason = leg.distance_m, StopReason.DISTANCE
            if self.steps in self.blocked:
                distance, reason = self.blocked[self.steps], StopReason.BUMPER
            if leg.purpose == "step":
                self.steps += 1
                self.log.append(("step", round(self.pose.y_m, 6), distance))
        x, y = self.pose._replace(theta_rad=leg.heading_rad).transform(distance, 0.0)
        self.pose = Pose2(x, y, leg.heading_rad)
        return LegResult(leg, reason, distance, 1.0, self.pose)

    def of(self, kind: str) -> list[PlannerEvent]:
        return [e for e in self.events if e.kind == kind]


def paper(options: PaperOptions | None = None) -> PaperPlanner:
    return PaperPlanner(MODEL, options)


def test_case_1_parallel_passage_counts_every_lane() -> None:
    planner = paper()
    Corridor(planner, [2.0, 2.0, 2.0], {})
    state = planner.state
    assert state.case == 1
    assert state.turn_count == 3
    assert state.lane_distance_m == state.previous_lane_distance_m == 2.0


def test_lanes_alternate_and_step_left_by_w() -> None:
    run = Corridor(paper(), [2.0, 2.0, 2.0], {})
    assert [e for e in run.log if e[0] == "lane"] == [
        ("lane", 0.0, 2.0),
        ("lane", 0.16, 2.0),
        ("lane", 0.32, 2.0),
    ]
    right = Corridor(paper(PaperOptions(side="right")), [2.0, 2.0], {})
    assert right.log[-2][:2] == ("lane", -0.16)


def test_case_2_an_obstacle_restarts_the_count() -> None:
    planner = paper()
    run = Corridor(planner, [2.0, 2.0, 1.0], {})
    assert run.of("lane")[-1].data["case"] == 2
    # the turn after this lane is counted already
    assert planner.state.turn_count == 1


def test_a_difference_of_the_diameter_or_less_is_no_case() -> None:
    run = Corridor(paper(), [2.0, 1.70, 2.01, 1.985], {})
    assert [e.data["case"] for e in run.of("lane")] == [1, 0, 0, 0]
    edge = Corridor(paper(), [2.0, 2.0 - 0.3201, 2.0], {})
    assert [e.data["case"] for e in edge.of("lane")] == [1, 2, 3]


def test_case_3_drives_back_by_w_times_t_sweeps_and_returns() -> None:
    # The lanes at 0 and 0.16 m are complete, an obstacle shortens the lanes at 0.32 to 0.80 m, and
    # the lane at 0.96 m is past the obstacle.
    lanes = [2.0, 2.0, 0.5, 0.5, 0.5, 0.5, 2.0]
    planner = paper()
    run = Corridor(planner, [*lanes, 0.7, 0.7, 0.7, 0.7, 2.0], {})
    begin = run.of("recovery-begin")
    assert len(begin) == 1
    assert begin[0].data["length_m"] == pytest.approx(4 * 0.16)
    assert planner.state.length_m == pytest.approx(0.64)
    lane_rows = [row for kind, row, _ in run.log if kind == "lane"]
    assert lane_rows == pytest.approx(
        [0, 0.16, 0.32, 0.48, 0.64, 0.80, 0.96, 0.32, 0.48, 0.64, 0.80, 1.12]
    )
    # The occluded region has four lanes. The last lane ends at the side where the first lane began,
    # so the robot need not drive back along a lane.
    kind, row, distance = run.log[lane_rows.index(0.96) * 2 + 1]
    assert (kind, row) == ("step", 0.96)
    assert distance == pytest.approx(0.64)
    assert not [e for e in run.log if e[0] == "goto"]
    # the recovery resets the count, then two whole steps follow
    assert planner.state.turn_count == 2


def test_after_an_odd_number_of_occluded_lanes_it_drives_back_along_the_lane() -> None:
    lanes = [2.0, 2.0, 0.5, 0.5, 0.5, 2.0]
    run = Corridor(paper(), [*lanes, 0.7, 0.7, 0.7, 2.0], {})
    goto = [e for e in run.log if e[0] == "goto"]
    assert len(goto) == 1
    leave = run.of("recovery-begin")[0].data
    assert goto[0][1:] == pytest.approx((leave["x_m"], leave["y_m"]))
    nearest = Corridor(paper(PaperOptions(return_by="nearest")), [*lanes, 0.7, 0.7, 0.7, 2.0], {})
    assert not [e for e in nearest.log if e[0] == "goto"]


@pytest.mark.parametrize(
    ("options", "turns"),
    [
        (PaperOptions(count_turns="whole_step"), 2),
        (PaperOptions(count_turns="every_turn"), 3),
        (PaperOptions(count_turns="on_equal"), 2),
    ],
)
def test_the_ways_of_counting_differ(options: PaperOptions, turns: int) -> None:
    planner = paper(options)
    # case 2, a blocked step, then equal lanes
    Corridor(planner, [2.0, 0.5, 0.5, 0.5], {1: 0.02})
    assert planner.state.turn_count == turns


@pytest.mark.parametrize(
    ("options", "turns"),
    [
        (PaperOptions(count_turns="on_equal", between="count"), 3),
        (PaperOptions(count_turns="on_equal", between="keep"), 2),
        (PaperOptions(count_turns="on_equal", between="reset"), 0),
    ],
)
def test_differences_between_the_cases_are_an_option(options: PaperOptions, turns: int) -> None:
    planner = paper(options)
    Corridor(planner, [2.0, 2.0, 1.9], {})
    assert planner.state.turn_count == turns


def test_one_slot_no_stack_when_the_occluded_region_is_observed() -> None:
    lanes = [2.0, 2.0, 0.5, 0.5, 2.0, 1.0, 0.3]
    kept = paper()
    overwritten = paper(PaperOptions(recovery_lanes="observed", clear_after_recovery=False))
    Corridor(kept, lanes, {})
    Corridor(overwritten, lanes, {})
    assert kept.state.previous_lane_distance_m == 2.0
    assert overwritten.state.previous_lane_distance_m == 0.3


@pytest.mark.parametrize(
    ("options", "lanes_driven"),
    [
        (PaperOptions(end="blocked_step"), 2),
        (PaperOptions(end="last_partial_lane"), 3),
        (PaperOptions(end="never", max_lanes=5), 5),
        (PaperOptions(both_ends_widths=13.0), 5),
        (PaperOptions(both_ends_widths=13.0, max_blocked=2), 4),
        (PaperOptions(both_ends_widths=12.0, max_blocked=2), 3),
    ],
)
def test_the_ends(options: PaperOptions, lanes_driven: int) -> None:
    run = Corridor(paper(options), [2.0] * END, dict.fromkeys(range(1, END), 0.01))
    assert run.finish is not None
    assert len([e for e in run.log if e[0] == "lane"]) == lanes_driven
    assert run.events[-1].kind == "finish"
    assert run.events[-1].reason == run.finish


def test_being_blocked_twice_in_one_place_is_not_an_end() -> None:
    """The two ends of a lane that is no longer than a step are one place."""
    run = Corridor(paper(), [2.0, 0.05, 2.0, 2.0], {0: 0.01, 1: 0.01})
    assert run.finish is None
    enclosed = Corridor(paper(), [0.01] * END, dict.fromkeys(range(END), 0.0))
    assert enclosed.finish is not None


def test_a_bump_is_a_wall_and_is_backed_off_from() -> None:
    planner = UShapePlanner(MODEL, LaneOptions(rest_s=0.0))
    obs = seen(Pose2(0.0, 0.0, 0.0))
    turn = planner.start(obs)
    assert isinstance(turn, Turn)
    lane = planner.next(LegResult(turn, StopReason.DONE, 0, 1, obs.pose), obs)
    assert isinstance(lane, Drive)
    back = planner.next(LegResult(lane, StopReason.BUMPER, 1.0, 5, obs.pose), obs)
    assert back == Drive(0.0, -0.015, speed_m_s=0.05, purpose="back-off")
    step = planner.next(LegResult(back, StopReason.DISTANCE, -0.015, 1, obs.pose), obs)
    assert step == Turn(math.pi / 2)
    cliff = UShapePlanner(MODEL)
    first = cliff.start(obs)
    assert isinstance(first, Turn)
    lane = cliff.next(LegResult(first, StopReason.DONE, 0, 1, obs.pose), obs)
    assert not isinstance(lane, Finish)
    away = cliff.next(LegResult(lane, StopReason.CLIFF, 1.0, 5, obs.pose), obs)
    assert isinstance(away, Drive)
    assert away.distance_m == -0.05


def test_u_shape_keeps_no_memory() -> None:
    run = Corridor(UShapePlanner(MODEL), [2.0, 2.0, 0.5, 2.0, 2.0], {})
    assert not run.of("recovery-begin")
    assert [row for kind, row, _ in run.log if kind == "lane"] == pytest.approx(
        [0, 0.16, 0.32, 0.48, 0.64]
    )


def test_random_repeats_with_its_seed_and_ends_in_time() -> None:
    def headings(seed: int) -> list[float]:
        planner = RandomPlanner(MODEL, random.Random(seed), RandomOptions(max_time_s=50.0))
        obs = seen(Pose2(0.0, 0.0, 0.0))
        leg = planner.start(obs)
        turns: list[float] = []
        for k in range(1, END):
            if isinstance(leg, Finish):
                assert "50 s" in leg.reason
                return turns
            if isinstance(leg, Turn):
                turns.append(leg.heading_rad)
            obs = seen(obs.pose, 2.0 * k)
            leg = planner.next(LegResult(leg, StopReason.RANGE, 1.0, 2.0, obs.pose), obs)
        pytest.fail("no end")

    assert headings(1) == headings(1)
    assert headings(1) != headings(2)


def test_registry_makes_every_planner_and_names_them_in_its_error() -> None:
    for name, line in PLANNERS.items():
        planner = make_planner(name, MODEL, random.Random(0))
        assert not isinstance(planner.start(seen(Pose2(0, 0, 0))), Finish)
        assert "\n" not in line
    with pytest.raises(UnknownPlannerError, match=r"'spiral'.*paper.*u-shape") as caught:
        make_planner("spiral", MODEL, random.Random(0))
    assert caught.value.name == "spiral"
    assert isinstance(caught.value, ValueError)


def test_next_before_start_is_a_finish() -> None:
    obs = seen(Pose2(0, 0, 0))
    result = LegResult(Turn(0.0), StopReason.DONE, 0.0, 1.0, obs.pose)
    assert isinstance(UShapePlanner(MODEL).next(result, obs), Finish)


class Circling:
    """A planner whose legs end at once."""

    def __init__(self) -> None:
        self.state = PaperPlanner(MODEL).state

    def start(self, obs: Observation) -> Leg | Finish:
        return Drive(obs.pose.theta_rad, 0.0)

    def next(self, result: LegResult, obs: Observation) -> Leg | Finish:
        del obs
        return result.leg

    def drain_events(self) -> list[PlannerEvent]:
        return []


def test_runner_halts_while_paused_and_after_the_end() -> None:
    runner = PlanRunner(UShapePlanner(MODEL), MODEL)
    runner.pause()
    assert runner.step(seen(Pose2(0, 0, 0))) == HALT
    assert runner.legs == 0
    runner.resume()
    commands = [runner.step(seen(Pose2(0, 0, 0.2), 0.02 * k)) for k in range(20)]
    assert commands[-1].v_m_s > 0.0
    legs = runner.legs
    runner.pause()
    assert runner.paused
    # it stops as fast as the acceleration limit allows and no faster, and then stands
    speeds = [commands[-1].v_m_s]
    speeds += [runner.step(seen(Pose2(0, 0, 0.2), 0.40 + 0.02 * k)).v_m_s for k in range(40)]
    falls = [a - b for a, b in itertools.pairwise(speeds)]
    assert max(falls[:-20]) <= MODEL.max_accel_m_s2 * 0.02 + 0.01 + 1e-9
    assert max(falls[:5]) == pytest.approx(MODEL.max_accel_m_s2 * 0.02)
    assert speeds[-20:] == [0.0] * 20
    runner.resume()
    again = runner.step(seen(Pose2(0, 0, 0.2), 60.0))
    # the same leg, from rest
    assert runner.legs == legs
    assert 0.0 < again.v_m_s < commands[-1].v_m_s
    assert not runner.finished
    assert runner.finish_reason is None


def test_runner_survives_a_planner_without_legs() -> None:
    runner = PlanRunner(Circling(), MODEL)
    for k in range(400):
        command = runner.step(seen(Pose2(0, 0, 0), 0.02 * k))
        assert command == HALT
    assert runner.legs > 10
