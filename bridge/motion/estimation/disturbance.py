"""Slip and collision, told by what encoders, gyro and accelerometer disagree about.

- A *bump* is a jerk: within one sample of 10 ms the body loses speed that no motor can take
  from it. The wheels meanwhile go on turning, so that the encoders tell a way that was not
  made. For the moments after it the accelerometer, integrated, tells the body's velocity far
  better (``InertialBridge``), sliding along the wall included.
- A *stall* is a bump whose end does not come: the body stands, the wheels turn on. A body that
  gains speed as the wheels do does not stand.
- A *slip* of one wheel shows between encoders and gyro: a wheel that loses its grip counts
  more than the floor went by, so that the other one is believed.

Both wheels slipping alike and gently cannot be told by these sensors; walls seen again can.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

BUMP_M_S2 = 1.8
"""Least jerk that counts: a touch at 2 cm/s. The robot itself brings at most 1 m/s², in a halt."""
BUMP_SIGMAS = 6.0
"""And this many times the vibration, whose strength is learnt while driving."""
_VIBRATION_M_S2 = 0.15
"""What is believed of it at first."""
_VIBRATION_SHARE = 0.01
_LASTING_SHARE = 0.001
"""A wall that is rubbed against for a second says nothing of the floor."""
_RINGS = 15
"""Samples after a jerk that tell nothing of the vibration."""
_REST_SHARE = 0.01
"""Time constant of the accelerometer's offset at rest: 100 samples."""
_HELD = 5
AGREE_M_S = 0.025
"""Encoders and inertia agree again below this."""
AGREE_S = 0.05
AWAY_M_S = 0.01
"""Wheels that turn back faster take the body from what it met: nothing holds it there, and so
gentle a start is lost in what is taken for standing."""
STANDS_M_S = 0.012
"""Slower than this after a bump, the body is taken to stand: else the offset's rest adds up."""
STALL_S = 0.5
GAIN_M_S = 0.05
"""Wheels that gain so much speed in a stall show whether the body follows: inertia tells as much
(within the shares below), or nothing."""
_MIN_SHARE, _MAX_SHARE = 0.5, 2.0
LONGEST_S = 2.0
"""After this the accelerometer's offset has grown into the velocity: give up."""
SLIP_M_S = 0.02
"""Rim speed between the wheels that gyro and encoders differ by: a wheel slips. Ten times the
slip of a hard floor at cruise speed."""
SLIP_S = 0.06
FULL_SCALE_M_S2 = 19.0
"""Just below the ±2 g range: a sample beyond it is cut off."""


class DisturbanceKind(enum.StrEnum):
    """What happened."""

    BUMP = "bump"
    STALL = "stall"
    SLIP_LEFT = "slip_left"
    SLIP_RIGHT = "slip_right"


class Disturbance(NamedTuple):
    """One onset."""

    kind: DisturbanceKind
    t_s: float
    size: float
    """Speed, m/s: of a bump what was lost or gained in one sample, of a stall that of the wheels,
    of a slip the difference between wheels and gyro."""


class BumpDetector:
    """Jerks, by the accelerometer alone."""

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
        """Nothing is known of offset and vibration."""
        self._offset_x = self._offset_y = 0.0
        self._last_x = self._last_y = 0.0
        self._rests = self._ringing = 0
        self._held: list[tuple[float, float]] = []
        self._variance = self._lasting = _VIBRATION_M_S2**2

    @property
    def ready(self) -> bool:
        """Whether a rest has told the offset: bias, and gravity on a floor that slants."""
        return self._rests > 0

    @property
    def threshold_m_s2(self) -> float:
        """What counts as a jerk at present."""
        return max(BUMP_M_S2, BUMP_SIGMAS * math.sqrt(self._variance))

    @property
    def vibration_m_s2(self) -> float:
        """Strength of the vibration in motion, per axis, over some ten seconds of driving."""
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
        """Drop the newest samples: they may be of the start, which wheels show a little late."""
        self._held.clear()

    def level(self, accel_x: float, accel_y: float) -> tuple[float, float]:
        """The sample less the offset."""
        return accel_x - self._offset_x, accel_y - self._offset_y

    def moving(self, ahead: float, aside: float) -> bool:
        """Take a levelled sample in motion; True: a jerk."""
        if not self.ready:
            return False
        # From sample to sample: the robot's own accelerations are slow and cancel.
        by_x, by_y = ahead - self._last_x, aside - self._last_y
        self._last_x, self._last_y = ahead, aside
        if math.hypot(ahead, aside) > self.threshold_m_s2:
            self._ringing = _RINGS
            return True
        if self._ringing:
            # the jerk's other flank, and what it stirred up: no vibration of the drive
            self._ringing -= 1
            return False
        power = 0.25 * (by_x * by_x + by_y * by_y)
        self._variance += _VIBRATION_SHARE * (power - self._variance)
        self._lasting += _LASTING_SHARE * (power - self._lasting)
        return False


