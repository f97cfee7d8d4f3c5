"""Pose from encoders, gyro and standstill, sans-I/O: samples in, pose and covariance out.

An extended Kalman filter over

    x, y, θ   pose
    b         gyro bias, as it is at rest
    m         shift of that bias in motion (vibration), which only walls seen again can show
    k         gyro scale error
    s         wheel scale error: a count is worth (1 + s) times its nominal way
    c         slope of b with the chip's temperature: b' = c·T'

and behind them the walls that ``wall_map`` remembers. The gyro turns the heading,
θ' = (g - b - m)(1 - k); the encoders move the position along the arc (eq. 5); standing still
measures the bias (zero-velocity update) and moves nothing.
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
from bridge.motion.estimation.odometry import sinc
from bridge.motion.estimation.pose_filter import BIAS, PoseFilter
from bridge.motion.estimation.standstill import Standstill
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.kinematics import encoder_delta

if TYPE_CHECKING:
    from bridge.motion.estimation.drift_model import DriftModel
    from bridge.motion.robot_model import RobotModel

ENCODER_GAP_S = 10.0
"""Beyond this a 16-bit counter may have wrapped by more than half unseen (4.3 m)."""
IMU_GAP_S = 0.1
"""Beyond this the rate between two gyro samples is not known; the wheels turn the heading."""
_FIRST_BIAS_SAMPLES = 25
"""Rest samples before the gyro is trusted; until then the wheels turn the heading."""
_REST_BATCH = 5
"""Rest samples are averaged by so many before they are taken: an update costs its time."""
_LARGEST_BIAS_RAD_S = 0.4
"""Above the data sheet's ±20 °/s a first sample is a motion, not a bias."""
_BRIDGE_M, _BRIDGE_CUT_M, _BRIDGE_RAD = 0.0015, 0.006, math.radians(0.05)
"""What a bump leaves unsure of position and heading, told whole or cut off."""
_BRIDGE_M_S, _BRIDGE_M_S2 = 0.012, 0.02
"""Of the velocity by inertia: at once, and growing with time."""
_SLIP_SHARE = 0.5
"""Of the way put right when one wheel slips, taken as its sigma."""
_RELEASE_SHARE = 0.3
"""Of the way given back once nothing holds the robot, taken as its sigma: when it was let go is
known to a reading of the bumper."""
_ONSET_S, _KEPT = 1.0, 64
_WARMING_LOWPASS, _WARMING_JUMP_C = 0.02, 2.0
"""Share of the newest sample in the chip's temperature, whose register is noisy, and what no chip
warms up by between samples."""
_SPEED_LOWPASS = 0.5
"""Share of the newest interval in the speed: one count in 20 ms is already 6.5 mm/s."""


