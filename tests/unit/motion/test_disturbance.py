"""Slip and collision: the detectors on handmade data, and with the virtual plant."""

from __future__ import annotations

import math
import random

import pytest

from bridge.motion.estimation.disturbance import (
    BumpDetector,
    DisturbanceKind,
    InertialBridge,
    SlipDetector,
)
from support.sim_body import box, room
from support.sim_drive import SimDrive

# ---- the detectors ---------------------------------------------------------------------


def test_a_bump_stands_out_from_vibration() -> None:
    rng = random.Random(1)
    bumps = BumpDetector()
    assert not bumps.moving(50.0, 0.0), "the offset is not known yet"
    for _ in range(100):
        bumps.rest(0.3 + rng.gauss(0, 0.03), -0.2 + rng.gauss(0, 0.03))
    assert bumps.level(0.3, -0.2) == pytest.approx((0.0, 0.0), abs=0.02)
    alarms = sum(bumps.moving(rng.gauss(0, 0.4), rng.gauss(0, 0.4)) for _ in range(20_000))
    assert alarms == 0
    assert bumps.vibration_m_s2 == pytest.approx(0.4, rel=0.15)
    assert bumps.threshold_m_s2 == pytest.approx(6.0 * 0.4, rel=0.15)
    assert bumps.moving(-5.0, 0.0)
    assert bumps.moving(0.0, 5.0)


@pytest.mark.parametrize(
    ("left", "right", "turn", "side"),
    [
        (0.004, 0.006, 0.0, 1),  # straight ahead; the right wheel counts too much
        (0.006, 0.004, 0.0, -1),
        (-0.006, -0.004, 0.0, -1),  # backwards
        (-0.004, 0.004, 0.008, 0),  # a turn in place, also measured by the gyro
        (0.004, 0.00405, 0.0, 0),
    ],
)
def test_the_wheel_that_counts_more_than_the_gyro_allows_slips(
    left: float, right: float, turn: float, side: int
) -> None:
    slips = SlipDetector()
    found = [slips.update(left, right, turn, 0.02) for _ in range(5)]
    assert found[0] == 0, "not by one sample"
    assert found[-1] == side


def test_bridging_ends_when_the_wheels_agree_again() -> None:
    bridge = InertialBridge(0.2)
    assert bridge.push(-10.0, 0.0, 0.0, 0.01) == pytest.approx((0.001, 0.0))
    assert not bridge.has_ended(0.2, 0.02)
    for _ in range(4):
        bridge.push(0.0, 0.0, 0.0, 0.01)
    assert not bridge.has_ended(0.11, 0.02)
    assert not bridge.has_ended(0.1, 0.02)
    assert bridge.has_ended(0.1, 0.02)


def test_a_turning_body_carries_its_velocity_in_the_room() -> None:
    """The room velocity is constant. After half a turn the forward velocity is backward."""
    bridge = InertialBridge(0.1)
    for _ in range(1000):
        bridge.push(0.0, 0.0, math.pi, 0.001)
    assert bridge.vx_m_s == pytest.approx(-0.1, abs=2e-3)
    assert bridge.vy_m_s == pytest.approx(0.0, abs=2e-3)


def test_a_bridge_that_never_agrees_is_a_stall_where_the_body_stands() -> None:
    bridge = InertialBridge(0.2)
    bridge.push(-19.6, 0.0, 0.0, 0.01)
    over = False
    for _ in range(30):
        bridge.push(0.0, 0.0, 0.0, 0.02)
        over = over or bridge.has_ended(0.15, 0.02)
    assert bridge.stalled
    assert not over
    assert bridge.push(1.0, 1.0, 0.0, 0.02) == (0.0, 0.0)


@pytest.mark.parametrize("follows", [True, False])
def test_a_stall_ends_when_body_and_wheels_gain_equal_speed(*, follows: bool) -> None:
    bridge = InertialBridge(0.06)
    bridge.push(-5.0, 0.0, 0.0, 0.01)  # a graze: the speed by acceleration is now too low
    for _ in range(30):
        bridge.push(0.0, 0.0, 0.0, 0.02)
        assert not bridge.has_ended(0.06, 0.02)
    assert bridge.stalled
    reported_m = 0.0
    for k in range(1, 20):
        speed = 0.06 + 0.008 * k  # 0.4 m/s²
        bridge.push(0.4 if follows else 0.0, 0.0, 0.0, 0.02)
        reported_m += 0.02 * speed
        if bridge.has_ended(speed, 0.02):
            break
    # The speed increases by 0.05 m/s until the seventh step. During the end of the stall the path
    # of 5 cm/s was left out.
    assert (k == 7) is follows
    if follows:
        assert reported_m <= bridge.restored_m < reported_m + 0.01
    else:
        assert bridge.restored_m == 0.0


# ---- with the virtual plant ------------------------------------------------------------


def run_into_wall(degrees: float, seed: int, *, accel: bool, push_s: float = 0.15) -> SimDrive:
    """Drive into a wall at 0.2 m/s, at an angle to its normal; push for another ``push_s``."""
    start = (1.3, 2.0, math.radians(degrees))
    plan = room(start, walls=box(0.0, 0.0, 2.0, 4.0))
    drive = SimDrive(plan, "typical", seed, walls=False, accel=accel)
    drive.rest(2.0)
    for _ in range(600):
        drive.step(0.2, 0.0)
        if drive.body.truth.touch_bearings_rad:
            break
    for _ in range(round(100 * push_s)):
        drive.step(0.2, 0.0)
    drive.rest(0.6)
    return drive


