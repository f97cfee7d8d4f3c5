"""Pose from encoders and gyro, sans-I/O: samples in, pose and covariance out.

A Kalman filter over (x, y, θ, b): position, heading and gyro bias. The gyro turns the
heading, the encoders move the position along it (eq. 5), and standing still measures the
bias. Corrections by walls would be further measurements of the same four states.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.heading import GyroNoise, Standstill
from bridge.motion.kinematics import encoder_delta
from bridge.motion.odometry import sinc

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

Covariance = tuple[
    tuple[float, float, float],
    tuple[float, float, float],
    tuple[float, float, float],
]

ENCODER_GAP_S = 10.0
"""Beyond this a 16-bit counter may have wrapped by more than half unseen (4.3 m)."""
IMU_GAP_S = 0.1
"""Beyond this the rate between two gyro samples is not known; the wheels turn the heading."""
_FIRST_BIAS_SAMPLES = 25
"""Rest samples before the gyro is trusted; until then the wheels turn the heading."""
_LARGEST_BIAS_RAD_S = 0.4
"""Above the data sheet's ±20 °/s a first sample is a motion, not a bias."""
_ALONG_M_SQRT_M = 0.01
"""Position noise along the way per √m: wheel scale, quantisation, a little slip (our choice)."""
_ACROSS_M_SQRT_M = 0.003
_WHEEL_TURN_RAD_SQRT_RAD = 0.03
"""Heading noise per √rad when the wheels alone must tell it (wheel base, scrub)."""
_SPEED_LOWPASS = 0.5
"""Share of the newest interval in the speed: one count in 20 ms is already 6.5 mm/s."""


