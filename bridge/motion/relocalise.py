"""Walls seen again correct the estimate: heading first, then position across them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.wall_position import WallPosition
from bridge.motion.wall_yaw import WallYaw

if TYPE_CHECKING:
    from bridge.motion.estimator import PoseEstimator
    from bridge.motion.robot_model import RobotModel

FAR_M = 2.5
"""Beyond this the ultrasonic's cone is so wide that it rarely meets one surface alone."""
BUMP_SIGMA_M = 0.01
BUMP_SIGMA_RAD = math.radians(0.5)
"""What a touch moves the robot beyond what its wheels tell."""


class Relocaliser:
    """Feeds an estimator with what the rangers say of walls seen before."""

    def __init__(self, model: RobotModel, estimator: PoseEstimator) -> None:
        self._estimator = estimator
        self._yaw = WallYaw(model)
        mounts = (model.ultrasonic, model.infrared_left, model.infrared_right)
        self._position = WallPosition(mounts)
        self._touching = False
        self.yaw_fixes = 0
        self.position_fixes = 0

    def update(
        self,
        ultrasonic_m: float | None,
        left_m: float | None,
        right_m: float | None,
        *,
        touching: bool,
    ) -> None:
        """Take one reading of the rangers and the bumper."""
        estimator = self._estimator
        if touching and not self._touching:
            estimator.disturb(BUMP_SIGMA_M, BUMP_SIGMA_RAD)
        self._touching = touching
        for fix in self._yaw.update(
            estimator.pose,
            estimator.v_m_s,
            estimator.yaw_rate_rad_s,
            left_m,
            right_m,
            estimator.covariance[2][2],
        ):
            estimator.correct_yaw(fix.error_rad, fix.variance)
            self.yaw_fixes += 1
        grid_rad = self._yaw.grid_rad
        if grid_rad is None:
            return
        (xx, xy, _), (_, yy, _), _ = estimator.covariance
        front_m = None if ultrasonic_m is None or ultrasonic_m > FAR_M else ultrasonic_m
        for seen in self._position.update(
            estimator.pose, grid_rad, (front_m, left_m, right_m), (xx, xy, yy)
        ):
            estimator.correct_position(*seen)
            self.position_fixes += 1
