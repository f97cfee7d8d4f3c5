"""Legs driven in the small world: position, reason and smoothness of their ends."""

from __future__ import annotations

import itertools
import math
import random

import pytest

from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.control.executor import LegExecutor
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, Dwell, FollowWall, GoTo, Leg, LegResult, StopReason, Turn
from bridge.motion.observation import HALT, Observation
from bridge.motion.robot_model import RobotModel
from support.kinematic_world import STEP_S, TYPICAL, KinematicWorld
from support.observed import AT_REST

MODEL = RobotModel()
HALL = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))


def world_at(
    x: float,
    y: float,
    theta: float = 0.0,
    *,
    obstacles: tuple[tuple[tuple[float, float], ...], ...] = (),
) -> KinematicWorld:
    plan = FloorPlan("hall", HALL, obstacles, Pose2(x, y, theta))
    world = KinematicWorld(plan, MODEL, random.Random(1))
    world.rest(0.5)
    return world


class Driver:
    """Runs legs and stores the commands."""

    def __init__(self, world: KinematicWorld) -> None:
        self.world = world
        self.executor = LegExecutor(MODEL)
        self.commands: list[tuple[float, float]] = []
        self.offline: list[float] = []

    def run(self, leg: Leg, limit_s: float = 60.0) -> LegResult:
        obs = self.world.observe()
        self.executor.start(leg, obs)
        for _ in range(round(limit_s / STEP_S)):
            command = self.executor.step(obs)
            result = self.executor.result
            if result is not None:
                return result
            self.commands.append(command)
            obs = self.world.step(command)
            self.offline.append(self.world.truth.y_m)
        pytest.fail(f"{leg} has no result after {limit_s} s")


@pytest.mark.parametrize("distance", [0.16, 1.0, -0.015, -0.3])
def test_drive_stops_at_its_distance(distance: float) -> None:
    driver = Driver(world_at(2.0, 2.0))
    result = driver.run(Drive(0.0, distance))
    assert result.reason is StopReason.DISTANCE
    assert result.distance_m == pytest.approx(distance, abs=0.004)
    assert driver.world.truth.x_m == pytest.approx(2.0 + distance, abs=0.005)


@pytest.mark.parametrize("seed", range(4))
def test_drive_stops_short_of_the_wall_and_does_not_touch_it(seed: int) -> None:
    plan = FloorPlan("hall", HALL, (), Pose2(2.0, 2.0, 0.0))
    world = KinematicWorld(plan, MODEL, random.Random(seed), TYPICAL)
    world.rest(2.0)
    result = Driver(world).run(Drive(0.0, stop_range_m=0.05))
    assert result.reason is StopReason.RANGE
    # the ultrasonic sensor is 4 cm behind the robot's front
    assert 4.0 - MODEL.radius_m - world.truth.x_m == pytest.approx(0.01, abs=0.006)


def test_commands_keep_the_limits_of_the_robot() -> None:
    driver = Driver(world_at(1.0, 2.0))
    driver.run(Drive(0.0, stop_range_m=0.05, speed_m_s=9.0))
    driver.run(Turn(math.pi))
    speeds = [c[0] for c in driver.commands]
    rates = [c[1] for c in driver.commands]
    assert max(speeds) <= MODEL.max_speed_m_s
    assert max(abs(r) for r in rates) <= MODEL.max_yaw_rate_rad_s
    steps = [abs(b - a) for a, b in itertools.pairwise(speeds)]
    # The last step to zero may be as large as the speed limit for standstill.
    assert max(steps) <= MODEL.max_accel_m_s2 * STEP_S + 0.01


def test_it_slows_down_before_a_wall() -> None:
    driver = Driver(world_at(1.0, 2.0))
    driver.run(Drive(0.0, stop_range_m=0.05))
    assert max(c[0] for c in driver.commands) == pytest.approx(0.2, abs=1e-3)
    moving = [c[0] for c in driver.commands if c[0] > 0.0]
    assert moving[-1] < 0.05


def test_drive_returns_to_its_line_after_a_wrong_start_heading() -> None:
    driver = Driver(world_at(0.5, 2.0, math.radians(8)))
    result = driver.run(Drive(0.0, 2.0))
    assert max(abs(y - 2.0) for y in driver.offline) < 0.03
    assert result.pose.y_m == pytest.approx(2.0, abs=0.002)
    assert result.pose.theta_rad == pytest.approx(0.0, abs=0.01)


