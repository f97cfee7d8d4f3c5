"""Wall following by one infrared: the filter's estimate, and the robot's path."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.coverage.recovery.geometry import PlannerGeometry
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.floor_plan.floor_plan import FloorPlan, Polygon
from bridge.motion.control.smoothing import VelocitySmoother
from bridge.motion.control.wall_follow import (
    FollowState,
    FollowStep,
    FollowTuning,
    Side,
    WallFollower,
)
from bridge.motion.estimation.noise_monitor import RangingNoise
from bridge.motion.estimation.wall_track import WallTrack, infrared_sigma_m
from bridge.motion.geometry import Pose2
from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.motion.robot_model import RobotModel
from support.kinematic_world import IDEAL, STEP_S, TYPICAL, KinematicWorld, WorldNoise
from support.observed import AT_REST

MODEL = RobotModel()
FAR = FollowTuning(lookahead_m=0.15, stop_gap_m=0.03, round_rad=math.radians(200.0))
"""Tuning for a robot that keeps off obstacles, and gives up a corner earlier."""
ORIGIN = Pose2(0.0, 0.0, 0.0)
RADIUS_M = MODEL.radius_m
DEGREE = math.radians(1.0)


def box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def column(x: float, y: float, radius: float) -> Polygon:
    turn = math.tau / 48
    return tuple(
        (x + radius * math.cos(i * turn), y + radius * math.sin(i * turn)) for i in range(48)
    )


HALL = box(0.0, 0.0, 6.0, 6.0)


@dataclass
class Followed:
    """A run along walls."""

    world: KinematicWorld
    follower: WallFollower
    steps: list[FollowStep] = field(default_factory=list)
    gaps: list[float] = field(default_factory=list)
    truth: list[Pose2] = field(default_factory=list)
    touch_s: float = 0.0

    @property
    def turned_rad(self) -> float:
        """Return the whole turn, positive to the left."""
        return sum(
            math.remainder(b.theta_rad - a.theta_rad, math.tau)
            for a, b in zip(self.truth, self.truth[1:], strict=False)
        )

    @property
    def states(self) -> list[str]:
        """Return each state once per visit."""
        found: list[str] = []
        for step in self.steps:
            if not found or found[-1] != step.state:
                found.append(step.state)
        return found


def follow(  # noqa: PLR0913 - a room, a start and a command
    start: tuple[float, float, float],
    side: Side,
    distance_m: float,
    seconds: float,
    *,
    obstacles: tuple[Polygon, ...] = (),
    noise: WorldNoise = IDEAL,
    seed: int = 0,
    model: RobotModel = MODEL,
    tuning: FollowTuning = FAR,
    touching: bool = False,
) -> Followed:
    """Drive in the small world, through the velocity smoothing."""
    plan = FloorPlan("t", HALL, obstacles, Pose2(*start))
    world = KinematicWorld(plan, model, random.Random(seed), noise)
    world.rest(1.0)
    run = Followed(world, WallFollower(model, side, distance_m, tuning=tuning))
    if touching:
        run.follower.go_round(0.0, model.radius_m + distance_m)
    smooth_v = VelocitySmoother(MODEL.max_accel_m_s2, 0.6)
    smooth_w = VelocitySmoother(MODEL.max_yaw_accel_rad_s2, 0.6)
    obs = world.observe()
    for _ in range(round(seconds / STEP_S)):
        step = run.follower.step(obs, STEP_S)
        run.steps.append(step)
        if step.state in {FollowState.BLOCKED, FollowState.LOST}:
            break
        v, w = step.command
        obs = world.step(VelocityCommand(smooth_v.update(v, STEP_S), smooth_w.update(w, STEP_S)))
        run.truth.append(world.truth)
        gap, _, _ = world.nearest(world.truth.x_m, world.truth.y_m)
        run.gaps.append(gap - RADIUS_M)
        run.touch_s += STEP_S if world.touching is not None else 0.0
    return run


# ---- the filter ------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [-20.0, 0.0, 10.0])
def test_the_track_learns_the_walls_direction(degrees: float) -> None:
    """A wall at y = 0.24 - along·tan is passed on the left with exact readings."""
    mount, track = MODEL.infrared_left, WallTrack(MODEL.infrared_left)
    yaw = degrees * DEGREE
    x = 0.0
    for i in range(25):
        # heading 0, the wall turned by -yaw: its points are (s, 0.24 - s·tan yaw)
        range_m = 0.24 - (x + mount.x_m) * math.tan(yaw) - mount.y_m
        if i == 0:
            track.begin(range_m)
        else:
            track.move(0.01, 0.0)
            assert track.take(range_m, 4.0, 0.02)
        x += 0.01
    x -= 0.01
    assert track.yaw_rad == pytest.approx(yaw, abs=2.5 * DEGREE)
    assert track.distance_m == pytest.approx((0.24 - x * math.tan(yaw)) * math.cos(yaw), abs=0.005)
    assert track.yaw_sigma_rad < 6.0 * DEGREE
    assert track.distance_sigma_m < 0.006


@pytest.mark.parametrize("radius_m", [0.1, 0.2, 0.4, 1.0])
def test_the_track_learns_the_bend_of_a_column(radius_m: float) -> None:
    """A robot circles a column at a gap of 1 cm. Its beam is 5 cm ahead of the axle."""
    mount, track = MODEL.infrared_left, WallTrack(MODEL.infrared_left)
    from_centre_m = radius_m + RADIUS_M + 0.01
    range_m = from_centre_m - math.sqrt(radius_m**2 - mount.x_m**2) - mount.y_m
    track.begin(range_m)
    for _ in range(150):
        track.move(0.01, 0.01 / from_centre_m)
        assert track.take(range_m, 4.0, 0.02)
    assert track.bend_rad_m == pytest.approx(1.0 / from_centre_m, rel=0.02)
    assert track.yaw_rad == pytest.approx(0.0, abs=0.2 * DEGREE)
    assert track.distance_m == pytest.approx(RADIUS_M + 0.01, abs=0.0015)


@given(
    steps=st.lists(
        st.tuples(st.floats(-0.01, 0.01), st.floats(-0.05, 0.05), st.floats(0.04, 0.3)),
        min_size=1,
        max_size=60,
    )
)
def test_the_track_s_uncertainty_and_bend_stay_valid(
    steps: list[tuple[float, float, float]],
) -> None:
    track = WallTrack(MODEL.infrared_left)
    track.begin(0.1)
    for ahead_m, into_rad, range_m in steps:
        track.move(ahead_m, into_rad)
        taken = track.take(range_m, 4.0, 0.02)
        assert track.distance_m is not None
        assert track.distance_sigma_m >= 0.0
        assert track.yaw_sigma_rad >= 0.0
        if taken:
            assert abs(track.bend_rad_m) * max(track.distance_m, 0.01) <= 0.65 + 1e-9


def test_the_track_turns_with_the_robot() -> None:
    track = WallTrack(MODEL.infrared_left)
    track.begin(0.1)
    before = track.distance_m
    track.move(0.0, 0.2)
    assert track.yaw_rad == pytest.approx(0.2)
    assert track.distance_m == before
    # the beam leaves 5 cm ahead of the axle: (d - mx sin ψ)/cos ψ - |my|
    expected = (0.2 - 0.05 * math.sin(0.2)) / math.cos(0.2) - 0.1
    assert track.expected_m() == pytest.approx(expected)


def test_a_different_surface_is_not_followed() -> None:
    track = WallTrack(MODEL.infrared_right)
    track.begin(0.10, 0.0, 0.01)
    assert not track.take(0.16, 4.0, 0.02)
    assert track.distance_m == pytest.approx(0.20)


def test_infrared_noise_grows_with_the_square_of_the_range() -> None:
    # 1.2 mm left by calibration beside 1.5 mm at 10 cm
    assert infrared_sigma_m(0.1) == pytest.approx(math.hypot(0.0012, 0.0015))
    assert infrared_sigma_m(0.2) == pytest.approx(math.hypot(0.0012, 0.006))


# ---- along walls -----------------------------------------------------------------------


@pytest.mark.parametrize("noise", [IDEAL, TYPICAL])
@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
@pytest.mark.parametrize("degrees", [-12.0, 0.0, 12.0])
def test_it_comes_to_the_set_distance(noise: WorldNoise, side: Side, degrees: float) -> None:
    y = 6.0 - RADIUS_M - 0.12 if side is Side.LEFT else RADIUS_M + 0.12
    run = follow((1.0, y, degrees * DEGREE), side, 0.05, 10.0, noise=noise)
    assert run.states == ["following"]
    settled = run.gaps[200:]
    assert min(run.gaps) > 0.02, "never near touching"
    assert max(abs(gap - 0.05) for gap in settled) < (0.004 if noise is IDEAL else 0.012)
    assert run.truth[-1].x_m > 2.7, "at cruise speed"


def test_the_line_of_a_wall_that_begins_at_a_corner_may_be_nearer_than_the_rim() -> None:
    """The heading is 45° off the wall before its corner, so only the path gives the distance."""
    track = WallTrack(MODEL.infrared_left)
    track.begin(0.11, -45.0 * DEGREE, 0.1)
    first = track.distance_m
    assert first is not None
    assert first < RADIUS_M - 0.03
    track.move(0.01, 0.0, RADIUS_M)
    assert track.distance_m == pytest.approx(first + 0.01 * math.sin(45.0 * DEGREE))


def test_a_noisy_sensor_keeps_it_off_the_wall() -> None:
    """The noise is 3 mm for 600 readings. The gap grows by twice the part above 1.5 mm.

    A good sensor adds nothing.
    """
    rng = random.Random(7)
    noisy, good = RangingNoise(), RangingNoise()
    for _ in range(600):
        noisy.learn(rng.gauss(0.0, 0.003))
        good.learn(rng.gauss(0.0, 0.001))
    assert noisy.stand_off_m == pytest.approx(2.0 * 0.0015, rel=0.2)
    assert good.stand_off_m == 0.0
    good.learn(1.0)
    assert good.stand_off_m < 0.0005, "one surprise is another surface"
    gaps = []
    for noise in (noisy, good):
        follower = WallFollower(MODEL, Side.LEFT, 0.0005, noise=noise)
        steps = [follower.step(sees(0.062), STEP_S) for _ in range(50)]
        gaps.append(steps[-1].command.yaw_rate_rad_s)
    assert gaps[0] < 0.0 < gaps[1], "at 2 mm the one turns off, the other nearer"


@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
def test_light_contact(side: Side) -> None:
    """It makes contact with a low lateral speed, and stays: at most 1.5 cm/s into the wall."""
    y = 6.0 - RADIUS_M - 0.05 if side is Side.LEFT else RADIUS_M + 0.05
    run = follow((0.6, y, 0.0), side, 0.0, 20.0, noise=TYPICAL, seed=3)
    first = next(i for i, gap in enumerate(run.gaps) if gap < 5e-4)
    across = [
        abs(b.y_m - a.y_m) / STEP_S
        for a, b in zip(run.truth[first - 15 :], run.truth[first - 14 : first + 1], strict=False)
    ]
    assert max(across) < 0.03, "a touch, not a collision"
    assert max(run.gaps[first:]) < 0.006
    assert sum(gap < 0.002 for gap in run.gaps[first:]) > 0.6 * len(run.gaps[first:])


def test_a_wall_ahead_blocks_it_before_it_is_touched() -> None:
    run = follow((4.0, RADIUS_M + 0.05, 0.0), Side.RIGHT, 0.05, 20.0, noise=TYPICAL)
    assert run.states == ["following", "blocked"]
    assert run.steps[-1].command == HALT
    gap = 6.0 - run.world.truth.x_m - RADIUS_M
    assert 0.015 < gap < 0.06
    assert run.touch_s == 0.0


@pytest.mark.parametrize("noise", [IDEAL, TYPICAL])
@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
def test_it_goes_round_a_box(noise: WorldNoise, side: Side) -> None:
    """The round has four outer corners and ends at the start, at the set distance all the time."""
    y = 2.5 - RADIUS_M - 0.05 if side is Side.LEFT else 3.5 + RADIUS_M + 0.05
    block = box(2.5, 2.5, 3.5, 3.5)
    run = follow((2.6, y, 0.0), side, 0.05, 40.0, obstacles=(block,), noise=noise)
    assert run.states[:8] == ["following", "corner"] * 4
    assert run.touch_s == 0.0
    assert min(run.gaps) > 0.01
    assert max(run.gaps) < 0.11
    on_wall = [g for g, s in zip(run.gaps, run.steps, strict=False) if s.state == "following"]
    assert sum(abs(gap - 0.05) < 0.015 for gap in on_wall) > 0.8 * len(on_wall)
    # contact with an object at a corner is at 72° off the bow, and harmless
    rounding = [step.command for step in run.steps if step.state == "corner"]
    fastest = max(command.v_m_s for command in rounding)
    assert 0.025 < fastest * math.cos(72.0 * DEGREE) < 0.03
    # at a corner the rim passes 5 mm off; by this rate a planner recognises a corner
    assert (
        fastest / (RADIUS_M + 0.005)
        > PlannerGeometry.from_model(MODEL, RecoveryOptions()).round_rad_s
    )


def test_it_follows_a_round_column() -> None:
    pillar = column(3.0, 3.0, 0.3)
    start = (3.0, 3.0 - 0.3 - RADIUS_M - 0.06, 0.0)
    run = follow(start, Side.LEFT, 0.05, 25.0, obstacles=(pillar,), noise=TYPICAL)
    assert run.turned_rad > math.tau, "all the way round"
    assert run.states == ["following"]
    assert 0.01 < min(run.gaps) <= max(run.gaps) < 0.10


def test_a_thin_leg_is_rounded_and_not_lost() -> None:
    leg = box(2.98, 2.98, 3.02, 3.02)
    start = (2.95, 2.98 - RADIUS_M - 0.05, 0.0)
    run = follow(start, Side.LEFT, 0.05, 15.0, obstacles=(leg,), tuning=FollowTuning())
    assert "lost" not in run.states
    assert run.turned_rad > math.pi
    assert run.touch_s == 0.0
    assert max(run.gaps) < 0.15


@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
@pytest.mark.parametrize("width_m", [0.03, 0.05, 0.06])
def test_a_leg_is_followed_in_contact_all_around(width_m: float, side: Side) -> None:
    """Each corner of the leg presses a switch, and no contact ends the wall following."""
    half = 0.5 * width_m
    leg = box(3.0 - half, 3.0 - half, 3.0 + half, 3.0 + half)
    start = (3.0, 3.0 - side * (half + RADIUS_M + 0.0005), 0.0)
    tuning = FollowTuning()
    run = follow(start, side, 0.0005, 30.0, obstacles=(leg,), tuning=tuning, touching=True)
    assert side * run.turned_rad > math.tau
    assert "blocked" not in run.states
    assert run.touch_s > 0.0
    assert sum(run.gaps) / len(run.gaps) < 0.01


def test_without_a_wall_it_is_lost_and_halts() -> None:
    follower = WallFollower(MODEL, Side.LEFT, 0.05)
    step = follower.step(sees(None), STEP_S)
    assert step == FollowStep(HALT, FollowState.LOST, 0.0)


# ---- what stops it ---------------------------------------------------------------------


def sees(
    left_m: float | None,
    *,
    front_m: float | None = None,
    bumper: tuple[bool, bool] = (False, False),
    cliff: bool = False,
) -> Observation:
    left, right = bumper
    seen = AT_REST._replace(v_m_s=0.2, bumper_left=left, bumper_right=right, cliff=cliff)
    return seen._replace(ultrasonic_m=front_m, infrared_left_m=left_m)


@pytest.mark.parametrize(
    "obs",
    [
        sees(0.11, bumper=(False, True)),
        sees(0.11, bumper=(True, False)),
        sees(0.11, bumper=(True, True)),
        sees(0.11, cliff=True),
        sees(0.11, front_m=0.05),
    ],
)
def test_something_ahead_blocks_at_once(obs: Observation) -> None:
    step = WallFollower(MODEL, Side.LEFT, 0.05).step(obs, STEP_S)
    assert step.state is FollowState.BLOCKED
    assert step.command == HALT


def test_an_echo_out_of_nothing_slows_and_the_next_blocks() -> None:
    """A reading (20 Hz) is held for two or three steps, which make it no more certain."""
    follower = WallFollower(MODEL, Side.LEFT, 0.05)
    fast = follower.step(sees(0.11, front_m=0.60), STEP_S)
    for _ in range(3):
        strange = follower.step(sees(0.11, front_m=0.05), STEP_S)
        assert strange.state is FollowState.FOLLOWING
        assert strange.command.v_m_s <= 0.025 < fast.command.v_m_s
    again = follower.step(sees(0.11, front_m=0.59), STEP_S)
    assert again.command.v_m_s == pytest.approx(fast.command.v_m_s, rel=0.05)
    follower.step(sees(0.11, front_m=0.05), STEP_S)
    assert follower.step(sees(0.11, front_m=0.049), STEP_S).state is FollowState.BLOCKED


@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
def test_after_a_touch_it_drives_slowly_for_eight_centimetres(side: Side) -> None:
    """The direction of the wall is not known yet, even if the infrared detects the wall at once."""
    follower = WallFollower(MODEL, side, 0.0005, speed_m_s=0.24)
    follower.go_round(0.0, RADIUS_M)
    speeds = []
    for k in range(60):
        pose = Pose2(0.002 * k, 0.0, 0.0)
        left_m, right_m = (0.06, None) if side is Side.LEFT else (None, 0.06)
        seen = sees(left_m)._replace(pose=pose, infrared_right_m=right_m)
        step = follower.step(seen, STEP_S)
        assert step.state is FollowState.FOLLOWING
        speeds.append((pose.x_m, step.command.v_m_s))
    assert max(v for x, v in speeds if x < 0.078) <= 0.09
    assert min(v for x, v in speeds if x > 0.084) > 0.2


def test_a_wall_abeam_that_presses_a_bumper_is_avoided_for_half_a_second() -> None:
    follower = WallFollower(MODEL, Side.LEFT, 0.0)
    touching = sees(0.06, bumper=(True, False))
    steps = [follower.step(touching, STEP_S) for _ in range(30)]
    assert [s.state for s in steps[:24]] == [FollowState.FOLLOWING] * 24
    assert all(s.command.yaw_rate_rad_s < 0.0 for s in steps[:24])
    assert steps[-1].state is FollowState.BLOCKED


@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
@pytest.mark.parametrize("taught", [True, False])
def test_a_pressed_bumper_turns_it_away_slowly_for_any_wall_estimate(
    side: Side, *, taught: bool
) -> None:
    """The track has a heading 15° off the wall, or no direction yet. The shell has priority."""
    follower = WallFollower(MODEL, side, 0.0005, speed_m_s=0.24)
    left = side is Side.LEFT
    range_m, pose, yaw_rad = 0.06, ORIGIN, 0.0
    for k in range(25 if taught else 0):  # the range grows as it does in a departure
        range_m, pose = 0.05 + 0.003 * k * math.tan(15.0 * DEGREE), Pose2(0.003 * k, 0.0, 0.0)
        sides = (range_m, None) if left else (None, range_m)
        seen = sees(sides[0])._replace(pose=pose, infrared_right_m=sides[1])
        yaw_rad = follower.step(seen, STEP_S).yaw_rad
    assert (yaw_rad < -8.0 * DEGREE) is taught
    sides = (range_m, None) if left else (None, range_m)
    touching = sees(sides[0], bumper=(left, not left))
    step = follower.step(touching._replace(pose=pose, infrared_right_m=sides[1]), STEP_S)
    assert step.state is FollowState.FOLLOWING
    assert 0.0 < step.command.v_m_s <= 0.05
    assert side * step.command.yaw_rate_rad_s < -0.5


@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
def test_a_touched_chair_leg_is_turned_away_from(side: Side) -> None:
    """It turns away on the spot until the bumper is free, then goes round the leg again."""
    follower = WallFollower(MODEL, side, 0.0005)
    follower.go_round(0.05, RADIUS_M + 0.01)
    left = side is Side.LEFT
    pressed = [
        follower.step(sees(None, bumper=(left, not left)), STEP_S).command for _ in range(20)
    ]
    assert all(c.v_m_s == 0.0 and c.yaw_rate_rad_s * side < 0.0 for c in pressed)
    free = follower.step(sees(None), STEP_S)
    assert free.state is FollowState.CORNER
    assert free.command.v_m_s > 0.05


@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
def test_a_contact_leaves_the_switch_abeam(side: Side) -> None:
    """The robot has turned by 20°, so the contact was at 70°, and not abeam as assumed."""
    follower = WallFollower(MODEL, side, 0.0005)
    follower.go_round(0.0, RADIUS_M + 0.0005)
    left = side is Side.LEFT
    for k in range(20):
        pose = Pose2(0.0, 0.0, -side * k * DEGREE)
        seen = sees(None, bumper=(left, not left))._replace(pose=pose)
        assert follower.step(seen, STEP_S).command.v_m_s == 0.0
    free = follower.step(sees(None)._replace(pose=pose), STEP_S)
    tune, v = FollowTuning(), free.command.v_m_s
    # a circle round the contact, and the way out to the gap to a corner
    away = tune.yaw_gain_s * tune.corner_gap_m / tune.lookahead_m
    expected = v / (RADIUS_M + tune.corner_gap_m) - away
    assert v == tune.corner_m_s
    assert side * free.command.yaw_rate_rad_s == pytest.approx(expected, rel=1e-6)


def test_a_contact_with_a_face_that_the_beam_loses_is_a_corner() -> None:
    """The beam has found the leg's other face, and loses it while the switch is pressed."""
    follower = WallFollower(MODEL, Side.LEFT, 0.0005)
    follower.go_round(0.0, RADIUS_M)
    for left_m in (0.09, 0.10):
        assert follower.step(sees(left_m), STEP_S).state is FollowState.FOLLOWING
    steps = [follower.step(sees(None, bumper=(True, False)), STEP_S) for _ in range(30)]
    assert FollowState.BLOCKED not in {step.state for step in steps}
    assert steps[-1].state is FollowState.CORNER
    assert steps[-1].command.v_m_s == 0.0
    assert steps[-1].command.yaw_rate_rad_s < 0.0


