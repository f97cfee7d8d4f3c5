"""Properties of motion and control that hold for every gain and input."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from bridge.motion.control.pid import Pid, PidGains
from bridge.motion.control.point_to_point import PointToPointController
from bridge.motion.control.rotary import RotaryController
from bridge.motion.control.smoothing import VelocitySmoother
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.estimation.odometry import ENCODER_MODULUS, advance_arc, encoder_delta
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel

MODEL = RobotModel()
TURN_IN_PLACE_RAD = MotionTuning().turn_in_place_rad
angles = st.floats(-math.pi, math.pi)
travels = st.floats(-1.0, 1.0)
poses = st.builds(Pose2, st.floats(-5, 5), st.floats(-5, 5), angles)
signals = st.lists(st.floats(-10, 10), min_size=1, max_size=60)


@given(st.integers(0, ENCODER_MODULUS - 1), st.integers(-32768, 32767))
def test_encoder_delta_undoes_the_wrap(previous: int, delta: int) -> None:
    assert encoder_delta(previous, (previous + delta) % ENCODER_MODULUS) == delta


@given(poses, travels, angles, st.integers(1, 20))
def test_an_arc_is_the_same_however_it_is_split(
    pose: Pose2,
    travel: float,
    turn: float,
    parts: int,
) -> None:
    whole = advance_arc(pose, travel, turn)
    split = pose
    for _ in range(parts):
        split = advance_arc(split, travel / parts, turn / parts)
    assert whole.distance_m(split) < 1e-9


@given(
    st.floats(0.1, 50),
    st.floats(0.05, 10),
    st.floats(0, 1),
    st.floats(0.1, 5),
    signals,
)
def test_pid_output_and_integral_stay_within_the_limit(
    kp: float,
    ti: float,
    td: float,
    limit: float,
    errors: list[float],
) -> None:
    pid = Pid(PidGains(kp, ti, td), limit)
    for error in errors:
        assert abs(pid.update(error, 0.02)) <= limit
        # The integral may grow while the other terms reduce the output. It never exceeds the
        # largest possible error integrated over all steps.
        assert abs(pid.integral) <= kp / ti * 10 * 0.02 * len(errors) + 1e-9


@given(st.floats(0.05, 5), st.floats(0.05, 1.0), signals)
def test_smoothing_never_exceeds_the_acceleration_nor_the_inputs(
    limit: float,
    lowpass: float,
    targets: list[float],
) -> None:
    smooth = VelocitySmoother(limit, lowpass)
    last, low, high = 0.0, min(0.0, *targets), max(0.0, *targets)
    for target in targets:
        value = smooth.update(target, 0.02)
        assert abs(value - last) <= limit * 0.02 + 1e-12
        assert low - 1e-9 <= value <= high + 1e-9
        last = value


@given(angles, angles)
def test_rotary_turns_in_the_shorter_direction(target: float, yaw: float) -> None:
    rate = RotaryController(1.5, 4.0).update(target, yaw, 0.02)
    short = math.remainder(target - yaw, math.tau)
    assert abs(rate) <= 1.5
    assert rate * short >= 0.0 or math.isclose(abs(short), math.pi)


@given(poses, st.floats(-5, 5), st.floats(-5, 5))
def test_point_controller_never_drives_away(pose: Pose2, x: float, y: float) -> None:
    command = PointToPointController(0.3, 1.5, TURN_IN_PLACE_RAD).update(x, y, pose, 0.02)
    assert 0.0 <= command.vx_m_s <= 0.3
    ahead = math.cos(pose.theta_rad) * (x - pose.x_m) + math.sin(pose.theta_rad) * (y - pose.y_m)
    assert command.vx_m_s == 0.0 or ahead > 0.0