def test_backing_off_holds_the_line_too() -> None:
    driver = Driver(world_at(3.0, 2.0, math.radians(5)))
    result = driver.run(Drive(0.0, -1.5))
    assert result.pose.y_m == pytest.approx(2.0, abs=0.005)


def test_a_bump_halts_at_once_without_a_ramp() -> None:
    # a post outside the ultrasonic's cone
    post = ((3.0, 2.10), (3.05, 2.10), (3.05, 2.15), (3.0, 2.15))
    driver = Driver(world_at(1.0, 2.0, obstacles=(post,)))
    result = driver.run(Drive(0.0, stop_range_m=0.05))
    assert result.reason is StopReason.BUMPER
    assert result.bumper_left
    assert not result.bumper_right
    assert result.reason.blocked
    first_zero = driver.commands.index(HALT, 1)
    assert driver.commands[first_zero - 1][0] > 0.15
    back = driver.run(Drive(0.0, -0.02))
    assert back.reason is StopReason.DISTANCE


def test_a_cliff_ends_a_forward_leg_and_not_one_backwards() -> None:
    world = world_at(2.0, 2.0)
    executor = LegExecutor(MODEL)
    obs = world.observe()._replace(cliff=True)
    executor.start(Drive(0.0, 1.0), obs)
    assert executor.step(obs) == HALT
    obs = obs._replace(time_s=obs.time_s + STEP_S)
    executor.step(obs)
    assert executor.result is not None
    assert executor.result.reason is StopReason.CLIFF
    executor.start(Drive(0.0, -0.1), obs)
    obs = obs._replace(time_s=obs.time_s + STEP_S)
    assert executor.step(obs).v_m_s < 0.0


@pytest.mark.parametrize(("flowing", "within_deg"), [(False, 0.6), (True, 4.0)])
@pytest.mark.parametrize("degrees", [90, -90, 180, 3, -170])
def test_turn_ends_on_its_heading(degrees: float, within_deg: float, *, flowing: bool) -> None:
    driver = Driver(world_at(2.0, 2.0, 0.3))
    target = 0.3 + math.radians(degrees)
    result = driver.run(Turn(target, flowing=flowing))
    assert result.reason is StopReason.DONE
    error = math.remainder(driver.world.truth.theta_rad - target, math.tau)
    assert abs(error) < math.radians(within_deg)
    assert driver.world.truth.distance_m(Pose2(2.0, 2.0, 0.0)) < 1e-9
    turned = sum(c[1] * STEP_S for c in driver.commands)
    assert abs(turned) == pytest.approx(abs(math.radians(degrees)), abs=0.08 if flowing else 0.02)


@pytest.mark.parametrize(("x", "y"), [(3.0, 2.0), (1.0, 2.5), (2.0, 3.0), (2.05, 2.0), (1.2, 1.1)])
def test_go_to_reaches_its_point(x: float, y: float) -> None:
    driver = Driver(world_at(2.0, 2.0))
    result = driver.run(GoTo(x, y))
    assert result.reason is StopReason.DONE
    assert driver.world.truth.distance_m(Pose2(x, y, 0.0)) < 0.012


def test_go_to_stops_before_an_obstacle() -> None:
    box = ((2.8, 1.6), (3.0, 1.6), (3.0, 2.4), (2.8, 2.4))
    driver = Driver(world_at(2.0, 2.0, obstacles=(box,)))
    result = driver.run(GoTo(3.5, 2.0, stop_range_m=0.05))
    assert result.reason is StopReason.RANGE
    assert result.distance_m == pytest.approx(0.8 - MODEL.radius_m - 0.01, abs=0.01)


def test_dwell_stands_still_for_its_time() -> None:
    driver = Driver(world_at(2.0, 2.0))
    result = driver.run(Dwell(0.5))
    assert result.reason is StopReason.DONE
    assert result.duration_s == pytest.approx(0.5, abs=3 * STEP_S)
    assert set(driver.commands) == {HALT}


def frozen(time_s: float) -> Observation:
    """Return an observation of a robot that does not react to commands."""
    return AT_REST._replace(time_s=time_s, pose=Pose2(1.0, 1.0, 0.0))


