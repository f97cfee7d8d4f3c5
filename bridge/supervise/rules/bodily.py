"""Conditions on the robot's body: tilt, lifting, bumps and cliffs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from protocol.imu import GRAVITY_M_S2
from protocol.messages.values import Contact, Fault

if TYPE_CHECKING:
    from bridge.supervise.inputs import RuleInputs, Scalar
    from bridge.supervise.measured import Measured
    from bridge.supervise.rules.conditions import Evidence
    from bridge.supervise.settings import BumpRule, CliffRule, TiltRule
    from protocol.messages.device import Imu

_BUMPERS = int(Contact.BUMPER_LEFT | Contact.BUMPER_RIGHT)
_CLIFF = int(Contact.CLIFF)
_LIFTED = int(Fault.LIFTED)
TILT_SMOOTH_S = 0.2
"""Time constant of the accelerometer's smoothing, s. It is longer than a bump and shorter than a
tilt."""
JOLT_M_S2 = 1.5
"""Vertical acceleration without gravity above which it counts as a jolt, m/s²."""
JOLT_SMOOTH_S = 0.08
"""Time constant of the smoothing of this acceleration, s. A person's lifting takes 0.2 s. A third
of a vibration remains."""
GRAVITY_SMOOTH_S = 2.0
"""Time constant of the estimate of gravity, s. The estimate includes the sensor's bias (up to 0.5
m/s²), so that subtracting it removes the bias."""
JOLT_S = 1.0
"""Maximum time from a jolt to a cliff detection that counts as lifting, s."""
FOLLOWS_M, FOLLOWS_M_S = (0.004, 0.03), 0.06
"""Range of distance, m, and maximum mean speed, m/s, between two contacts that count as one
contact. While the robot follows a wall, the switch closes three times per second. Before a real
bump, the robot drives a longer distance or reverses."""


class Tilt:
    """The measured direction of gravity differs from the robot's vertical axis."""

    grave = False

    def __init__(self, rule: TiltRule) -> None:
        """Set the limit."""
        self._min_cos = math.cos(math.radians(rule.angle_deg))
        self.restart()

    def restart(self) -> None:
        """Discard the smoothed acceleration."""
        self._imu: Imu | None = None
        self._mean: tuple[float, float, float] | None = None
        self._cos = 1.0

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Smooth the acceleration and compare its direction with the vertical axis."""
        imu = inputs.imu
        if imu is None or imu is self._imu:
            return self._cos < self._min_cos
        self._imu = imu
        now = (float(imu.accel_x), float(imu.accel_y), float(imu.accel_z))
        mean = now if self._mean is None else self._mean
        share = min(measured.step_s / TILT_SMOOTH_S, 1.0)
        x, y, z = (m + share * (n - m) for m, n in zip(mean, now, strict=True))
        self._mean = (x, y, z)
        norm = math.sqrt(x * x + y * y + z * z)
        self._cos = z / norm if norm > 0.0 else 1.0
        return self._cos < self._min_cos

    def evidence(self) -> Evidence:
        """Return the tilt angle."""
        angle_deg = math.degrees(math.acos(self._cos))
        return f"the robot tilts by {angle_deg:.0f}°", {"angle_deg": round(angle_deg, 1)}


class Lifted:
    """The device reports that it is lifted, or the floor disappeared after a jolt."""

    grave = False

    def __init__(self) -> None:
        """Start on the floor."""
        self.restart()

    def restart(self) -> None:
        """Reset to the floor."""
        self._jolt_s = -math.inf
        self._up = False
        self._imu: Imu | None = None
        self._now_m_s2 = self._gravity_m_s2 = GRAVITY_M_S2

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Check the fault bit, and the cliff sensor after jolts."""
        imu, reading, status = inputs.imu, inputs.range, inputs.status
        if imu is not None and imu is not self._imu:
            self._imu = imu
            self._feel(imu.accel_z_m_s2, measured.step_s)
            if abs(self._now_m_s2 - self._gravity_m_s2) > JOLT_M_S2:
                self._jolt_s = inputs.time_s
        if reading is None or not reading.contacts & _CLIFF:
            self._up = False
        elif inputs.time_s - self._jolt_s < JOLT_S:
            self._up = True
        self._reported = status is not None and status.faults & _LIFTED != 0
        return self._reported or self._up

    def _feel(self, up_m_s2: float, step_s: float) -> None:
        """Smooth the vertical acceleration: briefly for jolts, slowly for gravity."""
        if step_s == 0.0:  # the motion during a gap is unknown
            self._now_m_s2 = self._gravity_m_s2
            return
        self._now_m_s2 += min(step_s / JOLT_SMOOTH_S, 1.0) * (up_m_s2 - self._now_m_s2)
        self._gravity_m_s2 += min(step_s / GRAVITY_SMOOTH_S, 1.0) * (up_m_s2 - self._gravity_m_s2)

    def evidence(self) -> Evidence:
        """Return the source of the finding."""
        if self._reported:
            return "the device reports that it is lifted", {"by": "device"}
        return "no floor after a jolt: the robot is lifted", {"by": "host"}


