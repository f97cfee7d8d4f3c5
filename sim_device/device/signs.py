"""Check that each encoder counts in the direction of its motor, and on its own side.

A wheel that counts against its duty has a reversed encoder or motor. Swapped encoders look correct
while the robot drives straight. In a turn each wheel then seems to count against its duty, because
the wheels turn in opposite directions. Two reversed encoders look the same in a turn in place, so
the device then reports swapped encoders. ``sweepctl bringup`` turns one wheel at a time and
distinguishes these faults.
"""

from __future__ import annotations

from protocol.messages.values import Fault

DRIVEN = 0.2
"""Minimum duty that turns a wheel: the dead band ends at 0.15 with a full battery, at 0.2 with an
empty one."""
IDLE = 0.05
"""Maximum duty of a wheel that is not driven."""
TURNS_M_S = 0.03
"""Minimum speed of a turning wheel, m/s: two counts a period."""
STANDS_M_S = 0.005
"""Maximum speed of a standing wheel, m/s."""
AGAINST_TICKS = 15
"""Number of consecutive periods against the duty that set a fault. A reversing wheel runs on for 3
at the ramp's rate. In this time a runaway robot covers 5 cm."""
ALSO_TICKS = 5
"""Minimum number of periods in which the other wheel must also count against its duty."""
ALONE_TICKS = 25
"""Number of periods for one wheel while the other wheel counts correctly. With swapped encoders on
a straight run, the second wheel turns back 0.1 s after the first."""
AGREES_TICKS = 30
"""Number of consecutive periods with the duty that clear a fault."""
REVERSED = int(Fault.ENCODER_LEFT_REVERSED), int(Fault.ENCODER_RIGHT_REVERSED)
SWAPPED = int(Fault.ENCODERS_SWAPPED)
BITS = REVERSED[0] | REVERSED[1] | SWAPPED


class _Side:
    """Numbers of consecutive periods in which a wheel's counts agree or disagree with its duty."""

    __slots__ = ("against", "agrees", "crossed", "own", "was_ahead")

    def __init__(self) -> None:
        self.against = self.agrees = self.own = self.crossed = 0
        self.was_ahead = False

    def tick(self, duty: float, speed_m_s: float, other_duty: float, other_m_s: float) -> None:
        ahead = duty > 0.0
        driven = abs(duty) >= DRIVEN and ahead == self.was_ahead
        self.was_ahead = ahead
        along_m_s, other_along = (speed_m_s, other_duty) if ahead else (-speed_m_s, -other_duty)
        with_it = driven and along_m_s >= TURNS_M_S
        self.against = self.against + 1 if driven and along_m_s <= -TURNS_M_S else 0
        self.agrees = self.agrees + 1 if with_it else 0
        self.own = self.own + 1 if with_it and other_along <= IDLE else 0
        crossed = (
            driven
            and abs(speed_m_s) < STANDS_M_S
            and abs(other_duty) <= IDLE
            and (other_m_s if ahead else -other_m_s) >= TURNS_M_S
        )
        self.crossed = self.crossed + 1 if crossed else 0


class Signs:
    """Compares duties with counts."""

    def __init__(self) -> None:
        """Start without a fault."""
        self.bits = 0
        """Fault bits, of ``protocol.messages.values.Fault``."""
        self.driven = False
        """True if a wheel had a duty in the last period, or if there is nothing to compare."""
        self._left, self._right = _Side(), _Side()

    def tick(self, duties: tuple[float, float], speeds_m_s: tuple[float, float]) -> None:
        """Take duties and measured speeds of one control period."""
        self.driven = duties != (0.0, 0.0)
        left, right = self._left, self._right
        (left_duty, right_duty), (left_m_s, right_m_s) = duties, speeds_m_s
        left.tick(left_duty, left_m_s, right_duty, right_m_s)
        right.tick(right_duty, right_m_s, left_duty, left_m_s)
        if self.bits:
            self._forgive()
        elif max(left.crossed, right.crossed) >= AGREES_TICKS:
            self.bits = SWAPPED
        elif max(left.against, right.against) >= AGAINST_TICKS:
            if min(left.against, right.against) >= ALSO_TICKS:
                both = REVERSED[0] | REVERSED[1]
                self.bits = SWAPPED if left.was_ahead != right.was_ahead else both
            elif left.against >= ALONE_TICKS:
                self.bits = REVERSED[0]
            elif right.against >= ALONE_TICKS:
                self.bits = REVERSED[1]

    def _forgive(self) -> None:
        """Clear a fault after a long enough agreement of the counts, also in bring-up mode."""
        for side, bit in zip((self._left, self._right), REVERSED, strict=True):
            if side.agrees >= AGREES_TICKS:
                self.bits &= ~bit
        if max(self._left.own, self._right.own) >= AGREES_TICKS:
            self.bits &= ~SWAPPED