@pytest.mark.parametrize("leg", [Drive(0.0), Turn(1.0), GoTo(2.0, 1.0), Drive(0.0, -1.0)])
def test_no_motion_for_a_command_is_a_stall(leg: Leg) -> None:
    executor = LegExecutor(MODEL)
    executor.start(leg, frozen(0.0))
    for k in range(1, 200):
        executor.step(frozen(k * STEP_S))
        if executor.result is not None:
            break
    assert executor.result is not None
    assert executor.result.reason is StopReason.STALLED
    assert executor.result.duration_s < 2.5


@pytest.mark.parametrize("leg", [Drive(0.0), GoTo(3.0, 0.2), FollowWall(left=False, gap_m=0.01)])
def test_a_standstill_of_the_robot_with_turning_wheels_ends_a_leg(leg: Leg) -> None:
    world, executor = world_at(2.0, 0.175), LegExecutor(MODEL)
    obs = world.observe()
    executor.start(leg, obs)
    for _ in range(20):
        obs = world.step(executor.step(obs))
        assert executor.result is None
    for _ in range(100):
        obs = world.step(executor.step(obs._replace(stands=True)))
    assert executor.result is not None
    assert executor.result.reason is StopReason.STALLED


def test_a_turn_may_begin_in_contact() -> None:
    world, executor = world_at(2.0, 2.0), LegExecutor(MODEL)
    obs = world.observe()._replace(stands=True)
    executor.start(Turn(1.0), obs)
    while executor.result is None:
        obs = world.step(executor.step(obs))._replace(stands=True)
    assert executor.result.reason is StopReason.DONE


def test_timeout_ends_a_leg() -> None:
    driver = Driver(world_at(2.0, 2.0))
    result = driver.run(Drive(0.0, 1.5, timeout_s=1.0))
    assert result.reason is StopReason.TIMEOUT
    assert 0.0 < result.distance_m < 0.3


def test_a_pause_is_not_counted_as_time() -> None:
    world = world_at(2.0, 2.0)
    executor = LegExecutor(MODEL)
    obs = world.observe()
    executor.start(Drive(0.0, 1.0, timeout_s=3.0), obs)
    executor.step(obs)
    executor.step(obs._replace(time_s=obs.time_s + 100.0))
    assert executor.result is None


def test_nothing_to_do_is_a_halt() -> None:
    executor = LegExecutor(MODEL)
    assert executor.step(frozen(0.0)) == HALT
    assert executor.result is None


def test_a_turn_that_flows_ends_near_its_heading_in_less_time() -> None:
    world = world_at(2.0, 2.0)
    driver = Driver(world)
    begun = len(driver.commands)
    still = driver.run(Turn(math.radians(90)))
    by_rest = len(driver.commands) - begun
    begun = len(driver.commands)
    flowing = driver.run(Turn(math.radians(180), flowing=True))
    assert len(driver.commands) - begun < 0.75 * by_rest
    assert still.reason is flowing.reason is StopReason.DONE
    off = math.remainder(world.truth.theta_rad - math.pi, math.tau)
    assert abs(off) < math.radians(4)
    # the next leg corrects the rest at once
    driver.run(Drive(math.pi, 0.5))
    off = math.remainder(world.truth.theta_rad - math.pi, math.tau)
    assert abs(off) < math.radians(0.5)
    assert world.truth.y_m == pytest.approx(2.0, abs=0.004)


@pytest.mark.parametrize("begin_deg", [90, 180])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("across_m", [0.05, 0.14, 0.3])
def test_an_arc_ends_on_its_line(begin_deg: int, side: int, across_m: float) -> None:
    """The line is to the left (1) or the right of +x; the robot turns towards it."""
    world = world_at(2.0, 2.0, math.radians(side * begin_deg))
    driver = Driver(world)
    result = driver.run(Turn(0.0, flowing=True, across_m=side * across_m))
    assert result.reason is StopReason.DONE
    truth = world.truth
    assert abs(math.remainder(truth.theta_rad, math.tau)) < math.radians(4)
    assert truth.y_m == pytest.approx(2.0 + side * across_m, abs=0.008)
    assert all(v >= 0.0 for v, _ in driver.commands)
    assert all(w * side <= 0.0 for _, w in driver.commands), "one direction"


