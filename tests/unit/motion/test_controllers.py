"""The paper's controllers, and the differences from the paper's text."""

from __future__ import annotations

import math

import pytest

from bridge.motion.control.pid import Pid, PidGains
from bridge.motion.control.point_to_point import PointToPointController
from bridge.motion.control.rotary import RotaryController
from bridge.motion.control.smoothing import VelocitySmoother
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.estimation.range_filter import RangeAhead
from bridge.motion.geometry import Pose2

TURN_IN_PLACE_RAD = MotionTuning().turn_in_place_rad


def test_pid_is_the_papers_sum() -> None:
    pid = Pid(PidGains(kp=2.0, ti_s=4.0, td_s=0.5))
    assert pid.update(1.0, 0.1) == pytest.approx(2.0 + 0.5 * 0.1)
    # P: 2·3, I: 0.5·(0.1 + 0.3), D: 2·0.5·(3 - 1)/0.1
    assert pid.update(3.0, 0.1) == pytest.approx(6.0 + 0.5 * 0.4 + 20.0)


def test_pid_does_not_wind_up() -> None:
    wound = Pid(PidGains(kp=1.0, ti_s=0.1), limit=1.0)
    for _ in range(500):
        assert wound.update(5.0, 0.02) == 1.0
    assert wound.integral == 0.0
    # The output leaves saturation as soon as the error changes its sign.
    assert wound.update(-0.1, 0.02) < 0.0


def test_pid_integral_removes_a_standing_error() -> None:
    pid = Pid(PidGains(kp=1.0, ti_s=0.5), limit=10.0)
    x = 0.0
    for _ in range(1000):
        x += 0.02 * (pid.update(1.0 - x, 0.02) - 0.7)
    assert x == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    "text",
    [{"kp": math.nan}, {"kp": 1.0, "ti_s": 0.0}, {"kp": 1.0, "td_s": -1.0}],
)
def test_pid_rejects_gains_without_meaning(text: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="PID gains"):
        PidGains(**text)


def test_rotary_crosses_the_seam_and_slows_in_time() -> None:
    rotary = RotaryController(2.0, brake_rad_s2=4.0)
    assert rotary.update(math.radians(-179), math.radians(179), 0.0) > 0.0
    assert rotary.update(1.0, 0.0, 0.0) == pytest.approx(2.0)
    near = RotaryController(2.0, brake_rad_s2=0.1).update(0.05, 0.0, 0.0)
    assert near == pytest.approx(math.sqrt(2 * 0.1 * 0.05))


def test_point_to_point_slows_by_the_cosine() -> None:
    point = PointToPointController(0.3, 1.5, TURN_IN_PLACE_RAD)
    bearing = math.radians(30)
    command = point.update(math.cos(bearing), math.sin(bearing), Pose2(0, 0, 0), 0.02)
    assert command.vx_m_s == pytest.approx(0.3 * math.cos(bearing))
    assert command.distance_m == pytest.approx(1.0)
    assert command.yaw_rate_rad_s > 0.0


@pytest.mark.parametrize("degrees", [46, 90, 179, -60])
def test_point_to_point_turns_in_place_beyond_45_degrees(degrees: float) -> None:
    bearing = math.radians(degrees)
    command = PointToPointController(0.3, 1.5, TURN_IN_PLACE_RAD).update(
        math.cos(bearing), math.sin(bearing), Pose2(0, 0, 0), 0.02
    )
    assert command.vx_m_s == 0.0
    assert command.yaw_rate_rad_s * bearing > 0.0


def test_smoothing_is_a_low_pass_of_its_own_output_then_a_clamp() -> None:
    free = VelocitySmoother(max_accel=100.0, lowpass=0.25)
    assert [free.update(1.0, 0.02) for _ in range(3)] == pytest.approx([0.25, 0.4375, 0.578125])
    held = VelocitySmoother(max_accel=0.5, lowpass=1.0)
    assert [held.update(1.0, 0.02) for _ in range(3)] == pytest.approx([0.01, 0.02, 0.03])
    assert held.update(1.0, 0.0) == pytest.approx(0.03)


@pytest.mark.parametrize(("accel", "lowpass"), [(0.0, 0.5), (1.0, 0.0), (1.0, 1.5)])
def test_smoothing_rejects_settings_without_meaning(accel: float, lowpass: float) -> None:
    with pytest.raises(ValueError, match="must be"):
        VelocitySmoother(accel, lowpass)


def test_range_ahead_counts_down_between_readings() -> None:
    ahead = RangeAhead()
    assert ahead.update(1.0, 0.0, 0.02) == pytest.approx(1.0)
    assert ahead.update(1.0, 0.004, 0.02) == pytest.approx(0.996)
    assert ahead.update(0.992, 0.004, 0.02) == pytest.approx(0.992)


def test_range_ahead_ignores_one_outlier_and_believes_two() -> None:
    ahead = RangeAhead()
    ahead.update(1.0, 0.0, 0.05)
    assert ahead.update(0.05, 0.0, 0.05) == pytest.approx(1.0)
    assert ahead.update(1.001, 0.0, 0.05) == pytest.approx(1.0, abs=0.01)
    assert ahead.update(0.30, 0.0, 0.05) == pytest.approx(1.0, abs=0.01)
    assert ahead.update(0.301, 0.0, 0.05) == pytest.approx(0.301)


def test_range_ahead_resets_after_missing_echoes() -> None:
    ahead = RangeAhead()
    ahead.update(0.5, 0.0, 0.05)
    for _ in range(6):
        assert ahead.update(None, 0.0, 0.05) is not None
    assert ahead.update(None, 0.0, 0.05) is None