class PoseEstimator(PoseFilter):
    """The filter, fed with samples.

    Feed samples in the order of their stamps as far as possible; a stale gyro sample is
    ignored. All times are of one clock, in seconds; only differences matter. The first encoder
    sample is the reference. While no gyro sample comes for 0.1 s, and before the first rest of
    25 gyro samples, the heading is taken from the wheels (eq. 4).
    """

    def __init__(self, model: RobotModel, start: Pose2, drift: DriftModel | None = None) -> None:
        """``start`` is taken as exact: the frame is the one in which it was given."""
        super().__init__(start, drift)
        self._model = model
        self._left_m, self._right_m = model.left_metres_per_count, model.right_metres_per_count
        """What one count of each wheel is worth, before the filter's own scale."""
        self._bias = model.gyro_bias_rad_s
        self._standstill = Standstill()
        self._counts: tuple[int, int] | None = None
        self._encoder_s = 0.0
        self._imu_s: float | None = None
        self._chip_c: float | None = None
        self._rest_samples = 0
        self._rest_sum, self._rest_count = 0.0, 0
        self._rest_mean: float | None = None
        self._resting = True
        self._bumps, self._slips = BumpDetector(), SlipDetector()
        self._bridge: InertialBridge | None = None
        self._slipping = 0
        self._disturbances: list[Disturbance] = []
        self.reset(start)

    # -- what is known ---------------------------------------------------------------------

    def pose_at(self, t_s: float) -> Pose2:
        """Pose carried on at the present speed to a moment near the newest encoder sample."""
        ahead_s = t_s - self._encoder_s
        if self._counts is None or not -IMU_GAP_S <= ahead_s <= IMU_GAP_S:
            return self.pose
        way = self._speed * ahead_s
        turn_s = ahead_s if self._imu_s is None else t_s - self._imu_s
        theta = self._theta + self._yaw_rate * turn_s
        mid = theta - 0.5 * self._yaw_rate * ahead_s
        x, y = self._x + way * math.cos(mid), self._y + way * math.sin(mid)
        return Pose2(x, y, wrap_angle(theta))

    @property
    def v_m_s(self) -> float:
        """Forward speed from the encoders, lightly smoothed."""
        return self._speed

    @property
    def yaw_rate_rad_s(self) -> float:
        """Yaw rate from the gyro less its bias, or from the wheels while the gyro is silent."""
        return self._yaw_rate

    @property
    def known(self) -> bool:
        """False after an encoder gap above 10 s, until :meth:`reset`."""
        return self._known

    @property
    def at_rest(self) -> bool:
        """Whether the last gyro sample was taken as one at rest."""
        return self._resting

    @property
    def disturbances(self) -> tuple[Disturbance, ...]:
        """Slips, bumps and stalls found of late, oldest first."""
        return tuple(self._disturbances)

    @property
    def feels(self) -> bool:
        """Whether an accelerometer is there and calibrated, so that bumps are found."""
        return self._bumps.ready

    @property
    def bridging(self) -> bool:
        """Whether the position is carried by inertia just now, after a bump."""
        return self._bridge is not None

    def reset(self, pose: Pose2) -> None:
        """Set the pose as exact and known; walls are forgotten, what the sensors are is kept."""
        self.restart(pose)
        self._known = True
        self._speed = 0.0
        self._yaw_rate = 0.0
        self._turning_s = 0.0
        self._bridge = None

    def release(self) -> None:
        """Tell that nothing touches the robot: after a bump its wheels can be believed again."""
        bridge = self._bridge
        if bridge is None:
            return
        self.shift(bridge.unmade_m, 0.0)
        self.inflate_along(_RELEASE_SHARE * abs(bridge.unmade_m))
        self._end_bridge(bridge)

    def hold(self) -> None:
        """Tell that something touches the robot: what its wheels turn after a bump is not made."""
        if self._bridge is not None:
            self._bridge.unmade_m = 0.0

    # -- samples ---------------------------------------------------------------------------

    def on_imu(
        self,
        t_s: float,
        gyro_z_rad_s: float,
        accel_x_m_s2: float | None = None,
        accel_y_m_s2: float | None = None,
        temperature_c: float | None = None,
    ) -> None:
        """Take one sample: yaw rate in rad/s, uncorrected, counter-clockwise positive.

        The sample is taken as the mean over the time since the last one, as the chip's low-pass
        makes it. With the acceleration (ahead, to the left, at the axle's centre; gravity's
        share on a slanting floor and the bias are learnt at rest) bumps are found and bridged.
        With the chip's temperature the bias follows as the chip warms up.
        """
        previous_s = self._imu_s
        if previous_s is not None and t_s <= previous_s:
            return
        self._imu_s = t_s
        if temperature_c is not None:
            self._warm_to(temperature_c)
        offset = self._bias + self._motion_bias
        rate = (gyro_z_rad_s - offset) * (1.0 - self._gyro_scale)
        trusted = self._rest_samples >= _FIRST_BIAS_SAMPLES
        still = self._standstill.at_rest(t_s)
        if trusted:
            self._resting = still and abs(gyro_z_rad_s - self._bias) < Standstill.RATE_VETO_RAD_S
        else:
            self._resting = still and abs(gyro_z_rad_s) < _LARGEST_BIAS_RAD_S
        if self._resting:
            self._yaw_rate = 0.0
            self._rest_samples += 1
            self._rest_sum += gyro_z_rad_s
            self._rest_count += 1
            if self._rest_count >= _REST_BATCH:
                self._zero_velocity()
            if accel_x_m_s2 is not None and accel_y_m_s2 is not None:
                self._bumps.rest(accel_x_m_s2, accel_y_m_s2)
            return
        self._bumps.leave_rest()
        # The last of them may be of the start, which the counts show up to 20 ms late.
        self._rest_sum, self._rest_count, self._rest_mean = 0.0, 0, None
        if not trusted:
            # set off before the rest was long enough: its few samples may be of the start
            self._rest_samples = 0
            self._bias = self._model.gyro_bias_rad_s
            self.joint_covariance.forget((BIAS,), (self.drift.bias_prior_rad_s**2,))
            return
        self._yaw_rate = rate
        if previous_s is None or t_s - previous_s > IMU_GAP_S:
            return
        dt = t_s - previous_s
        self._theta += rate * dt
        self._turning_s += dt
        if accel_x_m_s2 is not None and accel_y_m_s2 is not None:
            self._feel(t_s, dt, *self._bumps.level(accel_x_m_s2, accel_y_m_s2))

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
        scale = 1.0 + self._wheel_scale
        self._roll(
            t_s, dt, scale * self._left_m * left_counts, scale * self._right_m * right_counts
        )

    # -- inside ----------------------------------------------------------------------------

    def _warm_to(self, temperature_c: float) -> None:
        before_c = self._chip_c
        if before_c is None or abs(temperature_c - before_c) > _WARMING_JUMP_C:
            self._chip_c = temperature_c  # a device that began anew
            return
        self._chip_c = before_c + _WARMING_LOWPASS * (temperature_c - before_c)
        self.warm(self._chip_c - before_c)

    def _roll(self, t_s: float, dt: float, left: float, right: float) -> None:
        """Move by what both wheels went, metres, in the time since the last sample."""
        travel = 0.5 * (left + right)
        if dt > 0.0:
            self._speed += _SPEED_LOWPASS * (travel / dt - self._speed)
            if left == right == 0.0 and abs(self._speed) < 1e-3:  # noqa: PLR2004 - a millimetre a second
                self._speed = 0.0
        rotation, by_wheels = self._rotation(t_s, dt, (right - left) / self._model.wheel_base_m)
        if self._bridge is not None:
            travel = 0.0
            if self._bridge.over(self._speed, dt):
                travel = self._bridge.given_back_m
                self._end_bridge(self._bridge)
            elif self._bridge.stalled:
                self._note(DisturbanceKind.STALL, t_s, self._speed)
        elif not by_wheels:
            travel = self._gripping(t_s, dt, left, right, rotation)
        if travel or rotation or self._turning_s:
            turning_s, self._turning_s = self._turning_s, 0.0
            chord = travel * sinc(0.5 * rotation)
            self.advance(chord, rotation, max(dt, 0.0), turning_s, by_wheels=by_wheels)
        elif dt > 0.0:
            self.wait(dt)

    def _rotation(self, t_s: float, dt_s: float, wheel_turn: float) -> tuple[float, bool]:
        """Heading change since the last encoder sample, and whether the wheels told it."""
        mark = self._heading_mark
        by_wheels = (
            self._imu_s is None
            or t_s - self._imu_s > IMU_GAP_S
            or self._rest_samples < _FIRST_BIAS_SAMPLES
        )
        if by_wheels:
            now = mark + wheel_turn
            self._theta = now
            self._turning_s = 0.0
            if dt_s > 0.0:
                self._yaw_rate = wheel_turn / dt_s
        else:
            now = self._theta + self._yaw_rate * (t_s - (self._imu_s or t_s))
        self._heading_mark = now
        return now - mark, by_wheels

    def _feel(self, t_s: float, dt: float, ahead: float, aside: float) -> None:
        """Look for a bump; after one, move by inertia and not by the wheels."""
        bridge = self._bridge
        if self._bumps.moving(ahead, aside) and bridge is None:
            size = math.hypot(ahead, aside) * dt
            self._note(DisturbanceKind.BUMP, t_s, size)
            self._bridge = bridge = InertialBridge(self._speed)
            # up to the bump the wheels were right: their last count is up to 20 ms old
            before_s = min(max(t_s - 0.5 * dt - self._encoder_s, 0.0), IMU_GAP_S)
            self.shift(self._speed * before_s, 0.0)
        self.inflate_for_vibration(self._bumps.vibration_m_s2)
        if bridge is None:
            return
        way_ahead, way_aside = bridge.push(ahead, aside, self._yaw_rate, dt)
        self.shift(way_ahead, way_aside)
        # a velocity off by σ makes (σt)² of position's variance in t: 2σ²t·dt from step to step
        sigma = _BRIDGE_M_S + _BRIDGE_M_S2 * bridge.age_s
        self.inflate(sigma * math.sqrt(2.0 * bridge.age_s * dt), 0.0)

    def _end_bridge(self, bridge: InertialBridge) -> None:
        sigma = _BRIDGE_CUT_M if bridge.cut else _BRIDGE_M
        self.inflate(sigma, _BRIDGE_RAD)
        self._bridge = None

    def _gripping(self, t_s: float, dt: float, left: float, right: float, rotation: float) -> float:
        """Way ahead, by the wheel that grips where one slips."""
        turn = rotation * self._model.wheel_base_m
        self.slip_monitor.update(left, right, turn)
        side = self._slips.update(left, right, turn, dt)
        if side == 0:
            self._slipping = 0
            return 0.5 * (left + right)
        if side != self._slipping:
            self._slipping = side
            kind = DisturbanceKind.SLIP_RIGHT if side > 0 else DisturbanceKind.SLIP_LEFT
            self._note(kind, t_s, abs(right - left - turn) / dt)
        way = left + 0.5 * turn if side > 0 else right - 0.5 * turn
        self.inflate_along(_SLIP_SHARE * abs(0.5 * (left + right) - way))
        return way

    def _note(self, kind: DisturbanceKind, t_s: float, size: float) -> None:
        last = self._disturbances[-1] if self._disturbances else None
        if last is None or last.kind is not kind or t_s - last.t_s > _ONSET_S:
            self._disturbances.append(Disturbance(kind, t_s, size))
            del self._disturbances[:-_KEPT]

    def _zero_velocity(self) -> None:
        """At rest the gyro tells its bias, and by it what the heading lost since the last rest."""
        ripe, self._rest_mean = self._rest_mean, self._rest_sum / self._rest_count
        self._rest_sum, self._rest_count = 0.0, 0
        if ripe is None:
            return
        variance = self.drift.gyro_sample_rad_s**2 / _REST_BATCH
        self.update_pending()
        self.apply(self.joint_covariance.update_one(BIAS, ripe - self._bias, variance))
