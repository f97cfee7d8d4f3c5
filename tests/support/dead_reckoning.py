"""The paper's estimate as a reference: dead reckoning with a gyro heading.

The encoders give the travelled path (equations 3 and 4 of the paper). The gyro rate minus its mean
at the first rest gives the heading. An exact arc gives the position (equation 5). Tests compare the
Kalman filter with this estimate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.motion.estimation.odometry import advance_arc, encoder_delta

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel

_HELD = 5


class DeadReckoning:
    """Estimator with the interface of ``PoseEstimator``.

    Times are in s of one clock, gyro rates in rad/s, and encoder counts have 16 bits.
    """

    def __init__(self, model: RobotModel, start: Pose2) -> None:
        """``start``: the robot's pose, at rest."""
        self._model = model
        self._pose = start
        self._counts: tuple[int, int] | None = None
        self._imu_s: float | None = None
        self._bias_sum, self._samples = 0.0, 0
        self._held: list[tuple[float, float]] = []
        self._started = False
        self._turned = 0.0

    @property
    def pose(self) -> Pose2:
        """Pose at the time of the newest encoder sample."""
        return self._pose

    @property
    def gyro_bias_rad_s(self) -> float:
        """Mean of the gyro rate at the first rest, rad/s; 0 before the first sample."""
        return self._bias_sum / self._samples if self._samples else 0.0

    def on_imu(self, t_s: float, gyro_z_rad_s: float) -> None:
        """Process one gyro sample: the mean rate since the previous sample."""
        last_s, self._imu_s = self._imu_s, t_s
        dt = 0.0 if last_s is None else t_s - last_s
        if self._started:
            self._turned += (gyro_z_rad_s - self.gyro_bias_rad_s) * dt
            return
        # The robot may already move in the newest samples: the counts show a motion a little later.
        self._held.append((gyro_z_rad_s, dt))
        if len(self._held) > _HELD:
            self._bias_sum += self._held.pop(0)[0]
            self._samples += 1

    def on_encoders(self, t_s: float, left: int, right: int) -> None:  # noqa: ARG002 - as the filter
        """Process one encoder sample: move by the turn and the path since the previous sample."""
        counts, self._counts = self._counts, (left, right)
        if counts is None:
            return
        ways = [
            self._model.metres_per_count * encoder_delta(old, new)
            for old, new in zip(counts, (left, right), strict=True)
        ]
        if any(ways) and not self._started:
            self._started = True
            self._turned += sum((rate - self.gyro_bias_rad_s) * dt for rate, dt in self._held)
        travel = 0.5 * sum(ways)
        turned, self._turned = self._turned, 0.0
        self._pose = advance_arc(self._pose, travel, turned)
