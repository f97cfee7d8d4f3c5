"""Detection of slip and bumps from differences between encoders, gyro and accelerometer.

- A *bump* is a jerk: within one sample of 10 ms the robot loses speed faster than its motors can
  brake. The wheels still turn, so the encoders measure a path that the robot does not drive. For a
  short time after a bump, the integrated acceleration gives a much better velocity
  (``InertialBridge``), including slip along the wall.
- A *stall* is a bump that does not end: the robot stands while its wheels turn. It is not a stall
  if the robot accelerates with its wheels.
- A *slip* of one wheel causes a difference between encoders and gyro. The encoder of the slipping
  wheel measures too long a path, so only the other wheel is used.

These sensors cannot detect a small slip that is equal for both wheels. Known walls may reveal it
later.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

FULL_SCALE_M_S2 = 19.0
"""Acceleration just below the limit of the ±2 g range, m/s². A larger sample is clipped."""


@dataclass(frozen=True, slots=True)
class DisturbanceTuning:
    """Limits of bumps and slips."""

    bump_m_s2: float = 1.8
    """Minimum acceleration of a bump, m/s²: a contact at 2 cm/s. A normal stop reaches 1 m/s²."""
    bump_sigmas: float = 6.0
    """Minimum acceleration of a bump, in standard deviations of the vibration. The vibration is
    measured during motion."""
    vibration_m_s2: float = 0.15
    """Initial vibration, m/s²."""
    vibration_share: float = 0.01
    """Weight of the newest sample in the vibration for the threshold."""
    lasting_share: float = 0.001
    """Weight of the newest sample in the long-term vibration. It is small, so that a short graze
    has little effect."""
    ringing_samples: int = 15
    """Number of samples after a jerk that are ignored in the vibration."""
    rest_share: float = 0.01
    """Weight of the newest sample in the accelerometer's offset at standstill: 100 samples."""
    held_samples: int = 5
    """Number of newest samples at standstill that are not used yet. The start of a motion may
    affect them."""
    slip_m_s: float = 0.02
    """Minimum difference between gyro and encoders that is slip, m/s at the rim. It is ten times
    the difference on a hard floor at cruise speed."""
    slip_s: float = 0.06
    """Minimum duration of this difference, s."""
    slip_sigma_share: float = 0.5
    """Standard deviation of the correction for a slipping wheel, as a share of the correction."""
    onset_s: float = 1.0
    """Time within which repeated disturbances of one kind count as one disturbance, s."""


@dataclass(frozen=True, slots=True)
class BridgeTuning:
    """Limits of the inertial motion after a bump, and its uncertainty."""

    agree_m_s: float = 0.025
    """Speed difference below which encoders and accelerometer agree after a bump, m/s."""
    agree_s: float = 0.05
    """Time for which encoders and accelerometer must agree, s."""
    away_m_s: float = 0.01
    """Minimum speed of wheels that turn away from the obstacle, m/s. The obstacle does not stop the
    robot then, but the accelerometer cannot distinguish such a slow start from a standstill."""
    stands_m_s: float = 0.012
    """Inertial speed below which the robot counts as standing after a bump, m/s. It allows for the
    integrated error of the offset."""
    stall_s: float = 0.5
    """Minimum time of standstill with turning wheels in a stall, s."""
    gain_m_s: float = 0.05
    """Minimum speed gain of the wheels during a stall for a check, m/s. The accelerometer measures
    the same gain if the robot follows its wheels, and no gain if the robot stands."""
    min_gain_share: float = 0.5
    """Minimum ratio of the measured gain to the wheels' gain for a robot that follows its
    wheels."""
    max_gain_share: float = 2.0
    """Maximum ratio of the measured gain to the wheels' gain for a robot that follows its
    wheels."""
    longest_s: float = 2.0
    """Maximum time of the inertial motion, s. After it, the velocity error due to the offset is too
    large."""
    sigma_m: float = 0.0015
    """Standard deviation of the position after a bump with valid acceleration samples, m."""
    clipped_sigma_m: float = 0.006
    """Standard deviation of the position after a bump with clipped acceleration samples, m."""
    sigma_rad: float = math.radians(0.05)
    """Standard deviation of the heading that a bump adds, rad."""
    sigma_m_s: float = 0.012
    """Initial standard deviation of the inertial velocity, m/s."""
    sigma_m_s2: float = 0.02
    """Increase of the inertial velocity's standard deviation per time, m/s²."""
    release_share: float = 0.3
    """Standard deviation of the path that is added again after a release, as a share of that path.
    The time of the release has an uncertainty of one bumper reading."""


