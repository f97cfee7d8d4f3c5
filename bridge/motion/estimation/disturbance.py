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
from typing import NamedTuple

BUMP_M_S2 = 1.8
"""Minimum jerk of a bump, m/s²: a contact at 2 cm/s. A normal stop reaches 1 m/s²."""
BUMP_SIGMAS = 6.0
"""Minimum jerk of a bump, in standard deviations of the vibration. The vibration is measured during
motion."""
_VIBRATION_M_S2 = 0.15
"""Initial vibration, m/s²."""
_VIBRATION_SHARE = 0.01
"""Weight of the newest sample in the vibration for the threshold."""
_LASTING_SHARE = 0.001
"""Weight of the newest sample in the long-term vibration. It is small, so that a short graze has
little effect."""
_RINGS = 15
"""Number of samples after a jerk that are ignored in the vibration."""
_REST_SHARE = 0.01
"""Weight of the newest sample in the accelerometer's offset at standstill: 100 samples."""
_HELD = 5
"""Number of newest samples at standstill that are not used yet. The start of a motion may affect
them."""
AGREE_M_S = 0.025
"""Speed difference below which encoders and accelerometer agree after a bump, m/s."""
AGREE_S = 0.05
"""Time for which encoders and accelerometer must agree, s."""
AWAY_M_S = 0.01
"""Minimum speed of wheels that turn away from the obstacle, m/s. The obstacle does not stop the
robot then, but the accelerometer cannot distinguish such a slow start from a standstill."""
STANDS_M_S = 0.012
"""Inertial speed below which the robot counts as standing after a bump, m/s. It allows for the
integrated error of the offset."""
STALL_S = 0.5
"""Minimum time of standstill with turning wheels in a stall, s."""
GAIN_M_S = 0.05
"""Minimum speed gain of the wheels during a stall for a check, m/s. The accelerometer measures the
same gain if the robot follows its wheels, and no gain if the robot stands."""
_MIN_SHARE, _MAX_SHARE = 0.5, 2.0
"""Limits of the ratio of the measured gain to the wheels' gain for a robot that follows its
wheels."""
LONGEST_S = 2.0
"""Maximum time of the inertial motion, s. After it, the velocity error due to the offset is too
large."""
SLIP_M_S = 0.02
"""Minimum difference between gyro and encoders that is slip, m/s at the rim. It is ten times the
difference on a hard floor at cruise speed."""
SLIP_S = 0.06
"""Minimum duration of this difference, s."""
FULL_SCALE_M_S2 = 19.0
"""Acceleration just below the limit of the ±2 g range, m/s². A larger sample is clipped."""


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
        "_variance",
    )

    def __init__(self) -> None:
        """Begin without an offset."""
        self._offset_x = self._offset_y = 0.0
        self._last_x = self._last_y = 0.0
        self._rests = self._ringing = 0
        self._held: list[tuple[float, float]] = []
        self._variance = self._lasting = _VIBRATION_M_S2**2

    @property
    def ready(self) -> bool:
        """True after a standstill has measured the offset: bias, and gravity on a sloping floor."""
        return self._rests > 0

    @property
    def threshold_m_s2(self) -> float:
        """Present minimum jerk of a bump, m/s²."""
        return max(BUMP_M_S2, BUMP_SIGMAS * math.sqrt(self._variance))

    @property
    def vibration_m_s2(self) -> float:
        """Standard deviation of the vibration per axis, over ten seconds of driving, m/s²."""
        return math.sqrt(self._lasting)

    def rest(self, accel_x: float, accel_y: float) -> None:
        """Process a sample at standstill, m/s²."""
        self._held.append((accel_x, accel_y))
        if len(self._held) <= _HELD:
            return
        ripe_x, ripe_y = self._held.pop(0)
        self._rests += 1
        share = max(1.0 / self._rests, _REST_SHARE)
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
            self._ringing = _RINGS
            return True
        if self._ringing:
            # the end of the jerk and the ringing after it are not vibration of the drive
            self._ringing -= 1
            return False
        power = 0.25 * (by_x * by_x + by_y * by_y)
        self._variance += _VIBRATION_SHARE * (power - self._variance)
        self._lasting += _LASTING_SHARE * (power - self._lasting)
        return False