@pytest.mark.parametrize("degrees", [0.0, 25.0, -40.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_bump_is_reported_and_bridged(degrees: float, seed: int) -> None:
    felt = run_into_wall(degrees, seed, accel=True)
    blind = run_into_wall(degrees, seed, accel=False)
    assert [d.kind for d in felt.estimator.disturbances][:1] == [DisturbanceKind.BUMP]
    assert blind.estimator.disturbances == ()
    assert not felt.estimator.bridging
    assert felt.errors.position_m[-1] < 0.008
    assert blind.errors.position_m[-1] > 0.02
    felt.estimator.ekf.propagate_covariance()
    sigma = math.sqrt(sum(felt.estimator.covariance[i][i] for i in range(2)))
    assert felt.errors.position_m[-1] < 4.0 * sigma


def test_a_stall_is_reported_and_its_wheels_are_not_used() -> None:
    felt = run_into_wall(0.0, 3, accel=True, push_s=1.5)
    blind = run_into_wall(0.0, 3, accel=False, push_s=1.5)
    kinds = {d.kind for d in felt.estimator.disturbances}
    assert {DisturbanceKind.BUMP, DisturbanceKind.STALL} <= kinds
    assert blind.errors.position_m[-1] > 0.2
    assert felt.errors.position_m[-1] < 0.02


def test_a_stall_that_was_none_costs_no_way() -> None:
    """The robot rolls on and then speeds up, after a jerk in which inertia loses all speed."""
    drive = SimDrive(room((5.0, 5.0, 0.0)), "typical", 5, walls=False)
    drive.rest(2.0)
    for _ in range(100):
        drive.step(0.06, 0.0)
    drive.estimator.on_imu(0.001 * drive.body.tick_ms + 0.005, 0.0, -12.0, 0.0)
    for _ in range(70):
        drive.step(0.06, 0.0)
    kinds = {found.kind for found in drive.estimator.disturbances}
    assert {DisturbanceKind.BUMP, DisturbanceKind.STALL} <= kinds
    for k in range(100):
        drive.step(min(0.06 + 0.004 * k, 0.25), 0.0)
    assert not drive.estimator.bridging
    # half a second at 6 cm/s passed before it counted as a stall; that path is restored
    assert drive.errors.position_m[-1] < 0.036


@pytest.mark.parametrize("into", [1.0, -1.0])
def test_wheels_that_turn_away_from_an_obstacle_count(into: float) -> None:
    """The start is too gentle for the accelerometer, by which the robot would stand still."""
    bridge = InertialBridge(0.1 * into)
    bridge.push(-10.0 * into, 0.0, 0.0, 0.01)
    assert not any(bridge.has_ended(0.05 * into, 0.02) for _ in range(10)), "pushed on: it stands"
    over = [bridge.has_ended(-0.03 * into, 0.02) for _ in range(3)]
    assert over == [False, False, True]
    assert bridge.restored_m == pytest.approx(-0.0018 * into), "what they went back meanwhile"


def test_a_bump_during_a_turn_in_place_has_no_known_direction() -> None:
    """It is not known in which direction the obstacle lies."""
    for v_m_s in (0.03, -0.03):
        bridge = InertialBridge(0.002)
        bridge.push(0.0, 5.0, 0.0, 0.01)
        bridge.push(0.0, -5.0, 0.0, 0.01)
        assert not any(bridge.has_ended(v_m_s, 0.02) for _ in range(5))


@pytest.mark.parametrize("side", [0, 1])
def test_a_slipping_wheel_is_reported_and_the_other_used(side: int) -> None:
    drive = SimDrive(room((5.0, 5.0, 0.0)), "typical", 4, walls=False)
    drive.rest(2.0)
    for _ in range(200):
        drive.step(0.2, 0.0)
    quiet = len(drive.estimator.disturbances)
    assert quiet == 0
    before = drive.errors.position_m[-1]
    gains = [1.0, 1.0]
    gains[side] = 1.3  # a third more turns than the floor passed
    drive.encoder_gain = (gains[0], gains[1])
    for _ in range(200):
        drive.step(0.2, 0.0)
    found = list(drive.estimator.disturbances)
    kinds = [one.kind for one in found]
    assert kinds[0] is (DisturbanceKind.SLIP_RIGHT if side else DisturbanceKind.SLIP_LEFT)
    # 0.4 m were driven; half of a third of it would be 6 cm
    assert drive.errors.position_m[-1] - before < 0.015


@pytest.mark.parametrize("level", ["paper", "typical"])
def test_no_false_alarm_in_a_minute_of_ordinary_driving(level: str) -> None:
    """Starts, stops, turns and lanes without smoothing are harder than any planner drives."""
    drive = SimDrive(room((5.0, 5.0, 0.0)), level, 6, walls=False)
    drive.rest(2.0)
    for heading in (0.0, 0.5, 1.0, 1.5, 0.0):
        drive.turn_to(heading * math.pi)
        drive.straight(1.2)
    assert drive.tick > 4000
    assert drive.estimator.disturbances == ()


def test_a_bump_is_no_vibration_of_the_drive() -> None:
    bumps = BumpDetector()
    for _ in range(100):
        bumps.rest(0.0, 0.0)
    before = bumps.vibration_m_s2
    assert bumps.moving(-25.0, 0.0)
    for ring in (8.0, -4.0, 1.5, -1.0, 0.5):
        bumps.moving(ring, 0.0)
    assert bumps.vibration_m_s2 == before
    # a rough floor is: 0.6 m/s² from sample to sample, for half a minute
    for k in range(3000):
        bumps.moving(0.6 * (-1) ** k, 0.0)
    assert bumps.vibration_m_s2 > 0.5
