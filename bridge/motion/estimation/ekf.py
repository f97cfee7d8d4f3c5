"""The extended Kalman filter: mean and covariance of the robot's states and of its landmarks.

The states are: x, y, θ; the gyro bias at standstill, b; the shift of this bias by vibration in
motion, m, which only wall measurements observe; the gyro's scale error, k; the wheels' scale error,
s (the path of a count is 1 + s times its nominal path); the slope of b with the chip's temperature,
c. The landmarks of ``wall_map`` follow. The filter contains no samples and no clock. The estimator
calls its methods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.estimation.drift_model import DriftModel, NoiseScale
from bridge.motion.estimation.joint_covariance import JointCovariance
from bridge.motion.estimation.noise_monitor import NoiseTuning, SlipMonitor, gyro_share
from bridge.motion.geometry import Pose2, wrap_angle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

Covariance = tuple[
    tuple[float, float, float],
    tuple[float, float, float],
    tuple[float, float, float],
]

X, Y, THETA, BIAS, MOTION_BIAS, GYRO_SCALE, WHEEL_SCALE, BIAS_SLOPE = range(8)
STATES = 8
UPDATE_DELAY_S = 0.1
"""Maximum age of the covariance, s."""


@dataclass(slots=True)
class Due:
    """Motion since the last prediction of the covariance."""

    dx: float = 0.0
    """Displacement in the frame of the estimate, m."""
    dy: float = 0.0
    """Displacement in the frame of the estimate, m."""
    path_cc: float = 0.0
    """Path times cos² of the heading, m. Three such sums separate the noise along and across the
    path."""
    path_cs: float = 0.0
    """Path times cos · sin of the heading, m."""
    path_ss: float = 0.0
    """Path times sin² of the heading, m."""
    wheel_rotation: float = 0.0
    """Sum of the turns that the wheels measured because gyro samples were missing, rad."""
    turned: float = 0.0
    """Sum of the absolute turns that the gyro measured, rad."""
    turning_s: float = 0.0
    """Time in which the gyro was integrated, s."""
    rotation: float = 0.0
    """Sum of the turns that the gyro measured, with their signs, rad."""
    warmed_c: float = 0.0
    """Rise of the chip's temperature, °C."""
    time_s: float = 0.0
    """Duration, s."""