class SlipDetector:
    """Detects the slip of one wheel by encoders and gyro."""

    __slots__ = ("_lasting_s", "_side")

    def __init__(self) -> None:
        """Begin without slip."""
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
        if abs(excess) < SLIP_M_S * dt_s:
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
        return side if self._lasting_s >= SLIP_S else 0


class InertialBridge:
    """Inertial velocity after a bump. It is used until wheels and accelerometer agree again."""

    __slots__ = (
        "_agreed_s",
        "_away_m",
        "_away_s",
        "_gain_m_s",
        "_into",
        "_wheels_m_s",
        "_withheld_m",
        "age_s",
        "cut",
        "given_back_m",
        "stalled",
        "unmade_m",
        "vx_m_s",
        "vy_m_s",
    )

    def __init__(self, v_m_s: float) -> None:
        """Begin with the forward speed before the bump, m/s."""
        self.vx_m_s, self.vy_m_s = v_m_s, 0.0
        self.age_s = 0.0
        self.cut = False
        """True if a sample was clipped. The bump was then harder than measured."""
        self.stalled = False
        self.given_back_m = 0.0
        """Wheel path that was not added during a stall although the robot drove it, m."""
        self.unmade_m = 0.0
        """Wheel path since the last contact that the accelerometer does not confirm, m."""
        self._agreed_s = self._away_s = self._away_m = 0.0
        self._into = math.copysign(1.0, v_m_s) if abs(v_m_s) > AWAY_M_S else 0.0
        self._wheels_m_s = self._gain_m_s = self._withheld_m = 0.0
        """Values of a stall: wheel speed at its beginning, inertial speed gain since, wheel path
        since."""

    def push(self, ahead: float, aside: float, yaw_rate: float, dt_s: float) -> tuple[float, float]:
        """Process a sample minus the offset. Return the path ahead and to the left, m."""
        self.age_s += dt_s
        self.cut = self.cut or abs(ahead) > FULL_SCALE_M_S2 or abs(aside) > FULL_SCALE_M_S2
        before_x, before_y = self.vx_m_s, self.vy_m_s
        # In the rotating body frame: v' = a - ω × v
        self.vx_m_s += (ahead + yaw_rate * before_y) * dt_s
        self.vy_m_s += (aside - yaw_rate * before_x) * dt_s
        if self.cut and self.vx_m_s * before_x < before_x * before_x:
            # the bump was harder than the sensor can measure: the remaining forward speed may be
            # wrong
            self.vx_m_s *= 0.5
        if self.stalled:
            self._gain_m_s += ahead * dt_s
        if self.stalled or math.hypot(self.vx_m_s, self.vy_m_s) < STANDS_M_S:
            self.vx_m_s = self.vy_m_s = 0.0
        self.unmade_m -= self.vx_m_s * dt_s
        return self.vx_m_s * dt_s, self.vy_m_s * dt_s

    def over(self, v_m_s: float, dt_s: float) -> bool:
        """Use the wheels' speed, m/s. Return True if it agrees with the inertial speed again."""
        self.unmade_m += v_m_s * dt_s
        if self.stalled:
            self._withheld_m += v_m_s * dt_s
            gain = v_m_s - self._wheels_m_s
            if abs(gain) > GAIN_M_S and _MIN_SHARE < self._gain_m_s / gain < _MAX_SHARE:
                self.given_back_m = self._withheld_m
                return True
        away = v_m_s * self._into < -AWAY_M_S
        self._away_s = self._away_s + dt_s if away else 0.0
        self._away_m = self._away_m + v_m_s * dt_s if away else 0.0
        if self._away_s >= AGREE_S and math.hypot(self.vx_m_s, self.vy_m_s) < 2.0 * AGREE_M_S:
            self.given_back_m = self._away_m
            return True
        agrees = math.hypot(self.vx_m_s - v_m_s, self.vy_m_s) < AGREE_M_S
        self._agreed_s = self._agreed_s + dt_s if agrees else 0.0
        if not agrees and not self.stalled and self.age_s > STALL_S:
            self.stalled = math.hypot(self.vx_m_s, self.vy_m_s) < 2.0 * AGREE_M_S
            if not self.stalled:
                return True
            self._wheels_m_s = v_m_s
        return self._agreed_s >= AGREE_S or self.age_s > LONGEST_S
