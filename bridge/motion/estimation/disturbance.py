"""Detection of slip and bumps by the disagreement of encoders, gyro and accelerometer.

- A *bump* is a jerk: within one sample of 10 ms the robot loses speed faster than its motors could
  brake. The wheels still turn, so the encoders measure a path that the robot did not drive. For a
  short time after a bump, the integrated accelerometer measures the velocity much better
  (``InertialBridge``), including slip along the wall.
- A *stall* is a bump that does not end: the robot stands while its wheels turn. If the robot gains
  speed with its wheels, it is not a stall.
- A *slip* of one wheel shows as a difference between encoders and gyro. The slipping wheel measures
  too long a path, so the other wheel is used.

These sensors cannot detect a gentle, equal slip of both wheels. Known walls can show it later.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

BUMP_M_S2 = 1.8
"""Minimum jerk of a bump, m/s²: a contact at 2 cm/s. A normal stop reaches 1 m/s²."""
BUMP_SIGMAS = 6.0
"""Minimum jerk in standard deviations of the vibration, which is learned in motion."""
_VIBRATION_M_S2 = 0.15
"""Initial vibration, m/s²."""
_VIBRATION_SHARE = 0.01
"""Share of the newest sample in the vibration of the threshold."""
_LASTING_SHARE = 0.001
"""Share of the newest sample in the lasting vibration, so that a short graze does not count."""
_RINGS = 15
"""Number of samples after a jerk that do not count for the vibration."""
_REST_SHARE = 0.01
"""Share of the newest sample in the accelerometer's offset at rest: 100 samples."""
_HELD = 5
"""Number of newest samples at rest that are held back, because the start may affect them."""
AGREE_M_S = 0.025
"""Difference of speed below which encoders and accelerometer agree again, m/s."""
AGREE_S = 0.05
"""Time for which they must agree, s."""
AWAY_M_S = 0.01
"""Minimum speed of wheels that turn away from the obstacle, m/s. Nothing holds the robot then, but
such a gentle start looks like a standstill."""
STANDS_M_S = 0.012
"""Inertial speed below which the robot stands after a bump, m/s. It covers the integrated error of
the offset."""
STALL_S = 0.5
"""Minimum time of standstill with turning wheels in a stall, s."""
GAIN_M_S = 0.05
"""Gain of the wheels' speed during a stall that allows a check, m/s. The accelerometer measures the
same gain if the robot follows its wheels, and no gain if it stands."""
_MIN_SHARE, _MAX_SHARE = 0.5, 2.0
"""Limits of the measured share of that gain at which the robot follows."""
LONGEST_S = 2.0
"""Maximum time of inertial motion, s. Later the offset's error dominates the velocity."""
SLIP_M_S = 0.02
"""Difference between gyro and encoders that is slip, m/s at the rim: ten times that of a hard
floor at cruise speed."""
SLIP_S = 0.06
"""Minimum time of the difference, s."""
FULL_SCALE_M_S2 = 19.0
"""Acceleration just below the ±2 g range, m/s². A larger sample is clipped."""


class DisturbanceKind(enum.StrEnum):
    """Kinds of disturbances."""

    BUMP = "bump"
    STALL = "stall"
    SLIP_LEFT = "slip_left"
    SLIP_RIGHT = "slip_right"


class Disturbance(NamedTuple):
    """The onset of a disturbance."""

    kind: DisturbanceKind
    t_s: float
    size: float
    """Speed, m/s: change within one sample (bump), speed of the wheels (stall), or difference
    between wheels and gyro (slip)."""


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
        """True once a standstill has measured the offset: bias, and gravity on a sloping floor."""
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
        """Take a sample at rest, m/s²."""
        self._held.append((accel_x, accel_y))
        if len(self._held) <= _HELD:
            return
        ripe_x, ripe_y = self._held.pop(0)
        self._rests += 1
        share = max(1.0 / self._rests, _REST_SHARE)
        self._offset_x += share * (ripe_x - self._offset_x)
        self._offset_y += share * (ripe_y - self._offset_y)

    def leave_rest(self) -> None:
        """Discard the newest samples, which the start may affect."""
        self._held.clear()

    def level(self, accel_x: float, accel_y: float) -> tuple[float, float]:
        """Return the sample minus the offset, m/s²."""
        return accel_x - self._offset_x, accel_y - self._offset_y

    def moving(self, ahead: float, aside: float) -> bool:
        """Use a sample in motion, minus the offset, m/s². Return True if it is a bump."""
        if not self.ready:
            return False
        # The jerk is the difference of two samples: the robot's own slow accelerations cancel.
        by_x, by_y = ahead - self._last_x, aside - self._last_y
        self._last_x, self._last_y = ahead, aside
        if math.hypot(ahead, aside) > self.threshold_m_s2:
            self._ringing = _RINGS
            return True
        if self._ringing:
            # the other flank of the jerk and its ringing are no vibration of the drive
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
        """Return the slipping wheel: -1 left, +1 right, 0 none.

        Args:
            left_m: Path of the left wheel by its encoder, m.
            right_m: Path of the right wheel by its encoder, m.
            turn_m: Rotation by the gyro, times the wheel base, m.
            dt_s: Duration of these motions, s.

        """
        if dt_s <= 0.0:
            return 0
        excess = right_m - left_m - turn_m
        if abs(excess) < SLIP_M_S * dt_s:
            self._lasting_s = 0.0
            self._side = 0
            return 0
        # The wheel whose count is too high in its direction of rotation.
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
    """Inertial velocity after a bump, until wheels and accelerometer agree again."""

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
        """Whether a sample was clipped, so that the bump was harder than measured."""
        self.stalled = False
        self.given_back_m = 0.0
        """Path by the wheels that was withheld, and was driven, m."""
        self.unmade_m = 0.0
        """Path by the wheels that the accelerometer does not confirm, since the last contact, m."""
        self._agreed_s = self._away_s = self._away_m = 0.0
        self._into = math.copysign(1.0, v_m_s) if abs(v_m_s) > AWAY_M_S else 0.0
        self._wheels_m_s = self._gain_m_s = self._withheld_m = 0.0
        """Wheel speed at the stall's beginning, inertial gain and wheel path since."""

    def push(self, ahead: float, aside: float, yaw_rate: float, dt_s: float) -> tuple[float, float]:
        """Take a levelled sample and return the path ahead and aside, m."""
        self.age_s += dt_s
        self.cut = self.cut or abs(ahead) > FULL_SCALE_M_S2 or abs(aside) > FULL_SCALE_M_S2
        before_x, before_y = self.vx_m_s, self.vy_m_s
        # In the turning frame of the body: v' = a - ω × v
        self.vx_m_s += (ahead + yaw_rate * before_y) * dt_s
        self.vy_m_s += (aside - yaw_rate * before_x) * dt_s
        if self.cut and self.vx_m_s * before_x < before_x * before_x:
            # harder than measurable: the remaining forward speed may not be real
            self.vx_m_s *= 0.5
        if self.stalled:
            self._gain_m_s += ahead * dt_s
        if self.stalled or math.hypot(self.vx_m_s, self.vy_m_s) < STANDS_M_S:
            self.vx_m_s = self.vy_m_s = 0.0
        self.unmade_m -= self.vx_m_s * dt_s
        return self.vx_m_s * dt_s, self.vy_m_s * dt_s

    def over(self, v_m_s: float, dt_s: float) -> bool:
        """Take the wheels' speed, m/s; whether it agrees with the inertial speed again."""
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