def test_a_contact_that_stays_in_a_turn_of_60_degrees_is_ahead() -> None:
    follower = WallFollower(MODEL, Side.LEFT, 0.0005)
    follower.go_round(0.0, RADIUS_M)
    states = []
    for k in range(66):
        seen = sees(None, bumper=(True, False))
        step = follower.step(seen._replace(pose=Pose2(0.0, 0.0, -k * DEGREE)), STEP_S)
        states.append(step.state)
    assert states.index(FollowState.BLOCKED) == pytest.approx(61, abs=1)


def test_speed_respects_the_distance_to_a_wall_ahead() -> None:
    speeds = []
    for front_m in (2.0, 0.3, 0.15, 0.10):
        step = WallFollower(MODEL, Side.LEFT, 0.05).step(sees(0.11, front_m=front_m), STEP_S)
        speeds.append(step.command.v_m_s)
        room = front_m - (RADIUS_M - MODEL.ultrasonic.x_m) - 0.03
        assert step.command.v_m_s**2 / (2 * MODEL.max_accel_m_s2) < room
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[0] == pytest.approx(MODEL.cruise_speed_m_s, rel=0.05)


@pytest.mark.parametrize(("distance_m", "speed"), [(-0.01, 0.2), (0.25, 0.2), (0.05, 0.0)])
def test_settings_without_meaning_are_rejected(distance_m: float, speed: float) -> None:
    with pytest.raises(ValueError, match="must be"):
        WallFollower(MODEL, Side.LEFT, distance_m, speed_m_s=speed)


