"""An obstacle that leaves the ultrasonic's cone is stored, and the robot approaches it slowly."""

from __future__ import annotations

import math

import pytest

from bridge.motion.control.braking import Braking
from bridge.motion.control.hidden_ahead import HiddenAhead, HiddenAheadTuning, contact_speed
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.robot_model import RobotModel

MODEL = RobotModel()
DECEL = 0.3
NOW = Braking(DECEL, 0.0)
BRAKE = Braking(DECEL, MotionTuning().braking.lag_s)
CONTACT_M_S = HiddenAheadTuning().contact_m_s


def test_head_on_the_speed_at_the_touch_is_harmless() -> None:
    # v² = v_contact² + 2·a·d
    assert contact_speed(0.0, 0.26, 0.16, NOW, CONTACT_M_S) == pytest.approx(
        math.sqrt(CONTACT_M_S**2 + 2.0 * DECEL * 0.10)
    )
    assert contact_speed(0.0, 0.16, 0.16, NOW, CONTACT_M_S) == pytest.approx(CONTACT_M_S)


def test_aside_only_the_part_along_the_normal_counts() -> None:
    # The contact is 30° from straight ahead, so the speed along the normal is v·cos 30°.
    aside, ahead = 0.16 * math.sin(math.radians(30)), 0.16 * math.cos(math.radians(30))
    speed = contact_speed(aside, ahead, 0.16, NOW, CONTACT_M_S)
    assert speed * math.cos(math.radians(30)) == pytest.approx(CONTACT_M_S)
    assert contact_speed(0.161, 0.3, 0.16, NOW, CONTACT_M_S) == math.inf
    assert contact_speed(0.0, -0.01, 0.16, NOW, CONTACT_M_S) == math.inf


def drive(
    hidden: HiddenAhead, leg: tuple[float, float], path_m: float, *, turn: float = 0.0
) -> list[float]:
    """Return the allowed speeds towards a leg at (ahead, aside) of the axle, 4 mm a step."""
    speeds = []
    half = 0.5 * MODEL.ultrasonic.cone_rad
    for k in range(round(path_m / 0.004)):
        ahead = leg[0] - 0.004 * k - MODEL.ultrasonic.x_m
        seen = ahead > 0.0 and abs(math.atan2(leg[1], ahead)) < half
        raw = round(math.hypot(ahead, leg[1]), 3) if seen else 3.0 - 0.004 * k
        speeds.append(hidden.update(raw, 0.004 if k else 0.0, turn if k else 0.0))
    return speeds


def test_a_leg_beside_the_beam_is_approached_slowly() -> None:
    hidden = HiddenAhead(MODEL, BRAKE, HiddenAheadTuning())
    # At 8 cm from the axis, the leg leaves the cone 0.61 m before the sensor. The contact is 0.139
    # m ahead of the axle.
    speeds = drive(hidden, (1.2, 0.08), 1.2 - 0.139)
    assert speeds[0] == math.inf
    assert speeds[-1] * math.sqrt(1 - 0.25) < 0.03
    slow = sum(speed < 0.05 for speed in speeds)
    assert slow * 0.004 < 0.05  # slow for the last centimetres only


def test_passed_obstacles_do_not_slow_it() -> None:
    hidden = HiddenAhead(MODEL, BRAKE, HiddenAheadTuning())
    assert min(drive(hidden, (1.9, 0.20), 1.9)) == math.inf


def test_an_echo_that_comes_back_is_not_hidden() -> None:
    hidden = HiddenAhead(MODEL, BRAKE, HiddenAheadTuning())
    hidden.update(0.60, 0.0, 0.0)
    assert hidden.update(None, 0.01, 0.0) < math.inf  # the echo was lost at 0.59 m
    assert hidden.update(0.58, 0.01, 0.0) == math.inf


def test_after_a_turn_its_position_is_unknown() -> None:
    hidden = HiddenAhead(MODEL, BRAKE, HiddenAheadTuning())
    hidden.update(0.40, 0.0, 0.0)
    assert hidden.update(2.0, 0.01, 0.0) < math.inf
    assert hidden.update(2.01, 0.0, 0.2) == math.inf


@pytest.mark.parametrize(("aside_m", "released_m"), [(0.05, 0.134), (0.10, 0.096), (0.13, 0.046)])
def test_a_missing_expected_contact_clears_the_obstacle(aside_m: float, released_m: float) -> None:
    hidden = HiddenAhead(MODEL, BRAKE, HiddenAheadTuning())
    speeds = drive(hidden, (1.2, aside_m), 1.2)
    slow = [k for k, speed in enumerate(speeds) if speed < math.inf]
    # The obstacle is cleared 1 cm after the expected contact of a point 2 cm farther to the side:
    # sqrt(0.16² - (y + 0.02)²) - 0.01.
    assert 1.2 - 0.004 * slow[-1] == pytest.approx(released_m, abs=0.012)
    assert speeds[-1] == math.inf