class DisturbanceKind(enum.StrEnum):
    """Kinds of disturbances."""

    BUMP = "bump"
    STALL = "stall"
    SLIP_LEFT = "slip_left"
    SLIP_RIGHT = "slip_right"


class Disturbance(NamedTuple):
    """The beginning of a disturbance."""

    kind: DisturbanceKind
    t_s: float
    size: float
    """Speed, m/s. Bump: change within one sample. Stall: speed of the wheels. Slip: difference
    between wheels and gyro."""


class BumpDetector:
    """Detects bumps with the accelerometer alone."""

    __slots__ = (
        "_held",
        "_last_x",
        "_last_y",
        "_lasting",
        "_offset_x",
        "_offset_y",
        "_rests",
        "_ringing",
        "_tuning",
        "_variance",
    )

    def __init__(self, tuning: DisturbanceTuning | None = None) -> None:
        """Begin without an offset."""
        self._tuning = tuning or DisturbanceTuning()
        self._offset_x = self._offset_y = 0.0
        self._last_x = self._last_y = 0.0
        self._rests = self._ringing = 0
        self._held: list[tuple[float, float]] = []
        self._variance = self._lasting = self._tuning.vibration_m_s2**2

    @property
    def ready(self) -> bool:
        """True after a standstill has measured the offset: bias, and gravity on a sloping floor."""
        return self._rests > 0

    @property
    def threshold_m_s2(self) -> float:
        """Present minimum acceleration of a bump, m/s²."""
        tuning = self._tuning
        return max(tuning.bump_m_s2, tuning.bump_sigmas * math.sqrt(self._variance))

    @property
    def vibration_m_s2(self) -> float:
        """Standard deviation of the vibration per axis, over ten seconds of driving, m/s²."""
        return math.sqrt(self._lasting)

    def rest(self, accel_x: float, accel_y: float) -> None:
        """Process a sample at standstill, m/s²."""
        self._held.append((accel_x, accel_y))
        if len(self._held) <= self._tuning.held_samples:
            return
        ripe_x, ripe_y = self._held.pop(0)
        self._rests += 1
        share = max(1.0 / self._rests, self._tuning.rest_share)
        self._offset_x += share * (ripe_x - self._offset_x)
        self._offset_y += share * (ripe_y - self._offset_y)

    def leave_rest(self) -> None:
        """Discard the newest samples at standstill. The start of the motion may affect them."""
        self._held.clear()

    def level(self, accel_x: float, accel_y: float) -> tuple[float, float]:
        """Return the sample minus the offset, m/s²."""
        return accel_x - self._offset_x, accel_y - self._offset_y

    def moving(self, ahead: float, aside: float) -> bool:
        """Process a sample in motion minus the offset, m/s². Return True if it is a bump."""
        if not self.ready:
            return False
        # The jerk is the difference of two samples. The robot's own slow accelerations cancel in
        # it.
        by_x, by_y = ahead - self._last_x, aside - self._last_y
        self._last_x, self._last_y = ahead, aside
        if math.hypot(ahead, aside) > self.threshold_m_s2:
            self._ringing = self._tuning.ringing_samples
            return True
        if self._ringing:
            # the end of the jerk and the ringing after it are not vibration of the drive
            self._ringing -= 1
            return False
        power = 0.25 * (by_x * by_x + by_y * by_y)
        self._variance += self._tuning.vibration_share * (power - self._variance)
        self._lasting += self._tuning.lasting_share * (power - self._lasting)
        return False


class SlipDetector:
    """Detects the slip of one wheel by encoders and gyro."""

    __slots__ = ("_lasting_s", "_side", "_tuning")

    def __init__(self, tuning: DisturbanceTuning | None = None) -> None:
        """Begin without slip."""
        self._tuning = tuning or DisturbanceTuning()
        self._lasting_s = 0.0
        self._side = 0

    def update(self, left_m: float, right_m: float, turn_m: float, dt_s: float) -> int:
        """Return the slipping wheel: -1: left, +1: right, 0: none.

        Args:
            left_m: Path of the left wheel from its encoder, m.
            right_m: Path of the right wheel from its encoder, m.
            turn_m: Rotation from the gyro, times the wheel base, m.
            dt_s: Duration of these motions, s.

        """
        if dt_s <= 0.0:
            return 0
        excess = right_m - left_m - turn_m
        if abs(excess) < self._tuning.slip_m_s * dt_s:
            self._lasting_s = 0.0
            self._side = 0
            return 0
        # Find the wheel whose count is too high in its direction of rotation.
        right_over = excess * right_m > 0.0
        left_over = -excess * left_m > 0.0
        if right_over and left_over:
            side = 1 if abs(right_m) > abs(left_m) else -1
        else:
            side = 1 if right_over else -1
        if side != self._side:
            self._lasting_s = 0.0
            self._side = side
        self._lasting_s += dt_s
        return side if self._lasting_s >= self._tuning.slip_s else 0