def test_an_infrared_ahead_of_the_axle_reads_a_wall_in_contact_as_beside_it() -> None:
    """The wall touches the robot beside the axle, and not where the beam leaves the hull."""
    mount = replace(MODEL.infrared_left, x_m=0.11)
    assert mount.contact_range_m(RADIUS_M) == pytest.approx(0.06)
    model = replace(MODEL, infrared_left=mount)
    run = follow((1.0, 6.0 - RADIUS_M - 0.03, 0.0), Side.LEFT, 0.0005, 15.0, model=model)
    assert max(run.gaps[len(run.gaps) // 2 :]) < 0.004


def test_a_wall_beyond_the_sensor_is_followed_by_contact_if_it_is_not_fitted() -> None:
    mounts = {
        name: replace(getattr(MODEL, name), fitted=False)
        for name in ("infrared_left", "infrared_right")
    }
    WallFollower(replace(MODEL, robot_diameter_m=0.9, **mounts), Side.LEFT, 0.0005)


def test_an_infrared_blind_at_the_hull_keeps_the_gap_that_it_can_measure() -> None:
    """Below the minimum range the reading is constant: at a smaller gap the robot would press."""
    mounts = {
        name: replace(getattr(MODEL, name), min_range_m=0.068)
        for name in ("infrared_left", "infrared_right")
    }
    model = replace(MODEL, **mounts)
    blind_m = 0.068 - model.infrared_left.contact_range_m(RADIUS_M)
    start = (1.0, 6.0 - RADIUS_M - 0.03, 0.0)
    run = follow(start, Side.LEFT, 0.0005, 15.0, model=model)
    settled = run.gaps[len(run.gaps) // 2 :]
    assert blind_m < min(settled)
    assert max(settled) < blind_m + 0.01
    assert run.touch_s == 0.0