class PoseEstimator:
    """Dead reckoning with a gyro heading.

    Feed samples in the order of their stamps as far as possible; a stale gyro sample is
    ignored. All times are of one clock, in seconds; only differences matter. The first encoder
    sample is the reference. While no gyro sample comes for 0.1 s, and before the first rest of
    25 gyro samples, the heading is taken from the wheels (eq. 4).
    """

    __slots__ = (
        "_bias",
        "_counts",
        "_encoder_s",
        "_gyro",
        "_heading_mark",
        "_imu_s",
        "_known",
        "_model",
        "_noise",
        "_pbb",
        "_ptb",
        "_ptt",
        "_pxb",
        "_pxt",
        "_pxx",
        "_pxy",
        "_pyb",
        "_pyt",
        "_pyy",
        "_rest_samples",
        "_resting",
        "_speed",
        "_standstill",
        "_theta",
        "_turning_s",
        "_x",
        "_y",
        "_yaw_rate",
    )

    def __init__(self, model: RobotModel, start: Pose2, noise: GyroNoise | None = None) -> None:
        """``start`` is taken as exact: the frame is the one in which it was given."""
        self._model = model
        self._noise = noise or GyroNoise()
        self._standstill = Standstill()
        self._counts: tuple[int, int] | None = None
        self._encoder_s = 0.0
        self._imu_s: float | None = None
        self._gyro = 0.0
        self._bias = 0.0
        self._rest_samples = 0
        self._resting = True
        self._pbb = self._noise.bias_prior_rad_s**2
        self.reset(start)

    # -- what is known ---------------------------------------------------------------------

    @property
    def pose(self) -> Pose2:
        """Position at the newest encoder sample, heading at the newest gyro sample."""
        return Pose2(self._x, self._y, wrap_angle(self._theta))

    @property
    def v_m_s(self) -> float:
        """Forward speed from the encoders, lightly smoothed."""
        return self._speed

    @property
    def yaw_rate_rad_s(self) -> float:
        """Yaw rate from the gyro less its bias, or from the wheels while the gyro is silent."""
        return self._yaw_rate

    @property
    def gyro_bias_rad_s(self) -> float:
        """Present estimate of the gyro's bias."""
        return self._bias

    @property
    def gyro_bias_sigma_rad_s(self) -> float:
        """Standard deviation of the bias; large until the robot has stood still once."""
        return math.sqrt(self._pbb)

    @property
    def known(self) -> bool:
        """False after an encoder gap above 10 s, until :meth:`reset`."""
        return self._known

    @property
    def at_rest(self) -> bool:
        """Whether the last gyro sample was taken as one at rest."""
        return self._resting

    @property
    def covariance(self) -> Covariance:
        """Of (x, y, θ): m², m·rad, rad²."""
        return (
            (self._pxx, self._pxy, self._pxt),
            (self._pxy, self._pyy, self._pyt),
            (self._pxt, self._pyt, self._ptt),
        )

    def reset(self, pose: Pose2) -> None:
        """Set the pose as exact and known. The bias learnt so far is kept."""
        self._x, self._y, self._theta = pose
        self._heading_mark = self._theta
        self._known = True
        self._speed = 0.0
        self._yaw_rate = 0.0
        self._turning_s = 0.0
        self._pxx = self._pxy = self._pyy = 0.0
        self._pxt = self._pyt = self._ptt = 0.0
        self._pxb = self._pyb = self._ptb = 0.0

    # -- samples ---------------------------------------------------------------------------

    def on_imu(self, t_s: float, gyro_z_rad_s: float) -> None:
        """Take one gyro sample: yaw rate in rad/s, uncorrected, counter-clockwise positive."""
        previous_s, previous = self._imu_s, self._gyro
        if previous_s is not None and t_s <= previous_s:
            return
        self._imu_s = t_s
        self._gyro = gyro_z_rad_s
        rate = gyro_z_rad_s - self._bias
        trusted = self._rest_samples >= _FIRST_BIAS_SAMPLES
        least = Standstill.RATE_VETO_RAD_S if trusted else _LARGEST_BIAS_RAD_S
        still = self._standstill.at_rest(t_s)
        self._resting = still and abs(rate if trusted else gyro_z_rad_s) < least
        if self._resting:
            self._measure_bias(gyro_z_rad_s)
            self._yaw_rate = 0.0
            return
        if not trusted:
            # set off before the rest was long enough: its few samples may be of the start
            self._rest_samples = 0
            self._bias = 0.0
            self._pbb = self._noise.bias_prior_rad_s**2
            return
        self._yaw_rate = rate
        if previous_s is None or t_s - previous_s > IMU_GAP_S:
            return
        dt = t_s - previous_s
        self._theta += (0.5 * (gyro_z_rad_s + previous) - self._bias) * dt
        self._turning_s += dt

    def on_encoders(self, t_s: float, left: int, right: int) -> None:
        """Take one encoder sample: absolute 16-bit counts, wrapping."""
        counts, last_s = self._counts, self._encoder_s
        self._counts = (left, right)
        self._encoder_s = t_s
        if counts is None:
            self._standstill.on_encoders(t_s, moved=False)
            return
        dt = t_s - last_s
        if dt > ENCODER_GAP_S:
            self._known = False
            self._speed = 0.0
            self._heading_mark = self._theta
            self._standstill.on_encoders(t_s, moved=True)
            return
        left_counts = encoder_delta(counts[0], left)
        right_counts = encoder_delta(counts[1], right)
        moved = left_counts != 0 or right_counts != 0
        self._standstill.on_encoders(t_s, moved=moved)
        scale = self._model.metres_per_count
        travel = 0.5 * scale * (left_counts + right_counts)
        if dt > 0.0:
            self._speed += _SPEED_LOWPASS * (travel / dt - self._speed)
            if not moved and abs(self._speed) < 1e-3:  # noqa: PLR2004 - a millimetre a second
                self._speed = 0.0
        wheel_turn = scale * (right_counts - left_counts) / self._model.wheel_base_m
        rotation = self._rotation(t_s, dt, wheel_turn)
        if dt > 0.0:
            self._pbb += self._noise.bias_walk_rad_s_sqrt_s**2 * dt
        if travel or rotation or self._turning_s:
            self._advance(travel, rotation)

    def correct_yaw(self, error_rad: float, variance: float) -> None:
        """Take a measurement of the heading's error (estimate less truth, rad²)."""
        self._correct((0.0, 0.0, 1.0), error_rad, variance)

    def correct_position(
        self, direction_x: float, direction_y: float, error_m: float, variance: float
    ) -> None:
        """Take a measurement of the position's error along a unit vector (m, m²)."""
        self._correct((direction_x, direction_y, 0.0), error_m, variance)

    def disturb(self, sigma_m: float, sigma_rad: float) -> None:
        """Grow the doubt: something moved the robot that wheels and gyro do not tell whole."""
        self._pxx += sigma_m**2
        self._pyy += sigma_m**2
        self._ptt += sigma_rad**2

    # -- inside ----------------------------------------------------------------------------

    def _correct(self, h: tuple[float, float, float], error: float, variance: float) -> None:
        """One scalar Kalman update for a measurement of h·(x, y, θ); the bias follows."""
        hx, hy, ht = h
        x = self._pxx * hx + self._pxy * hy + self._pxt * ht
        y = self._pxy * hx + self._pyy * hy + self._pyt * ht
        t = self._pxt * hx + self._pyt * hy + self._ptt * ht
        b = self._pxb * hx + self._pyb * hy + self._ptb * ht
        gain = 1.0 / (hx * x + hy * y + ht * t + variance)
        step = -error * gain
        self._x += x * step
        self._y += y * step
        self._theta += t * step
        self._heading_mark += t * step
        self._bias += b * step
        self._pxx -= x * x * gain
        self._pxy -= x * y * gain
        self._pyy -= y * y * gain
        self._pxt -= x * t * gain
        self._pyt -= y * t * gain
        self._ptt -= t * t * gain
        self._pxb -= x * b * gain
        self._pyb -= y * b * gain
        self._ptb -= t * b * gain
        self._pbb -= b * b * gain

    def _rotation(self, t_s: float, dt_s: float, wheel_turn: float) -> float:
        """Heading change since the last encoder sample; leaves the mark at this one."""
        mark = self._heading_mark
        if (
            self._imu_s is not None
            and t_s - self._imu_s <= IMU_GAP_S
            and self._rest_samples >= _FIRST_BIAS_SAMPLES
        ):
            now = self._theta + self._yaw_rate * (t_s - self._imu_s)
        else:
            now = mark + wheel_turn
            self._theta = now
            self._turning_s = 0.0
            self._ptt += _WHEEL_TURN_RAD_SQRT_RAD**2 * abs(wheel_turn)
            if dt_s > 0.0:
                self._yaw_rate = wheel_turn / dt_s
        self._heading_mark = now
        return now - mark

    def _advance(self, travel: float, rotation: float) -> None:
        """Move the position along the arc (eq. 5) and propagate the covariance, F P Fᵀ + Q."""
        half = 0.5 * rotation
        mid = self._heading_mark - half
        chord = travel * sinc(half)
        c, s = math.cos(mid), math.sin(mid)
        dx, dy = chord * c, chord * s
        self._x += dx
        self._y += dy
        noise = self._noise
        turning, self._turning_s = self._turning_s, 0.0
        ptt, ptb, pbb = self._ptt, self._ptb, self._pbb
        pxt, pyt, pxb, pyb = self._pxt, self._pyt, self._pxb, self._pyb
        # F: ∂x/∂θ = -Δy, ∂y/∂θ = Δx, ∂θ/∂b = -(time the gyro was integrated)
        way = abs(travel)
        along, across = _ALONG_M_SQRT_M**2 * way, _ACROSS_M_SQRT_M**2 * way
        self._pxx += -2.0 * dy * pxt + dy * dy * ptt + along * c * c + across * s * s
        self._pyy += 2.0 * dx * pyt + dx * dx * ptt + along * s * s + across * c * c
        self._pxy += dx * pxt - dy * pyt - dx * dy * ptt + (along - across) * c * s
        self._pxb = pxb - dy * ptb
        self._pyb = pyb + dx * ptb
        self._pxt = pxt - dy * ptt - turning * self._pxb
        self._pyt = pyt + dx * ptt - turning * self._pyb
        self._ptt = (
            ptt
            - 2.0 * turning * ptb
            + turning * turning * pbb
            + noise.density_rad_sqrt_s**2 * turning
            + noise.scale_rad_sqrt_rad**2 * abs(rotation)
        )
        self._ptb = ptb - turning * pbb

    def _measure_bias(self, gyro: float) -> None:
        """At rest a gyro sample *is* the bias: one scalar Kalman update.

        From the wide prior this is the plain mean of the samples; later the assumed walk of
        the bias sets the time constant (about 4 s at 100 Hz with the default figures). The heading
        is corrected by what the bias did to it since the last rest.
        """
        self._rest_samples += 1
        noise = self._noise
        pbb, ptb, pxb, pyb = self._pbb, self._ptb, self._pxb, self._pyb
        gain = 1.0 / (pbb + noise.sample_rad_s**2)
        innovation = (gyro - self._bias) * gain
        self._bias += pbb * innovation
        turn = ptb * innovation
        self._theta += turn
        self._heading_mark += turn
        self._x += pxb * innovation
        self._y += pyb * innovation
        self._pxx -= pxb * pxb * gain
        self._pxy -= pxb * pyb * gain
        self._pyy -= pyb * pyb * gain
        self._pxt -= pxb * ptb * gain
        self._pyt -= pyb * ptb * gain
        self._ptt -= ptb * ptb * gain
        keep = 1.0 - pbb * gain
        self._pxb = pxb * keep
        self._pyb = pyb * keep
        self._ptb = ptb * keep
        self._pbb = pbb * keep