class InertialBridge:
    """Inertial velocity after a bump. It is used until wheels and accelerometer agree again."""

    __slots__ = (
        "_agreed_s",
        "_away_m",
        "_away_s",
        "_gain_m_s",
        "_into",
        "_tuning",
        "_wheels_m_s",
        "_withheld_m",
        "age_s",
        "clipped",
        "restored_m",
        "stalled",
        "unconfirmed_m",
        "vx_m_s",
        "vy_m_s",
    )

    def __init__(self, v_m_s: float, tuning: BridgeTuning | None = None) -> None:
        """Begin with the forward speed before the bump, m/s."""
        self._tuning = tuning or BridgeTuning()
        self.vx_m_s, self.vy_m_s = v_m_s, 0.0
        self.age_s = 0.0
        self.clipped = False
        """True if a sample was clipped. The bump was then harder than measured."""
        self.stalled = False
        self.restored_m = 0.0
        """Wheel path that was not added during a stall although the robot drove it, m."""
        self.unconfirmed_m = 0.0
        """Wheel path since the last contact that the accelerometer does not confirm, m."""
        self._agreed_s = self._away_s = self._away_m = 0.0
        moves = abs(v_m_s) > self._tuning.away_m_s
        self._into = math.copysign(1.0, v_m_s) if moves else 0.0
        self._wheels_m_s = self._gain_m_s = self._withheld_m = 0.0
        """Values of a stall: wheel speed at its beginning, inertial speed gain since, wheel path
        since."""

    def push(self, ahead: float, aside: float, yaw_rate: float, dt_s: float) -> tuple[float, float]:
        """Process a sample minus the offset. Return the path ahead and to the left, m."""
        self.age_s += dt_s
        self.clipped = self.clipped or abs(ahead) > FULL_SCALE_M_S2 or abs(aside) > FULL_SCALE_M_S2
        before_x, before_y = self.vx_m_s, self.vy_m_s
        # In the rotating body frame: v' = a - ω × v
        self.vx_m_s += (ahead + yaw_rate * before_y) * dt_s
        self.vy_m_s += (aside - yaw_rate * before_x) * dt_s
        if self.clipped and self.vx_m_s * before_x < before_x * before_x:
            # the bump was harder than the sensor can measure: the remaining forward speed may be
            # wrong
            self.vx_m_s *= 0.5
        if self.stalled:
            self._gain_m_s += ahead * dt_s
        if self.stalled or math.hypot(self.vx_m_s, self.vy_m_s) < self._tuning.stands_m_s:
            self.vx_m_s = self.vy_m_s = 0.0
        self.unconfirmed_m -= self.vx_m_s * dt_s
        return self.vx_m_s * dt_s, self.vy_m_s * dt_s

    def has_ended(self, v_m_s: float, dt_s: float) -> bool:
        """Use the wheels' speed, m/s. Return True if it agrees with the inertial speed again."""
        tuning = self._tuning
        self.unconfirmed_m += v_m_s * dt_s
        if self.stalled:
            self._withheld_m += v_m_s * dt_s
            gain = v_m_s - self._wheels_m_s
            if (
                abs(gain) > tuning.gain_m_s
                and tuning.min_gain_share < self._gain_m_s / gain < tuning.max_gain_share
            ):
                self.restored_m = self._withheld_m
                return True
        away = v_m_s * self._into < -tuning.away_m_s
        self._away_s = self._away_s + dt_s if away else 0.0
        self._away_m = self._away_m + v_m_s * dt_s if away else 0.0
        stands = math.hypot(self.vx_m_s, self.vy_m_s) < 2.0 * tuning.agree_m_s
        if self._away_s >= tuning.agree_s and stands:
            self.restored_m = self._away_m
            return True
        agrees = math.hypot(self.vx_m_s - v_m_s, self.vy_m_s) < tuning.agree_m_s
        self._agreed_s = self._agreed_s + dt_s if agrees else 0.0
        if not agrees and not self.stalled and self.age_s > tuning.stall_s:
            self.stalled = stands
            if not self.stalled:
                return True
            self._wheels_m_s = v_m_s
        return self._agreed_s >= tuning.agree_s or self.age_s > tuning.longest_s
