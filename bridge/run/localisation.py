"""Localisation: updates the robot's state and pose estimate from its samples."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.estimation.displacement import DisplacementCheck
from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.relocalise import Relocaliser
from bridge.run.displaced_start import MeasuredWall
from bridge.run.robot_state import RobotState
from protocol.messages.values import Contact

if TYPE_CHECKING:
    from bridge.motion.estimation.tuning import EstimationTuning
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from protocol.clock import DeviceUs, HostNs
    from protocol.messages.device import Encoders, Imu, Range, TimeReply
    from protocol.schema.message import Message


class Localisation:
    """Holds the robot's newest samples and its pose estimate."""

    def __init__(
        self, model: RobotModel, start: Pose2, tuning: EstimationTuning | None = None
    ) -> None:
        self._model = model
        self.state = RobotState()
        self.estimator = PoseEstimator(model, start, tuning)
        self.encoders_us = 0
        """Device time of the newest encoder sample, µs. It is the time of the estimated
        position."""
        self._walls = Relocaliser(model, self.estimator)
        self._displacement = DisplacementCheck(model, self.estimator.tuning.displacement)

    def begin_again(self) -> None:
        """Restart the estimator at the current pose after a reset of clock and counts."""
        tuning = self.estimator.tuning
        self.estimator = PoseEstimator(self._model, self.estimator.pose, tuning)
        self._walls = Relocaliser(self._model, self.estimator)
        self._displacement = DisplacementCheck(self._model, tuning.displacement)

    def keep(self, message: Message, device_us: DeviceUs, now_ns: HostNs) -> None:
        """Store a message that only the state needs."""
        self.state.take(message, device_us, now_ns / 1e9)

    def time_reply(self, message: TimeReply, device_us: DeviceUs, now_ns: HostNs) -> None:  # noqa: ARG002 - the signature of every listener
        """Update the clock mapping with a ping reply."""
        self.state.times.observe(device_us, now_ns / 1e9)

    def imu(self, message: Imu, device_us: DeviceUs, now_ns: HostNs) -> None:
        """Update the estimator with an IMU sample."""
        if not self.state.take(message, device_us, now_ns / 1e9):
            return
        self.estimator.on_imu(
            device_us * 1e-6,
            message.gyro_z_rad_s,
            message.accel_x_m_s2,
            message.accel_y_m_s2,
            message.temperature_deg_c,
        )

    def encoders(self, message: Encoders, device_us: DeviceUs, now_ns: HostNs) -> None:
        """Update the estimator with wheel counts."""
        if not self.state.take(message, device_us, now_ns / 1e9):
            return
        self.encoders_us = device_us
        self.estimator.on_encoders(device_us * 1e-6, message.left, message.right)

    @property
    def heading_sigma_rad(self) -> float:
        """Heading standard deviation relative to the orthogonal walls, rad; 0 if there are none."""
        return self._walls.walls.heading_sigma_rad

    @property
    def displaced(self) -> bool:
        """True if the robot is not at its estimated place."""
        return self._displacement.displaced

    def measured_walls(self) -> list[MeasuredWall]:
        """Return the walls of the map whose length was measured, not only their distance."""
        found = []
        for wall, normal_rad, offset_m in self._walls.walls.known():
            if wall.seen_m > 0.0:
                c, s = math.cos(normal_rad), math.sin(normal_rad)
                x_m, y_m = wall.anchor_x_m + c * offset_m, wall.anchor_y_m + s * offset_m
                low_m, high_m = wall.low_m, wall.high_m
                found.append(
                    MeasuredWall(
                        x_m - s * low_m, y_m + c * low_m, x_m - s * high_m, y_m + c * high_m
                    )
                )
        return found

    def see_walls(self, message: Range, device_us: DeviceUs) -> bool:
        """Update the estimate with a range sample.

        Return True if known walls confirm the estimate.
        """
        self._walls.update(
            message.ultrasonic_m,
            message.infrared_left_m,
            message.infrared_right_m,
            bumper_left=bool(message.contacts & Contact.BUMPER_LEFT),
            bumper_right=bool(message.contacts & Contact.BUMPER_RIGHT),
            t_s=device_us * 1e-6,
            ultrasonic_age_s=message.ultrasonic_age_s,
        )
        return self._displacement.update(
            self.estimator.pose,
            self.estimator.yaw_rate_rad_s,
            (message.infrared_left_m, message.infrared_right_m),
            self._walls.walls,
            self.estimator.sigma_along_m,
        )
