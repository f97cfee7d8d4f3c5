"""The pose estimator: from samples of encoders and IMU to pose and covariance, without I/O.

It is an extended Kalman filter with the states

    x, y, θ   pose
    b         gyro bias at standstill
    m         shift of the bias in motion (vibration), which only wall measurements observe
    k         gyro scale error
    s         wheel scale error: the path of a count is (1 + s) times its nominal path
    c         slope of b with the chip's temperature: b' = c·T'

and the walls of ``wall_map``. The gyro turns the heading: θ' = (g - b - m)(1 - k), with its
measured rate g. The encoders move the position along an arc (paper eq. 5). A standstill measures
the bias (zero-velocity update).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.estimation.disturbance import (
    BumpDetector,
    Disturbance,
    DisturbanceKind,
    InertialBridge,
    SlipDetector,
)
from bridge.motion.estimation.ekf import BIAS, Covariance, Ekf
from bridge.motion.estimation.odometry import ENCODER_MODULUS, encoder_delta, sinc
from bridge.motion.estimation.standstill import BATCH, Standstill
from bridge.motion.estimation.tuning import EstimationTuning
from bridge.motion.geometry import Pose2, wrap_angle

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

ENCODER_GAP_S = 10.0
"""Maximum time between encoder samples, s. It is shorter for a robot whose 16-bit counters can
count half their range in less time, because the path is then ambiguous."""
IMU_GAP_S = 0.1
"""Maximum time between gyro samples, s. In a longer gap the wheels measure the heading."""
_KEPT = 64
"""Maximum number of stored disturbances."""
_STILL_M_S = 1e-3
"""Maximum speed of a standstill without new counts, m/s."""


class PoseEstimator:
    """Passes the samples of encoders, gyro and accelerometer to an extended Kalman filter.

    Samples should arrive in the order of their time stamps; an old gyro sample is ignored. All
    times come from one clock, s; only differences matter. The first encoder sample is the
    reference. The wheels give the heading (paper eq. 4) before the first 25 gyro samples at
    standstill, and after 0.1 s without a gyro sample.
    """

    def __init__(
        self, model: RobotModel, start: Pose2, tuning: EstimationTuning | None = None
    ) -> None:
        """Begin at an exact pose. It defines the frame of all poses."""
        self.tuning = tuning = tuning or EstimationTuning()
        self.ekf = Ekf(start, tuning.drift, tuning.noise)
        self._model = model
        self._left_m, self._right_m = model.left_metres_per_count, model.right_metres_per_count
        """Path per count of each wheel, m, without the estimated scale error."""
        self.ekf.gyro_bias_rad_s = model.gyro_bias_rad_s
        self._standstill = Standstill(tuning.standstill)
        self._counts: tuple[int, int] | None = None
        self._encoder_s = 0.0
        half_range_m = 0.5 * ENCODER_MODULUS * min(self._left_m, self._right_m)
        self._encoder_gap_s = min(ENCODER_GAP_S, half_range_m / model.max_speed_m_s)
        self._imu_s: float | None = None
        self._gyro_gap = False
        """True if the gyro has not measured the turn since the last encoder sample."""
        self._chip_c: float | None = None
        self._bumps = BumpDetector(tuning.disturbance)
        self._slips = SlipDetector(tuning.disturbance)
        self._bridge: InertialBridge | None = None
        self._slipping = 0
        self._disturbances: list[Disturbance] = []
        self.reset(start)

    # -- present estimate -------------------------------------------------------------------

    @property
    def pose(self) -> Pose2:
        """Position at the newest encoder sample, and heading at the newest gyro sample."""
        return self.ekf.pose

    @property
    def odometry(self) -> Pose2:
        """Pose from dead reckoning without corrections. It drifts."""
        return self.ekf.odometry

    @property
    def covariance(self) -> Covariance:
        """Covariance of (x, y, θ), 3×3, m², m·rad and rad², at most 0.1 s old."""
        return self.ekf.covariance

    @property
    def lateral_sigma_m(self) -> float:
        """Standard deviation of the position across the heading, m, at most 0.1 s old."""
        return self.ekf.sigma_along_m(self.ekf.theta_rad + 0.5 * math.pi)

    def sigma_along_m(self, direction_rad: float) -> float:
        """Return the standard deviation of the position along a direction, m, at most 0.1 s old."""
        return self.ekf.sigma_along_m(direction_rad)

    @property
    def gyro_bias_rad_s(self) -> float:
        """Gyro bias at rest, rad/s."""
        return self.ekf.gyro_bias_rad_s

    @property
    def gyro_bias_sigma_rad_s(self) -> float:
        """Standard deviation of the gyro bias, rad/s. It is large until the first standstill."""
        return self.ekf.gyro_bias_sigma_rad_s

    @property
    def wheel_scale(self) -> float:
        """Ratio of the true path of a count to its nominal path, about 1."""
        return self.ekf.wheel_scale

    def pose_at(self, t_s: float) -> Pose2:
        """Extrapolate the pose to a time near the newest encoder sample, s, with the speed.

        Beyond 0.1 s from that sample, return the present pose.
        """
        ahead_s = t_s - self._encoder_s
        if self._counts is None or not -IMU_GAP_S <= ahead_s <= IMU_GAP_S:
            return self.ekf.pose
        path_m = self._speed * ahead_s
        turn_s = ahead_s if self._imu_s is None else t_s - self._imu_s
        theta = self.ekf.theta_rad + self._yaw_rate * turn_s
        mid = theta - 0.5 * self._yaw_rate * ahead_s
        x, y = self.ekf.x_m + path_m * math.cos(mid), self.ekf.y_m + path_m * math.sin(mid)
        return Pose2(x, y, wrap_angle(theta))

    @property
    def v_m_s(self) -> float:
        """Forward speed from the encoders with a low-pass, m/s."""
        return self._speed

    @property
    def yaw_rate_rad_s(self) -> float:
        """Yaw rate from the gyro minus its bias, or from the wheels without gyro samples, rad/s."""
        return self._yaw_rate

    @property
    def known(self) -> bool:
        """True if the pose is valid. False after a long encoder gap, until :meth:`reset`."""
        return self._known

    @property
    def at_rest(self) -> bool:
        """True if the last gyro sample was used as a sample at standstill."""
        return self._standstill.at_rest

    @property
    def disturbances(self) -> tuple[Disturbance, ...]:
        """The latest slips, bumps and stalls, oldest first."""
        return tuple(self._disturbances)

    @property
    def detects_bumps(self) -> bool:
        """True if the accelerometer is calibrated, so that bumps are detected."""
        return self._bumps.ready

    @property
    def bridging(self) -> bool:
        """True if the position comes from the accelerometer, after a bump."""
        return self._bridge is not None

    @property
    def stands(self) -> bool:
        """True if the wheels turn but the robot stands, according to the accelerometer."""
        return self._bridge is not None and self._bridge.stalled

    def reset(self, pose: Pose2) -> None:
        """Set an exact pose. Landmarks are marginalised; the estimated sensor errors stay."""
        self.ekf.restart(pose)
        self._known = True
        self._speed = 0.0
        self._yaw_rate = 0.0
        self._turning_s = 0.0
        self._bridge = None

    def release(self) -> None:
        """End the inertial motion after a bump. The robot is free, so the wheels are used again."""
        bridge = self._bridge
        if bridge is None:
            return
        self.ekf.shift(bridge.unconfirmed_m, 0.0)
        self.ekf.inflate_slip(self.tuning.bridge.release_share * abs(bridge.unconfirmed_m), 0.0)
        self._end_bridge(bridge)

    def hold(self) -> None:
        """Discard the wheel counts since a bump, because the contact continues."""
        if self._bridge is not None:
            self._bridge.unconfirmed_m = 0.0

    # -- samples ---------------------------------------------------------------------------

    def on_imu(
        self,
        t_s: float,
        gyro_z_rad_s: float,
        accel_x_m_s2: float | None = None,
        accel_y_m_s2: float | None = None,
        temperature_c: float | None = None,
    ) -> None:
        """Process an IMU sample.

        Args:
            t_s: time of the sample, s.
            gyro_z_rad_s: measured yaw rate, rad/s, counter-clockwise positive. It is the mean since
                the last sample, because the chip has a low-pass.
            accel_x_m_s2: forward acceleration at the axle's centre, m/s². Its bias and its share of
                gravity are measured at standstill. It is used to detect bumps.
            accel_y_m_s2: acceleration to the left, m/s².
            temperature_c: temperature of the chip, °C. The bias depends on it.

        """
        previous_s = self._imu_s
        if previous_s is not None and t_s <= previous_s:
            return
        self._imu_s = t_s
        if temperature_c is not None:
            self._warm_to(temperature_c)
        offset = self.ekf.gyro_bias_rad_s + self.ekf.motion_bias_rad_s
        rate = (gyro_z_rad_s - offset) * (1.0 - self.ekf.gyro_scale)
        bias = self._standstill.on_gyro(t_s, gyro_z_rad_s, self.ekf.gyro_bias_rad_s)
        if self._standstill.at_rest:
            self._yaw_rate = 0.0
            if bias is not None:
                self._update_bias(bias)
            if accel_x_m_s2 is not None and accel_y_m_s2 is not None:
                self._bumps.rest(accel_x_m_s2, accel_y_m_s2)
            return
        self._bumps.leave_rest()
        if not self._standstill.bias_known:
            # The standstill was too short. The start may affect its few samples.
            self.ekf.gyro_bias_rad_s = self._model.gyro_bias_rad_s
            self.ekf.joint_covariance.reset((BIAS,), (self.ekf.drift.bias_prior_rad_s**2,))
            return
        self._yaw_rate = rate
        if previous_s is None or t_s - previous_s > IMU_GAP_S:
            self._gyro_gap = True
            return
        dt = t_s - previous_s
        self.ekf.theta_rad += rate * dt
        self._turning_s += dt
        if accel_x_m_s2 is not None and accel_y_m_s2 is not None:
            self._feel(t_s, dt, *self._bumps.level(accel_x_m_s2, accel_y_m_s2))

    def on_encoders(self, t_s: float, left: int, right: int) -> None:
        """Process one encoder sample: absolute 16-bit counts, which wrap around."""
        counts, last_s = self._counts, self._encoder_s
        self._counts = (left, right)
        self._encoder_s = t_s
        if counts is None:
            self._standstill.on_encoders(t_s, moved=False)
            return
        dt = t_s - last_s
        if dt > self._encoder_gap_s:
            self._known = False
            self._speed = 0.0
            self.ekf.heading_mark_rad = self.ekf.theta_rad
            self._standstill.on_encoders(t_s, moved=True)
            return
        left_counts = encoder_delta(counts[0], left)
        right_counts = encoder_delta(counts[1], right)
        moved = left_counts != 0 or right_counts != 0
        self._standstill.on_encoders(t_s, moved=moved)
        scale = 1.0 + self.ekf.wheel_scale_error
        self._roll(
            t_s, dt, scale * self._left_m * left_counts, scale * self._right_m * right_counts
        )

    # -- internal ------------------------------------------------------------------------------

    def _warm_to(self, temperature_c: float) -> None:
        before_c = self._chip_c
        if before_c is None or abs(temperature_c - before_c) > self.tuning.warming_jump_c:
            self._chip_c = temperature_c  # the device restarted
            return
        self._chip_c = before_c + self.tuning.warming_lowpass * (temperature_c - before_c)
        self.ekf.warm(self._chip_c - before_c)

    def _roll(self, t_s: float, dt: float, left: float, right: float) -> None:
        """Move by the paths of both wheels, m, since the last sample."""
        travel = 0.5 * (left + right)
        if dt > 0.0:
            self._speed += self.tuning.speed_lowpass * (travel / dt - self._speed)
            if left == right == 0.0 and abs(self._speed) < _STILL_M_S:
                self._speed = 0.0
        rotation, by_wheels = self._rotation(t_s, dt, (right - left) / self._model.wheel_base_m)
        if self._bridge is not None and by_wheels:
            self._end_bridge(self._bridge)  # without samples it measures no path
        if self._bridge is not None:
            travel = 0.0
            if self._bridge.has_ended(self._speed, dt):
                travel = self._bridge.restored_m
                self._end_bridge(self._bridge)
            elif self._bridge.stalled:
                self._note(DisturbanceKind.STALL, t_s, self._speed)
        elif not by_wheels:
            travel = self._path_without_slip(t_s, dt, left, right, rotation)
        if travel or rotation or self._turning_s:
            turning_s, self._turning_s = self._turning_s, 0.0
            chord = travel * sinc(0.5 * rotation)
            self.ekf.advance(chord, rotation, max(dt, 0.0), turning_s, by_wheels=by_wheels)
        elif dt > 0.0:
            self.ekf.wait(dt)

    def _rotation(self, t_s: float, dt_s: float, wheel_turn: float) -> tuple[float, bool]:
        """Return the turn since the last encoder sample, rad.

        The flag is True if the wheels gave it.
        """
        mark = self.ekf.heading_mark_rad
        silent = (
            self._imu_s is None or t_s - self._imu_s > IMU_GAP_S or not self._standstill.bias_known
        )
        by_wheels = silent or self._gyro_gap
        self._gyro_gap = False
        if by_wheels:
            now = mark + wheel_turn
            self.ekf.theta_rad = now
            self._turning_s = 0.0
            if not silent:  # the next gyro sample adds the turn since the last one
                self.ekf.theta_rad -= self._yaw_rate * (t_s - (self._imu_s or t_s))
            elif dt_s > 0.0:
                self._yaw_rate = wheel_turn / dt_s
        else:
            now = self.ekf.theta_rad + self._yaw_rate * (t_s - (self._imu_s or t_s))
        self.ekf.heading_mark_rad = now
        return now - mark, by_wheels

    def _feel(self, t_s: float, dt: float, ahead: float, aside: float) -> None:
        """Detect a bump.

        After a bump, the accelerometer moves the position instead of the wheels.
        """
        bridge = self._bridge
        if self._bumps.moving(ahead, aside) and bridge is None:
            size = math.hypot(ahead, aside) * dt
            self._note(DisturbanceKind.BUMP, t_s, size)
            self._bridge = bridge = InertialBridge(self._speed, self.tuning.bridge)
            # The wheels were right until the bump. Their last count is up to 20 ms older than the
            # bump.
            before_s = min(max(t_s - 0.5 * dt - self._encoder_s, 0.0), IMU_GAP_S)
            self.ekf.shift(self._speed * before_s, 0.0)
        self.ekf.inflate_for_vibration(self._bumps.vibration_m_s2)
        if bridge is None:
            return
        ahead_m, aside_m = bridge.push(ahead, aside, self._yaw_rate, dt)
        self.ekf.shift(ahead_m, aside_m)
        # A velocity error σ causes a position variance of (σt)². It grows by 2σ²t·dt in each step.
        tuning = self.tuning.bridge
        sigma = tuning.sigma_m_s + tuning.sigma_m_s2 * bridge.age_s
        self.ekf.inflate(sigma * math.sqrt(2.0 * bridge.age_s * dt), 0.0)

    def _end_bridge(self, bridge: InertialBridge) -> None:
        tuning = self.tuning.bridge
        self.ekf.inflate(
            tuning.clipped_sigma_m if bridge.clipped else tuning.sigma_m, tuning.sigma_rad
        )
        self._bridge = None

    def _path_without_slip(
        self, t_s: float, dt: float, left: float, right: float, rotation: float
    ) -> float:
        """Return the forward path, m. If a wheel slips, only the other wheel is used."""
        turn = rotation * self._model.wheel_base_m
        self.ekf.slip_monitor.update(left, right, turn)
        side = self._slips.update(left, right, turn, dt)
        if side == 0:
            self._slipping = 0
            return 0.5 * (left + right)
        if side != self._slipping:
            self._slipping = side
            kind = DisturbanceKind.SLIP_RIGHT if side > 0 else DisturbanceKind.SLIP_LEFT
            self._note(kind, t_s, abs(right - left - turn) / dt)
        path_m = left + 0.5 * turn if side > 0 else right - 0.5 * turn
        share = self.tuning.disturbance.slip_sigma_share
        self.ekf.inflate_slip(share * abs(0.5 * (left + right) - path_m), 0.0)
        return path_m

    def _note(self, kind: DisturbanceKind, t_s: float, size: float) -> None:
        last = self._disturbances[-1] if self._disturbances else None
        onset_s = self.tuning.disturbance.onset_s
        if last is None or last.kind is not kind or t_s - last.t_s > onset_s:
            self._disturbances.append(Disturbance(kind, t_s, size))
            del self._disturbances[:-_KEPT]

    def _update_bias(self, mean_rad_s: float) -> None:
        """Update the bias with the mean of a batch of gyro samples at standstill."""
        variance = self.ekf.drift.gyro_sample_rad_s**2 / BATCH
        self.ekf.propagate_covariance()
        self.ekf.apply(
            self.ekf.joint_covariance.update_one(
                BIAS, mean_rad_s - self.ekf.gyro_bias_rad_s, variance
            )
        )