class Ekf:
    """Mean and covariance of the pose, the sensor errors and the walls."""

    def __init__(
        self, start: Pose2, drift: DriftModel | None = None, tuning: NoiseTuning | None = None
    ) -> None:
        """Begin at an exact pose. It defines the frame of all poses."""
        self.drift = noise = drift or DriftModel()
        self._tuning = tuning = tuning or NoiseTuning()
        self.joint_covariance = JointCovariance(
            (
                0.0,
                0.0,
                0.0,
                noise.bias_prior_rad_s**2,
                noise.motion_bias_rad_s**2,
                noise.gyro_scale**2,
                noise.wheel_scale**2,
                noise.bias_slope_rad_s_c**2,
            )
        )
        self.walls: list[float] = []
        """Means of the landmarks; see ``wall_map``."""
        self.yaw_noise, self.path_noise = NoiseScale(tuning), NoiseScale(tuning)
        """Factors on the modelled noise of gyro and wheels, estimated from wall measurements."""
        self.slip_monitor = SlipMonitor(noise.along_m_sqrt_m, tuning)
        self.x_m, self.y_m, self.theta_rad = start
        self.heading_mark_rad = self.theta_rad
        """Heading at the newest encoder sample, rad."""
        self.gyro_bias_rad_s = self.motion_bias_rad_s = self.gyro_scale = self.wheel_scale_error = (
            0.0
        )
        self._bias_slope = 0.0
        self._odometry = Pose2(0.0, 0.0, 0.0)
        self._due = Due()
        self._shaken = self._worst_shaken = self._worst_slip = 1.0
        self._transition: Floats = np.eye(STATES)
        self._noise: Floats = np.zeros((STATES, STATES))

    # -- present estimate -------------------------------------------------------------------

    @property
    def pose(self) -> Pose2:
        """Position at the newest encoder sample, and heading at the newest gyro sample."""
        return Pose2(self.x_m, self.y_m, wrap_angle(self.theta_rad))

    @property
    def odometry(self) -> Pose2:
        """Pose from dead reckoning without corrections. It drifts."""
        return self._odometry

    @property
    def gyro_bias_sigma_rad_s(self) -> float:
        """Standard deviation of the gyro bias, rad/s. It is large until the first standstill."""
        return math.sqrt(max(float(self.joint_covariance.p[BIAS, BIAS]), 0.0))

    @property
    def wheel_scale(self) -> float:
        """Ratio of the true path of a count to its nominal path, about 1."""
        return 1.0 + self.wheel_scale_error

    @property
    def covariance(self) -> Covariance:
        """Covariance of (x, y, θ), 3×3, m², m·rad and rad², at most 0.1 s old."""
        (xx, xy, xt), (_, yy, yt), (_, _, tt) = self.joint_covariance.p[:3, :3].tolist()
        return (xx, xy, xt), (xy, yy, yt), (xt, yt, tt)

    def sigma_along_m(self, direction_rad: float) -> float:
        """Return the standard deviation of the position along a direction, m, at most 0.1 s old."""
        (xx, xy, _), (_, yy, _), _ = self.covariance
        c, s = math.cos(direction_rad), math.sin(direction_rad)
        return math.sqrt(max(c * c * xx + 2.0 * c * s * xy + s * s * yy, 0.0))

    # -- updates ---------------------------------------------------------------------------

    def update(
        self,
        index: Sequence[int],
        rows: Floats,
        innovation: Floats,
        noise: Floats,
        held: Sequence[int] = (),
    ) -> None:
        """Update with a measurement of any states; see :meth:`JointCovariance.update`."""
        self.propagate_covariance()
        self.apply(self.joint_covariance.update(index, rows, innovation, noise, held))

    def inflate(self, sigma_m: float, sigma_rad: float) -> None:
        """Add variance to position (m) and heading (rad) after a motion that no sensor measured."""
        p = self.joint_covariance.p
        p[X, X] += sigma_m**2
        p[Y, Y] += sigma_m**2
        p[THETA, THETA] += sigma_rad**2

    def inflate_slip(self, along_m: float, across_m: float) -> None:
        """Add variance along and across the heading after slip: standard deviations, m."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        p, along, across = self.joint_covariance.p, along_m**2, across_m**2
        p[X, X] += along * c * c + across * s * s
        p[Y, Y] += along * s * s + across * c * c
        p[X, Y] += (along - across) * c * s
        p[Y, X] += (along - across) * c * s

    def apply(self, step: Floats) -> None:
        """Add a step to the mean of every state."""
        x, y, theta, bias, motion_bias, gyro_scale, wheel_scale, slope = step[:STATES].tolist()
        self.x_m += x
        self.y_m += y
        self.theta_rad += theta
        self.heading_mark_rad += theta
        self.gyro_bias_rad_s += bias
        self.motion_bias_rad_s += motion_bias
        self.gyro_scale += gyro_scale
        self.wheel_scale_error += wheel_scale
        self._bias_slope += slope
        for i, change in enumerate(step[STATES:].tolist()):
            self.walls[i] += change

    # -- motion ----------------------------------------------------------------------------

    def restart(self, pose: Pose2) -> None:
        """Set an exact pose. Landmarks are marginalised; the estimated sensor errors stay."""
        if self.walls:
            self.joint_covariance.marginalise(STATES, len(self.walls))
            self.walls.clear()
        self.x_m, self.y_m, self.theta_rad = pose
        self.heading_mark_rad = self.theta_rad
        self._due = Due()
        self.joint_covariance.reset((X, Y, THETA), (0.0, 0.0, 0.0))

    def wait(self, time_s: float) -> None:
        """Predict without motion."""
        self._due.time_s += time_s
        if self._due.time_s >= UPDATE_DELAY_S:
            self.propagate_covariance()

    def advance(
        self, chord: float, rotation: float, time_s: float, turning_s: float, *, by_wheels: bool
    ) -> None:
        """Predict the position along a chord (paper eq. 5) that ends at the present heading.

        Args:
            chord: length of the chord, m; negative: backwards.
            rotation: turn of the heading during the chord, rad. The mean already contains it.
            time_s: duration, s.
            turning_s: time in which the gyro was integrated, s.
            by_wheels: True if the rotation comes from the wheels and not from the gyro.

        """
        mid = self.heading_mark_rad - 0.5 * rotation
        c, s = math.cos(mid), math.sin(mid)
        dx, dy = chord * c, chord * s
        self.x_m += dx
        self.y_m += dy
        x, y, theta = self._odometry
        between = theta + 0.5 * rotation
        self._odometry = Pose2(
            x + chord * math.cos(between), y + chord * math.sin(between), theta + rotation
        )
        due, path_m = self._due, abs(chord)
        due.dx += dx
        due.dy += dy
        due.path_cc += path_m * c * c
        due.path_cs += path_m * c * s
        due.path_ss += path_m * s * s
        if by_wheels:
            due.wheel_rotation += abs(rotation)
        else:
            due.rotation += rotation
            due.turned += abs(rotation)
        due.turning_s += turning_s
        due.time_s += time_s
        if due.time_s >= UPDATE_DELAY_S:
            self.propagate_covariance()

    @property
    def across_m_sqrt_m(self) -> float:
        """Standard deviation of lateral slip, m per square root of the path in m."""
        return self.slip_monitor.slippery * self.drift.across_m_sqrt_m

    def propagate_covariance(self) -> None:
        """Predict the covariance up to the newest encoder sample: P ← F P Fᵀ + Q.

        One call covers several samples, because it takes more time than processing the samples.
        Every update calls it first.
        """
        due = self._due
        if due.time_s == 0.0 and due.turning_s == 0.0:
            return
        self._due = Due()
        f, q, drift = self._transition, self._noise, self.drift
        f[X, THETA], f[Y, THETA] = -due.dy, due.dx
        f[X, WHEEL_SCALE], f[Y, WHEEL_SCALE] = due.dx, due.dy
        f[THETA, BIAS] = f[THETA, MOTION_BIAS] = -due.turning_s
        f[THETA, GYRO_SCALE] = -due.rotation
        f[BIAS, BIAS_SLOPE] = due.warmed_c
        self._inflate_for_wheels()
        along_m = self.slip_monitor.slippery * drift.along_m_sqrt_m
        across_m = self.across_m_sqrt_m
        along = self.path_noise.value * along_m * along_m
        across = self.path_noise.value * across_m * across_m
        q[X, X] = along * due.path_cc + across * due.path_ss
        q[Y, Y] = along * due.path_ss + across * due.path_cc
        q[X, Y] = q[Y, X] = (along - across) * due.path_cs
        walk = math.hypot(
            drift.gyro_walk_rad_sqrt_s,
            drift.gyro_shaken_rad_sqrt_s * self._shaken**self._tuning.walk_power,
        )
        by_gyro = walk**2 * due.turning_s + drift.turn_walk_rad_sqrt_rad**2 * due.turned
        by_wheels = drift.wheel_turn_rad_sqrt_rad**2 * due.wheel_rotation
        q[THETA, THETA] = self.yaw_noise.value * by_gyro + by_wheels
        q[BIAS, BIAS] = drift.bias_walk_rad_s_sqrt_s**2 * due.time_s
        q[MOTION_BIAS, MOTION_BIAS] = drift.motion_bias_walk_rad_s_sqrt_s**2 * due.turning_s
        self.joint_covariance.propagate(f, q)

    def _inflate_for_wheels(self) -> None:
        """Add variance to the wheel scale if the wheels slip more than ever before."""
        worst = self.slip_monitor.mean_slippery
        if worst > self._worst_slip:
            grown = worst * worst - self._worst_slip * self._worst_slip
            self.joint_covariance.p[WHEEL_SCALE, WHEEL_SCALE] += grown * self.drift.wheel_scale**2
            self._worst_slip = worst

    def warm(self, change_c: float) -> None:
        """Change the gyro bias with a change of the chip's temperature, °C."""
        self.gyro_bias_rad_s += self._bias_slope * change_c
        self._due.warmed_c += change_c

    def shift(self, ahead_m: float, aside_m: float) -> None:
        """Move the position in the robot's frame, m."""
        for path_m, side in ((ahead_m, 0.0), (aside_m, 0.5 * math.pi)):
            heading = self.theta_rad + side
            self.x_m += path_m * math.cos(heading)
            self.y_m += path_m * math.sin(heading)
            x, y, theta = self._odometry
            turned = theta + side
            self._odometry = Pose2(
                x + path_m * math.cos(turned), y + path_m * math.sin(turned), theta
            )

    def inflate_for_vibration(self, vibration_m_s2: float) -> None:
        """Scale the gyro's noise with the vibration, m/s².

        A new maximum inflates its bias and scale.
        """
        share = gyro_share(vibration_m_s2, self._tuning)
        worst = max(self._worst_shaken, share**self._tuning.bias_power)
        if worst > self._worst_shaken:
            grown = worst * worst - self._worst_shaken * self._worst_shaken
            p = self.joint_covariance.p
            p[MOTION_BIAS, MOTION_BIAS] += grown * self.drift.motion_bias_rad_s**2
            p[GYRO_SCALE, GYRO_SCALE] += grown * self.drift.gyro_scale**2
            self._worst_shaken = worst
        self._shaken = share