@pytest.mark.parametrize("met", ["bumper_left", "bumper_right", "cliff"])
def test_a_contact_ends_an_arc(met: str) -> None:
    driver = Driver(world_at(1.0, 2.0))
    executor = driver.executor
    obs = driver.world.observe()
    executor.start(Turn(math.pi, flowing=True, across_m=-0.14), obs)
    for _ in range(25):
        obs = driver.world.step(executor.step(obs))
    assert obs.v_m_s > 0.05
    assert executor.step(obs._replace(**{met: True})) == HALT  # type: ignore[arg-type]
    for _ in range(50):
        obs = driver.world.step(executor.step(obs))
    assert executor.result is not None
    expected = StopReason.CLIFF if met == "cliff" else StopReason.BUMPER
    assert executor.result.reason is expected


@pytest.mark.parametrize(
    ("ends_at_cliff", "at_start", "ends"),
    [(True, False, True), (True, True, False), (False, False, False)],
)
def test_a_cliff_that_appears_during_a_turn_may_end_it(
    *, ends_at_cliff: bool, at_start: bool, ends: bool
) -> None:
    """A turn that begins at a cliff leads away from it."""
    world = world_at(2.0, 2.0)
    executor = LegExecutor(MODEL)
    obs = world.observe()._replace(cliff=at_start)
    executor.start(Turn(math.pi / 2, flowing=True, ends_at_cliff=ends_at_cliff), obs)
    for _ in range(10):
        obs = world.step(executor.step(obs))._replace(cliff=at_start)
    assert obs.yaw_rate_rad_s > 0.5
    assert (executor.step(obs._replace(cliff=True)) == HALT) is ends
    for _ in range(60):
        obs = world.step(executor.step(obs))._replace(cliff=True)
    assert executor.result is not None
    assert executor.result.reason is (StopReason.CLIFF if ends else StopReason.DONE)


@pytest.mark.parametrize("end_m_s", [0.05, 0.12])
def test_a_drive_that_flows_hands_its_speed_on_without_a_jump(end_m_s: float) -> None:
    world = world_at(1.0, 2.0)
    driver = Driver(world)
    result = driver.run(Drive(0.0, 0.6, end_m_s=end_m_s))
    assert result.reason is StopReason.DISTANCE
    assert result.distance_m == pytest.approx(0.6, abs=0.008)
    assert driver.commands[-1][0] == pytest.approx(end_m_s, abs=0.02)
    driver.run(Drive(math.radians(10), 0.3))
    speeds = [v for v, _ in driver.commands]
    rates = [w for _, w in driver.commands]
    assert max(abs(b - a) for a, b in itertools.pairwise(speeds)) < (
        MODEL.max_accel_m_s2 * STEP_S + 0.01
    )
    assert max(abs(b - a) for a, b in itertools.pairwise(rates)) < (
        MODEL.max_yaw_accel_rad_s2 * STEP_S + 0.03
    )
    way = math.hypot(world.truth.x_m - 1.0, world.truth.y_m - 2.0)
    assert 0.85 < way < 0.91


@pytest.mark.parametrize("met", ["bumper_left", "bumper_right", "cliff"])
def test_a_contact_at_the_end_of_a_path_stops_the_robot(met: str) -> None:
    """The previous leg ended in motion: neither a turn nor a brake may continue it."""
    driver = Driver(world_at(1.0, 2.0))
    driver.run(Drive(0.0, 0.6, end_m_s=0.12))
    executor = driver.executor
    obs = driver.world.observe()._replace(**{met: True})  # type: ignore[arg-type]  # by its name
    executor.start(Turn(math.pi / 2, flowing=True), obs)
    executor.step(obs)
    obs = obs._replace(time_s=obs.time_s + STEP_S)
    command = executor.step(obs)
    assert command.v_m_s == 0.0
    assert command.yaw_rate_rad_s > 0.0, "the turn is the way out"

    driver.run(Drive(0.0, 0.6, end_m_s=0.12))
    obs = driver.world.observe()
    assert executor.brake(obs._replace(time_s=obs.time_s + STEP_S)).v_m_s > 0.05
    assert executor.brake(obs._replace(time_s=obs.time_s + 2 * STEP_S, **{met: True})) == HALT  # type: ignore[arg-type]