class SlipDetector:
    """One wheel's slip, by encoders against gyro."""

    __slots__ = ("_lasting_s", "_side")

    def __init__(self) -> None:
        """No slip."""
        self._lasting_s = 0.0
        self._side = 0

    def update(self, left_m: float, right_m: float, turn_m: float, dt_s: float) -> int:
        """Which wheel slips now: -1 left, +1 right, 0 none.

        Args:
            left_m: way that the left encoder tells, so ``right_m``.
            right_m: see ``left_m``.
            turn_m: the rotation that the gyro tells, times the wheel base.
            dt_s: over which all that was.

        """
        if dt_s <= 0.0:
            return 0
        excess = right_m - left_m - turn_m
        if abs(excess) < SLIP_M_S * dt_s:
            self._lasting_s = 0.0
            self._side = 0
            return 0
        # The wheel whose count is too far in the direction in which it turns.
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
    """The body's velocity after a bump, by inertia, until the wheels can be believed again."""

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
        """``v_m_s``: forward speed before the bump."""
        self.vx_m_s, self.vy_m_s = v_m_s, 0.0
        self.age_s = 0.0
        self.cut = False
        """Whether a sample was beyond the accelerometer's range: the bump was harder than told."""
        self.stalled = False
        self.given_back_m = 0.0
        """Way by the wheels that was taken for none, and was made."""
        self.unmade_m = 0.0
        """Way that the wheels tell and inertia does not, since something last held the body."""
        self._agreed_s = self._away_s = self._away_m = 0.0
        self._into = math.copysign(1.0, v_m_s) if abs(v_m_s) > AWAY_M_S else 0.0
        self._wheels_m_s = self._gain_m_s = self._withheld_m = 0.0
        """Speed of the wheels as the stall began, what inertia gained since, and their way."""

    def push(self, ahead: float, aside: float, yaw_rate: float, dt_s: float) -> tuple[float, float]:
        """Take a levelled sample; way made ahead and aside meanwhile."""
        self.age_s += dt_s
        self.cut = self.cut or abs(ahead) > FULL_SCALE_M_S2 or abs(aside) > FULL_SCALE_M_S2
        before_x, before_y = self.vx_m_s, self.vy_m_s
        # In the turning frame of the body: v' = a - ω × v
        self.vx_m_s += (ahead + yaw_rate * before_y) * dt_s
        self.vy_m_s += (aside - yaw_rate * before_x) * dt_s
        if self.cut and self.vx_m_s * before_x < before_x * before_x:
            # harder than could be told: what is left of the way ahead is not known to be real
            self.vx_m_s *= 0.5
        if self.stalled:
            self._gain_m_s += ahead * dt_s
        if self.stalled or math.hypot(self.vx_m_s, self.vy_m_s) < STANDS_M_S:
            self.vx_m_s = self.vy_m_s = 0.0
        self.unmade_m -= self.vx_m_s * dt_s
        return self.vx_m_s * dt_s, self.vy_m_s * dt_s

    def over(self, v_m_s: float, dt_s: float) -> bool:
        """Whether the wheels, at this speed, tell the same again."""
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
