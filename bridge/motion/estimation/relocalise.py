"""Relocalisation: measurements of known walls update the estimated heading and position."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from bridge.motion.estimation.contact_uncertainty import ContactUncertainty
from bridge.motion.estimation.estimator import IMU_GAP_S
from bridge.motion.estimation.wall_map import WallMap
from bridge.motion.estimation.wall_measurements import (
    FrontMeasurement,
    FrontMeasurements,
    LineMeasurement,
    SideMeasurement,
)
from bridge.motion.geometry import Pose2

if TYPE_CHECKING:
    from bridge.motion.estimation.estimator import PoseEstimator
    from bridge.motion.robot_model import RobotModel

SAME_PULSE_S = 0.005
"""Maximum time difference at which two messages contain the same pulse, s. The age is sent in
milliseconds, and no ultrasonic sensor pings every 5 ms."""
MAX_ECHO_AGE_S = IMU_GAP_S
"""Maximum age of an ultrasonic range that is used, s. It is the limit of the pose extrapolation."""
_READINGS = 5
"""Number of readings in the median of a side."""


class Relocaliser:
    """Updates an estimator with wall measurements."""

    def __init__(self, model: RobotModel, estimator: PoseEstimator) -> None:
        """Create an object that updates ``estimator``."""
        self._estimator = estimator
        self._contact_tuning = estimator.tuning.contact
        self._tuning = estimator.tuning.measurements
        self._ultrasonic = model.ultrasonic
        self._grazing_range_m = tuple(
            model.radius_m - abs(m.y_m) + self._contact_tuning.grazing_gap_m
            for m in (model.infrared_left, model.infrared_right)
        )
        self._radius_m = model.radius_m
        self._near = (_Nearness(), _Nearness())
        self._since_graze_m = math.inf
        self._sides = tuple(
            SideMeasurement(mount, self._tuning)
            for mount in (model.infrared_left, model.infrared_right)
        )
        self._front = FrontMeasurements(model.ultrasonic, self._tuning)
        self.walls = WallMap(estimator.ekf, estimator.tuning.walls)
        self._echo_m: float | None = None
        self._pulse_s = -math.inf
        """Time of the newest ultrasonic pulse whose age was sent, s."""
        self._contact = ContactUncertainty(estimator)
        self.yaw_fixes = 0
        self.position_fixes = 0

    def update(  # noqa: PLR0913 - the values of one message
        self,
        ultrasonic_m: float | None,
        left_m: float | None,
        right_m: float | None,
        *,
        bumper_left: bool,
        bumper_right: bool,
        t_s: float,
        ultrasonic_age_s: float | None = None,
    ) -> None:
        """Use the readings of range sensors and bumper.

        ``t_s`` is the time of the infrared ranges on the clock of the estimator's samples, s.
        ``ultrasonic_age_s`` is the time from the ultrasonic pulse to ``t_s``. Without it, a mean
        age is used.
        """
        estimator, tuning, contact = self._estimator, self._tuning, self._contact_tuning
        grazing = any(
            near.take(range_m) < limit_m
            for near, range_m, limit_m in zip(
                self._near, (left_m, right_m), self._grazing_range_m, strict=True
            )
        )
        path_m = self._contact.update(left=bumper_left, right=bumper_right, grazing=grazing)
        self._since_graze_m = path_m if grazing else self._since_graze_m + path_m
        seen_from = self._place(t_s)
        steady = abs(estimator.yaw_rate_rad_s) < tuning.steady_rad_s
        moving = abs(estimator.v_m_s) > tuning.moving_m_s
        wander = estimator.ekf.across_m_sqrt_m
        for side, range_m in zip(self._sides, (left_m, right_m), strict=True):
            line = side.add(
                seen_from, range_m, moving=moving, steady=steady, wander_m_sqrt_m=wander
            )
            if line is not None and self._since_graze_m < tuning.max_span_m:
                room_m = _mean_m(line) - self._radius_m
                grazes = contact.strong_graze_gap_m <= room_m < contact.free_gap_m
                line = line.with_sigma(
                    contact.light_graze_rad if grazes else contact.strong_graze_rad
                )
            if line is not None and self.walls.see_line(line):
                self.yaw_fixes += 1
                self.position_fixes += 1
        fresh, age_s = self._echo(ultrasonic_m, t_s, ultrasonic_age_s)
        if fresh:
            seen_from = self._place(t_s - age_s)
        front = self._front.add(seen_from, ultrasonic_m, steady=steady and fresh)
        if front is not None:
            off_m = tuning.echo_age_sigma_s * estimator.v_m_s
            front = FrontMeasurement(
                front.range_m - seen_from.along_m(estimator.odometry),
                front.variance + off_m * off_m,
            )
        if front is not None and self.walls.see_front(front, self._ultrasonic):
            self.position_fixes += 1

    def _echo(
        self, ultrasonic_m: float | None, t_s: float, age_s: float | None
    ) -> tuple[bool, float]:
        """Return True if a range is new, and its age, s."""
        if age_s is None:
            fresh = ultrasonic_m != self._echo_m
            self._echo_m = ultrasonic_m
            return fresh, self._tuning.echo_age_s
        pulse_s = t_s - age_s
        fresh = abs(pulse_s - self._pulse_s) > SAME_PULSE_S and age_s <= MAX_ECHO_AGE_S
        self._pulse_s = pulse_s
        return fresh, age_s

    def _place(self, t_s: float) -> Pose2:
        """Return the odometry extrapolated to the time of the reading."""
        estimator = self._estimator
        odometry = estimator.odometry
        now, then = estimator.pose, estimator.pose_at(t_s)
        turn = odometry.theta_rad - now.theta_rad
        c, s = math.cos(turn), math.sin(turn)
        dx, dy = then.x_m - now.x_m, then.y_m - now.y_m
        return Pose2(
            odometry.x_m + c * dx - s * dy,
            odometry.y_m + s * dx + c * dy,
            odometry.theta_rad + math.remainder(then.theta_rad - now.theta_rad, math.tau),
        )


class _Nearness:
    """Median of the last readings on one side.

    A single noisy reading then does not mean contact.
    """

    __slots__ = ("_last",)

    def __init__(self) -> None:
        self._last: deque[float] = deque(maxlen=_READINGS)

    def take(self, range_m: float | None) -> float:
        """Use a range, m, and return the median; infinite if nothing is near."""
        self._last.append(math.inf if range_m is None else range_m)
        return sorted(self._last)[len(self._last) // 2]


def _mean_m(line: LineMeasurement) -> float:
    """Return the distance to a wall from the middle of the measured piece, m."""
    return line.distance_m + 0.5 * line.span_m * math.cos(line.normal_rad)
