"""The pose's Gaussian filter: means and covariance, moved and corrected; no samples, no clock.

States: x, y, θ; b, the gyro's bias at rest; m, its shift in motion (vibration), which only
walls seen again can show; k, the gyro's scale error; s, the wheels' scale error (a count is
worth 1 + s times its nominal way); c, how much b changes with the chip's temperature; and behind
them the walls that ``wall_map`` remembers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.estimation.drift_model import DriftModel, NoiseScale
from bridge.motion.estimation.joint_covariance import JointCovariance
from bridge.motion.estimation.noise_monitor import SlipMonitor, gyro_share
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
_BIAS_SHAKEN, _WALK_SHAKEN = 0.6, 1.5
"""Powers of the gyro's share (vibration squared) with which its bias in motion and its scale grow,
and its walk: from ``typical`` to ``harsh`` (2.7 times the vibration) threefold and 19-fold."""
UPDATE_DELAY_S = 0.1
"""The covariance is at most this old."""


@dataclass(slots=True)
class Due:
    """Motion that the covariance has not followed yet."""

    dx: float = 0.0
    dy: float = 0.0
    way_cc: float = 0.0
    """Way times cos², and so on: along the way the noise is another than across it."""
    way_cs: float = 0.0
    way_ss: float = 0.0
    wheel_rotation: float = 0.0
    """Amount of turning told by the wheels, while the gyro was silent."""
    turned: float = 0.0
    turning_s: float = 0.0
    rotation: float = 0.0
    warmed_c: float = 0.0
    """By how much the gyro became warmer."""
    time_s: float = 0.0


class PoseFilter:
    """Means and covariance of the pose, of what the sensors do wrong, and of walls."""

    def __init__(self, start: Pose2, drift: DriftModel | None = None) -> None:
        """``start`` is taken as exact: the frame is the one in which it was given."""
        self.drift = noise = drift or DriftModel()
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
        """Means of the belief's further states; ``wall_map`` says what they are."""
        self.yaw_noise, self.way_noise = NoiseScale(25.0), NoiseScale(25.0)
        """How much more than the model's this gyro and these wheels stray; whoever takes
        measurements teaches them."""
        self.slip_monitor = SlipMonitor(noise.along_m_sqrt_m)
        self._x, self._y, self._theta = start
        self._heading_mark = self._theta
        self._bias = self._motion_bias = self._gyro_scale = self._wheel_scale = 0.0
        self._bias_slope = 0.0
        self._odometry = Pose2(0.0, 0.0, 0.0)
        self._due = Due()
        self._shaken = self._worst_shaken = self._worst_slip = 1.0
        self._transition: Floats = np.eye(STATES)
        self._noise: Floats = np.zeros((STATES, STATES))

    # -- what is known ---------------------------------------------------------------------

    @property
    def pose(self) -> Pose2:
        """Position at the newest encoder sample, heading at the newest gyro sample."""
        return Pose2(self._x, self._y, wrap_angle(self._theta))

    @property
    def odometry(self) -> Pose2:
        """The same motion without the jumps of corrections; its frame drifts."""
        return self._odometry

    @property
    def gyro_bias_rad_s(self) -> float:
        """Present estimate of the gyro's bias at rest."""
        return self._bias

    @property
    def gyro_bias_sigma_rad_s(self) -> float:
        """Standard deviation of the bias; large until the robot has stood still once."""
        return math.sqrt(max(float(self.joint_covariance.p[BIAS, BIAS]), 0.0))

    @property
    def motion_bias_rad_s(self) -> float:
        """Estimate of what motion adds to the bias."""
        return self._motion_bias

    @property
    def wheel_scale(self) -> float:
        """True way over the nominal way of a count, about 1."""
        return 1.0 + self._wheel_scale

    @property
    def wheel_scale_sigma(self) -> float:
        """Its standard deviation."""
        return math.sqrt(max(float(self.joint_covariance.p[WHEEL_SCALE, WHEEL_SCALE]), 0.0))

    @property
    def covariance(self) -> Covariance:
        """Of (x, y, θ): m², m·rad, rad²; as of at most 0.1 s ago, see :meth:`update_pending`."""
        (xx, xy, xt), (_, yy, yt), (_, _, tt) = self.joint_covariance.p[:3, :3].tolist()
        return (xx, xy, xt), (xy, yy, yt), (xt, yt, tt)

    # -- corrections -----------------------------------------------------------------------

    def correct_yaw(self, error_rad: float, variance: float) -> None:
        """Take a measurement of the heading's error (estimate less truth, rad²)."""
        self.update_pending()
        self.apply(self.joint_covariance.update_one(THETA, -error_rad, variance))

    def correct_position(
        self, direction_x: float, direction_y: float, error_m: float, variance: float
    ) -> None:
        """Take a measurement of the position's error along a unit vector (m, m²)."""
        rows = np.array([[direction_x, direction_y]])
        self.correct((X, Y), rows, np.array([-error_m]), np.array([[variance]]))

    def correct(
        self,
        index: Sequence[int],
        rows: Floats,
        innovation: Floats,
        noise: Floats,
        held: Sequence[int] = (),
    ) -> None:
        """Take a measurement of any states, as ``JointCovariance.update``."""
        self.update_pending()
        self.apply(self.joint_covariance.update(index, rows, innovation, noise, held))

    def inflate(self, sigma_m: float, sigma_rad: float) -> None:
        """Grow the doubt: something moved the robot that wheels and gyro do not tell whole."""
        p = self.joint_covariance.p
        p[X, X] += sigma_m**2
        p[Y, Y] += sigma_m**2
        p[THETA, THETA] += sigma_rad**2

    def inflate_along(self, sigma_m: float) -> None:
        """Grow the doubt of the way made ahead, as by wheels that slipped."""
        c, s = math.cos(self._theta), math.sin(self._theta)
        p, v = self.joint_covariance.p, sigma_m**2
        p[X, X] += v * c * c
        p[Y, Y] += v * s * s
        p[X, Y] += v * c * s
        p[Y, X] += v * c * s

    def apply(self, step: Floats) -> None:
        """Add a correction to the means of every state."""
        x, y, theta, bias, motion_bias, gyro_scale, wheel_scale, slope = step[:STATES].tolist()
        self._x += x
        self._y += y
        self._theta += theta
        self._heading_mark += theta
        self._bias += bias
        self._motion_bias += motion_bias
        self._gyro_scale += gyro_scale
        self._wheel_scale += wheel_scale
        self._bias_slope += slope
        for i, change in enumerate(step[STATES:].tolist()):
            self.walls[i] += change

    # -- motion ----------------------------------------------------------------------------

    def restart(self, pose: Pose2) -> None:
        """Set the pose as exact; walls are forgotten, what the sensors are is kept."""
        if self.walls:
            self.joint_covariance.remove(STATES, len(self.walls))
            self.walls.clear()
        self._x, self._y, self._theta = pose
        self._heading_mark = self._theta
        self._due = Due()
        self.joint_covariance.forget((X, Y, THETA), (0.0, 0.0, 0.0))

    def wait(self, time_s: float) -> None:
        """Let time pass in which nothing moved."""
        self._due.time_s += time_s
        if self._due.time_s >= UPDATE_DELAY_S:
            self.update_pending()

    def advance(
        self, chord: float, rotation: float, time_s: float, turning_s: float, *, by_wheels: bool
    ) -> None:
        """Move the position along a chord (eq. 5) that ends at the present heading.

        Args:
            chord: its length, m, backwards negative.
            rotation: what the heading, already moved, turned meanwhile.
            time_s: how long that took.
            turning_s: how long of it the gyro was integrated.
            by_wheels: whether the rotation is the wheels' and not the gyro's.

        """
        mid = self._heading_mark - 0.5 * rotation
        c, s = math.cos(mid), math.sin(mid)
        dx, dy = chord * c, chord * s
        self._x += dx
        self._y += dy
        x, y, theta = self._odometry
        between = theta + 0.5 * rotation
        self._odometry = Pose2(
            x + chord * math.cos(between), y + chord * math.sin(between), theta + rotation
        )
        due, way = self._due, abs(chord)
        due.dx += dx
        due.dy += dy
        due.way_cc += way * c * c
        due.way_cs += way * c * s
        due.way_ss += way * s * s
        if by_wheels:
            due.wheel_rotation += abs(rotation)
        else:
            due.rotation += rotation
            due.turned += abs(rotation)
        due.turning_s += turning_s
        due.time_s += time_s
        if due.time_s >= UPDATE_DELAY_S:
            self.update_pending()

    @property
    def across_m_sqrt_m(self) -> float:
        """How far these wheels slide aside over a metre, at random."""
        return self.slip_monitor.slippery * self.drift.across_m_sqrt_m

    def update_pending(self) -> None:
        """Bring the covariance up to the newest encoder sample: F P Fᵀ + Q of all since.

        It is done for some steps at once, as it costs more than they do; every correction does
        it first.
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
        along = self.way_noise.value * along_m * along_m
        across = self.way_noise.value * across_m * across_m
        q[X, X] = along * due.way_cc + across * due.way_ss
        q[Y, Y] = along * due.way_ss + across * due.way_cc
        q[X, Y] = q[Y, X] = (along - across) * due.way_cs
        walk = math.hypot(
            drift.gyro_walk_rad_sqrt_s, drift.gyro_shaken_rad_sqrt_s * self._shaken**_WALK_SHAKEN
        )
        by_gyro = walk**2 * due.turning_s + drift.turn_walk_rad_sqrt_rad**2 * due.turned
        by_wheels = drift.wheel_turn_rad_sqrt_rad**2 * due.wheel_rotation
        q[THETA, THETA] = self.yaw_noise.value * by_gyro + by_wheels
        q[BIAS, BIAS] = drift.bias_walk_rad_s_sqrt_s**2 * due.time_s
        q[MOTION_BIAS, MOTION_BIAS] = drift.motion_bias_walk_rad_s_sqrt_s**2 * due.turning_s
        self.joint_covariance.propagate(f, q)

    def _inflate_for_wheels(self) -> None:
        """Of wheels that are found to slip more than ever the mean way is less sure."""
        most = self.slip_monitor.mean_slippery
        if most > self._worst_slip:
            grown = most * most - self._worst_slip * self._worst_slip
            self.joint_covariance.p[WHEEL_SCALE, WHEEL_SCALE] += grown * self.drift.wheel_scale**2
            self._worst_slip = most

    def warm(self, change_c: float) -> None:
        """Tell that the gyro became warmer, by so many °C: its bias moves with that."""
        self._bias += self._bias_slope * change_c
        self._due.warmed_c += change_c

    def shift(self, ahead_m: float, aside_m: float) -> None:
        """Move the position in the body's frame."""
        for way, side in ((ahead_m, 0.0), (aside_m, 0.5 * math.pi)):
            heading = self._theta + side
            self._x += way * math.cos(heading)
            self._y += way * math.sin(heading)
            x, y, theta = self._odometry
            turned = theta + side
            self._odometry = Pose2(x + way * math.cos(turned), y + way * math.sin(turned), theta)

    def inflate_for_vibration(self, vibration_m_s2: float) -> None:
        """Tell how much the robot vibrates: the gyro is the worse for it, its bias as well."""
        share = gyro_share(vibration_m_s2)
        most = max(self._worst_shaken, share**_BIAS_SHAKEN)
        if most > self._worst_shaken:
            grown = most * most - self._worst_shaken * self._worst_shaken
            p = self.joint_covariance.p
            p[MOTION_BIAS, MOTION_BIAS] += grown * self.drift.motion_bias_rad_s**2
            p[GYRO_SCALE, GYRO_SCALE] += grown * self.drift.gyro_scale**2
            self._worst_shaken = most
        self._shaken = share
