"""Closed-loop step responses of the controllers, and the velocity smoothing of Fig. 12.

The plant is a simple model of the virtual sweeper for the controllers. A commanded velocity takes
effect after a dead time (link and control period) and a first-order lag (motors and wheel control).
The gains are chosen by these rules:

- Rotary (``gain_table``): the gains with the shortest settling time and less than 2 % overshoot in
  a 90° turn. Kp 5 1/s and Td 0.03 s settle in 1.38 s; Kp 4 takes 1.60 s, Kp 6 1.56 s.
- Point to point: near the point the speed falls as v = Kp·r. This is a deceleration of Kp·v, which
  must stay within the share of the acceleration limit for braking: Kp = 0.75·0.4/0.2 = 1.5 1/s at
  cruise speed. The response does not overshoot.

``steering_response`` has the controllers that steer a moving robot, by bearing and by wall.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.control.pid import PidGains
from bridge.motion.control.point_to_point import DISTANCE_GAINS, PointToPointController
from bridge.motion.control.rotary import ROTARY_GAINS, RotaryController
from bridge.motion.control.smoothing import VelocitySmoother
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.geometry import Pose2
from bridge.motion.step_response import STEP_S, StepResponse

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bridge.motion.robot_model import RobotModel

BAND_RAD = math.radians(0.25)
LAG_S, DEAD_S = 0.05, 0.04
"""Lag of the velocity loop (motors and wheel control) and its dead time (two control periods), s.
"""


class SmoothingSeries(NamedTuple):
    """Series of Fig. 12: a velocity before and after smoothing."""

    time_s: list[float]
    before_m_s: list[float]
    after_m_s: list[float]

    @property
    def greatest_acceleration(self) -> float:
        """Largest acceleration of the commands, m/s²."""
        after = self.after_m_s
        return max(abs(b - a) for a, b in pairwise(after)) / STEP_S


def _respond(
    control: Callable[[float], float], smoother: VelocitySmoother, target: float, seconds: float
) -> StepResponse:
    """Simulate the closed loop with dead time and lag."""
    pending: deque[float] = deque([0.0] * round(DEAD_S / STEP_S))
    value, velocity = 0.0, 0.0
    response = StepResponse([], [], [], target)
    keep = math.exp(-STEP_S / LAG_S)
    for i in range(round(seconds / STEP_S)):
        command = smoother.update(control(value), STEP_S)
        pending.append(command)
        wanted = pending.popleft()
        # exact, because the input of the lag is constant over the step
        value += wanted * STEP_S + (velocity - wanted) * LAG_S * (1.0 - keep)
        velocity = wanted + (velocity - wanted) * keep
        response.time_s.append((i + 1) * STEP_S)
        response.value.append(value)
        response.command.append(command)
    return response


def rotary_step(
    model: RobotModel,
    angle_rad: float,
    gains: PidGains = ROTARY_GAINS,
    *,
    seconds: float = 6.0,
    lowpass: float = 0.6,
) -> StepResponse:
    """Turn in place with the rotary PD controller (section 3.3, eq. 2) and the usual limits."""
    rotary = RotaryController(
        0.75 * model.max_yaw_rate_rad_s, 0.5 * model.max_yaw_accel_rad_s2, gains
    )
    smoother = VelocitySmoother(model.max_yaw_accel_rad_s2, lowpass)
    return _respond(lambda yaw: rotary.update(angle_rad, yaw, STEP_S), smoother, angle_rad, seconds)


def point_step(
    model: RobotModel,
    distance_m: float,
    gains: PidGains = DISTANCE_GAINS,
    *,
    seconds: float = 12.0,
    lowpass: float = 0.6,
) -> StepResponse:
    """Drive to a point ahead with the point-to-point PD controller (section 3.3, part 4)."""
    turn_rad = MotionTuning().turn_in_place_rad
    point = PointToPointController(model.cruise_speed_m_s, 1.5, turn_rad, gains)
    smoother = VelocitySmoother(model.max_accel_m_s2, lowpass)
    return _respond(
        lambda x: point.update(distance_m, 0.0, Pose2(x, 0.0, 0.0), STEP_S).vx_m_s,
        smoother,
        distance_m,
        seconds,
    )


class GainRow(NamedTuple):
    """One row of the table that serves to choose the gains."""

    kp: float
    td_s: float
    overshoot: float
    settled_s: float


def gain_table(
    model: RobotModel,
    kps: Sequence[float] = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0),
    tds: Sequence[float] = (0.0, 0.03, 0.06),
) -> list[GainRow]:
    """Return the response to a 90° turn for each pair of rotary gains (tolerance band: 0.25°)."""
    rows = []
    for kp in kps:
        for td in tds:
            response = rotary_step(model, 0.5 * math.pi, PidGains(kp=kp, td_s=td))
            rows.append(GainRow(kp, td, response.overshoot, response.settled_s(BAND_RAD)))
    return rows


def smoothing_series(
    model: RobotModel, *, lowpass: float = 0.6, stop_s: float = 2.0, seconds: float = 4.0
) -> SmoothingSeries:
    """Return Fig. 12: the command steps to cruise speed twice, and an obstacle resets it to 0."""
    smoother = VelocitySmoother(model.max_accel_m_s2, lowpass)
    series = SmoothingSeries([], [], [])
    for i in range(round(seconds / STEP_S)):
        time_s = i * STEP_S
        driving = 0.2 <= math.fmod(time_s, stop_s) < 0.7 * stop_s
        wanted = model.cruise_speed_m_s if driving else 0.0
        series.time_s.append(time_s)
        series.before_m_s.append(wanted)
        series.after_m_s.append(smoother.update(wanted, STEP_S))
    return series