class Bump:
    """There are too many contacts in the window, or a contact does not end."""

    grave = False

    def __init__(self, rule: BumpRule) -> None:
        """Set the limits."""
        self._rule = rule
        self.restart()

    def restart(self) -> None:
        """Discard all contacts."""
        self._onsets: list[float] = []
        self._touch: tuple[float, float] | None = None
        """Time (s) and odometry (m) of the last contact."""
        self._pressed = 0
        self._since_s = [math.inf, math.inf]

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Count new contacts and the time for which each switch is pressed."""
        reading, now_s = inputs.range, inputs.time_s
        if reading is not None:
            pressed = reading.contacts & _BUMPERS
            if pressed and not self._pressed:
                if not self._follows(now_s, measured.distance_m):
                    self._onsets.append(now_s)
                self._touch = now_s, measured.distance_m
            for half in (0, 1):
                if not pressed >> half & 1:
                    self._since_s[half] = math.inf
                elif self._since_s[half] == math.inf:
                    self._since_s[half] = now_s
            self._pressed = pressed
        while self._onsets and self._onsets[0] < now_s - self._rule.window_s:
            self._onsets.pop(0)
        self._held_s = now_s - min(self._since_s)
        return self._held_s >= self._rule.held_s or len(self._onsets) >= self._rule.count

    def _follows(self, now_s: float, distance_m: float) -> bool:
        """Return True if a contact continues the last contact."""
        if self._touch is None:
            return False
        before_s, before_m = self._touch
        made_m, (min_m, max_m) = distance_m - before_m, FOLLOWS_M
        return min_m < made_m < min(max_m, FOLLOWS_M_S * (now_s - before_s))

    def evidence(self) -> Evidence:
        """Return the number or the duration of the contacts."""
        data: dict[str, Scalar] = {
            "count": len(self._onsets),
            "window_s": self._rule.window_s,
            "held_s": round(max(self._held_s, 0.0), 2),
        }
        if self._held_s >= self._rule.held_s:
            return f"a bumper has been pressed for {self._held_s:.0f} s", data
        return f"{len(self._onsets)} bumps in {self._rule.window_s:.0f} s", data


class Cliff:
    """The cliff sensor finds no floor; grave if the robot drives on."""

    grave: bool

    def __init__(self, rule: CliffRule) -> None:
        """Set the limit."""
        self._rule = rule
        self.restart()

    def restart(self) -> None:
        """Reset to floor ahead."""
        self._seen_m: float | None = None
        self._ahead_m = 0.0
        self.grave = False

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Check the cliff bit, and the distance driven forward since it was set."""
        reading = inputs.range
        if reading is None or not reading.contacts & _CLIFF:
            self.restart()
            return False
        if self._seen_m is None:
            self._seen_m = measured.distance_m
        self._ahead_m = max(self._ahead_m, measured.distance_m - self._seen_m)
        self.grave = self._ahead_m > self._rule.ahead_m
        return True

    def evidence(self) -> Evidence:
        """Return the distance driven forward."""
        data: dict[str, Scalar] = {"ahead_m": round(self._ahead_m, 3)}
        if self.grave:
            return f"no floor ahead, and the robot drove on by {100 * self._ahead_m:.0f} cm", data
        return "no floor ahead", data
