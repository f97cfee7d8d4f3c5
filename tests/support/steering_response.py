"""Step responses of the steering controllers: bearing and wall distance of a moving robot.

The plant is the model of ``step_response`` with two velocities, forward and yaw. Each velocity has
its dead time and lag.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from bridge.motion.control.point_to_point import (
    BEARING_GAINS,
    DISTANCE_GAINS,
    PointToPointController,
)
from bridge.motion.control.smoothing import VelocitySmoother
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.control.wall_follow import FollowTuning, Side, WallFollower
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.observation import Observation
from bridge.motion.step_response import STEP_S, StepResponse
from support.step_response import DEAD_S, LAG_S

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bridge.motion.control.pid import PidGains
    from bridge.motion.control.wall_follow import FollowTuning
    from bridge.motion.robot_model import RobotModel

BEARING_BAND_RAD = math.radians(1.0)
WALL_BAND_M = 0.002
"""Tolerance of the gap to a wall, m: the noise of an infrared sensor, or 1.5 of its wire steps."""
_NEAR_M = 0.10
"""Minimum distance at which a bearing is evaluated, m: nearer to the point, a bearing has no
meaning.
"""
_WIRE_M = 0.00125
"""Resolution of an infrared range on the wire, m."""
_LONG_S, _FOLLOW_S = 20.0, 15.0


class _Body:
    """A robot that follows velocity commands with a dead time ``DEAD_S`` and a lag ``LAG_S``."""

    def __init__(self, model: RobotModel, v_m_s: float = 0.0, dead_s: float = DEAD_S) -> None:
        tune = MotionTuning()
        self._smooth_v = VelocitySmoother(model.max_accel_m_s2, tune.lowpass)
        self._smooth_w = VelocitySmoother(model.max_yaw_accel_rad_s2, tune.lowpass)
        self._smooth_v.reset(v_m_s)
        self._pending = deque([(v_m_s, 0.0)] * round(dead_s / STEP_S))
        self.pose = Pose2(0.0, 0.0, 0.0)
        self.v_m_s, self.yaw_rate_rad_s = v_m_s, 0.0
        self.sent_rad_s = 0.0

    def step(self, v_m_s: float, yaw_rate_rad_s: float) -> None:
        """Run one control step; the velocity smoothers process the command first."""
        self.sent_rad_s = self._smooth_w.update(yaw_rate_rad_s, STEP_S)
        self._pending.append((self._smooth_v.update(v_m_s, STEP_S), self.sent_rad_s))
        v, w = self._pending.popleft()
        keep = math.exp(-STEP_S / LAG_S)
        carried = LAG_S * (1.0 - keep)
        # exact if the lag's target is constant over the step
        way = v * STEP_S + (self.v_m_s - v) * carried
        turn = w * STEP_S + (self.yaw_rate_rad_s - w) * carried
        self.v_m_s = v + (self.v_m_s - v) * keep
        self.yaw_rate_rad_s = w + (self.yaw_rate_rad_s - w) * keep
        x, y, theta = self.pose
        mid = theta + 0.5 * turn
        self.pose = Pose2(x + way * math.cos(mid), y + way * math.sin(mid), theta + turn)


def bearing_step(
    model: RobotModel,
    angle_rad: float,
    gains: PidGains = BEARING_GAINS,
    *,
    distance_m: float = 1.0,
    dead_s: float = DEAD_S,
) -> StepResponse:
    """Turn to the bearing of a point until it is 10 cm away (section 3.3 of the paper, part 4).

    The value is the corrected part of the bearing. The robot starts at rest. For a bearing above
    45° it first turns in place.
    """
    tune = MotionTuning()
    rate = tune.turn_rate_share * model.max_yaw_rate_rad_s
    point = PointToPointController(
        model.cruise_speed_m_s, rate, tune.turn_in_place_rad, DISTANCE_GAINS, gains
    )
    x, y = distance_m * math.cos(angle_rad), distance_m * math.sin(angle_rad)
    body = _Body(model, dead_s=dead_s)
    response = StepResponse([], [], [], angle_rad)
    for i in range(round(_LONG_S / STEP_S)):
        command = point.update(x, y, body.pose, STEP_S)
        if command.distance_m < _NEAR_M:
            break
        body.step(command.vx_m_s, command.yaw_rate_rad_s)
        left = wrap_angle(math.atan2(y - body.pose.y_m, x - body.pose.x_m) - body.pose.theta_rad)
        response.time_s.append((i + 1) * STEP_S)
        response.value.append(angle_rad - left)
        response.command.append(body.sent_rad_s)
    return response


def wall_step(  # noqa: PLR0913 - a robot, a step, and the following
    model: RobotModel,
    step_m: float,
    tuning: FollowTuning | None = None,
    *,
    gap_m: float = 0.05,
    speed_m_s: float | None = None,
    dead_s: float = DEAD_S,
) -> StepResponse:
    """Follow a straight wall from a gap with an error of ``step_m`` (positive: too far).

    The wall's direction is unknown at first, as at the beginning of each leg. The value is the
    corrected part of the step, m, over 15 s. The wall is not solid: the robot can pass through it.
    """
    wall_m = model.radius_m + gap_m + step_m
    response = StepResponse([], [], [], step_m)
    for time_s, body in _follow(
        model, lambda pose: _to_wall(model, pose, wall_m), tuning, gap_m, speed_m_s, dead_s
    ):
        response.time_s.append(time_s)
        response.value.append(body.pose.y_m)
        response.command.append(body.sent_rad_s)
    return response


def column_stand_off_m(
    model: RobotModel, radius_m: float, tuning: FollowTuning | None = None, gap_m: float = 0.05
) -> float:
    """Return the mean increase of the gap around a round pillar in the last 5 of 15 s, m."""
    centre = -(radius_m + gap_m + model.radius_m)
    offs = [
        math.hypot(body.pose.x_m, body.pose.y_m + centre) + centre
        for _, body in _follow(
            model, lambda pose: _to_column(model, pose, -centre, radius_m), tuning, gap_m
        )
    ]
    last = offs[-round(5.0 / STEP_S) :]
    return sum(last) / len(last)


def _follow(  # noqa: PLR0913, PLR0917 - a robot, its wall, and the following
    model: RobotModel,
    reads: Callable[[Pose2], float],
    tuning: FollowTuning | None,
    gap_m: float,
    speed_m_s: float | None = None,
    dead_s: float = DEAD_S,
) -> Iterator[tuple[float, _Body]]:
    """Yield time and robot after each control step of 15 s.

    Readings at 20 Hz, in the wire's steps.
    """
    speed = model.cruise_speed_m_s if speed_m_s is None else speed_m_s
    follower = WallFollower(model, Side.LEFT, gap_m, speed_m_s=speed, tuning=tuning)
    body = _Body(model, speed, dead_s)
    range_m = 0.0
    for i in range(round(_FOLLOW_S / STEP_S)):
        if 2 * i % 5 < 2:
            range_m = round(reads(body.pose) / _WIRE_M) * _WIRE_M
        body.step(*follower.step(_sees(i * STEP_S, body, range_m), STEP_S).command)
        yield (i + 1) * STEP_S, body


def _to_wall(model: RobotModel, pose: Pose2, wall_m: float) -> float:
    """Return the range of the left infrared to a wall along y = ``wall_m``."""
    mount = model.infrared_left
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    return (wall_m - pose.y_m - mount.x_m * s) / c - mount.y_m


def _to_column(model: RobotModel, pose: Pose2, centre_m: float, radius_m: float) -> float:
    """Return the range of the left infrared to a column about (0, ``centre_m``)."""
    mount = model.infrared_left
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    x, y = pose.transform(mount.x_m, mount.y_m)
    # the beam goes along (-s, c): its way to the middle of its chord, less half of that
    along = -s * -x + c * (centre_m - y)
    aside = c * -x + s * (centre_m - y)
    return along - math.sqrt(max(radius_m**2 - aside**2, 0.0))


def _sees(time_s: float, body: _Body, left_m: float) -> Observation:
    return Observation(
        time_s,
        body.pose,
        body.v_m_s,
        body.yaw_rate_rad_s,
        None,
        left_m,
        None,
        bumper_left=False,
        bumper_right=False,
        cliff=False,
    )
