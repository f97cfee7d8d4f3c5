"""Driving to a point: PD control of distance and bearing (paper section 3.3, part 4)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.control.pid import Pid, PidGains
from bridge.motion.geometry import wrap_angle

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2

DISTANCE_GAINS = PidGains(kp=1.5, td_s=0.02)
"""Gains from the distance (m) to the speed (m/s). The robot brakes from cruise speed with three
quarters of its acceleration limit, without overshoot (``test_step_response``)."""
BEARING_GAINS = PidGains(kp=4.0, td_s=0.03)
"""Gains from the bearing error (rad) to the yaw rate (rad/s). Kp is the fastest with less than 3 %
overshoot at twice the dead time (``test_steering_response``)."""


class PointCommand(NamedTuple):
    """Output of the controller.

    The lateral velocity of the paper's transform is left out: a differential drive cannot follow
    it.
    """

    vx_m_s: float
    """Forward speed, m/s."""
    yaw_rate_rad_s: float
    """Yaw rate, rad/s; positive: counter-clockwise."""
    distance_m: float
    """Distance to the point, m."""
    bearing_error_rad: float
    """Bearing of the point from the heading, rad; positive: to the left."""


class PointToPointController:
    """Body velocity towards a point.

    The paper's formulas do not work as written. This controller differs from them:

    - The paper's distance error e = 0 - r with a positive gain drives *away* from the point. Here e
      = r.
    - ``atan2`` replaces the paper's arctan, and the bearing error is wrapped to ±π.
    - The paper's transform gives a lateral velocity, which a differential drive cannot follow. Only
      vx = v·cos(bearing error) is used. It slows the robot down while the robot points elsewhere.
    - If the bearing error is large, the robot turns in place.
    """

    __slots__ = ("_bearing", "_distance", "_turn_in_place_rad")

    def __init__(
        self,
        max_speed_m_s: float,
        max_rate_rad_s: float,
        turn_in_place_rad: float,
        distance_gains: PidGains = DISTANCE_GAINS,
        bearing_gains: PidGains = BEARING_GAINS,
    ) -> None:
        """Create a controller.

        The output limits are in m/s and rad/s. If the bearing error is larger than
        ``turn_in_place_rad``, the robot turns in place.
        """
        self._turn_in_place_rad = turn_in_place_rad
        self._distance = Pid(distance_gains, max_speed_m_s)
        self._bearing = Pid(bearing_gains, max_rate_rad_s)

    def reset(self) -> None:
        """Reset the last errors."""
        self._distance.reset()
        self._bearing.reset()

    def update(self, x_m: float, y_m: float, pose: Pose2, dt_s: float) -> PointCommand:
        """Return the velocity towards (``x_m``, ``y_m``), in the frame of ``pose``."""
        dx, dy = x_m - pose.x_m, y_m - pose.y_m
        distance = math.hypot(dx, dy)
        error = wrap_angle(math.atan2(dy, dx) - pose.theta_rad) if distance > 0.0 else 0.0
        speed = self._distance.update(distance, dt_s)
        rate = self._bearing.update(error, dt_s)
        vx = 0.0 if abs(error) > self._turn_in_place_rad else speed * math.cos(error)
        return PointCommand(vx, rate, distance, error)
