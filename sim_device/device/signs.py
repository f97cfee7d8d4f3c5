"""Whether each encoder counts the way its motor pulls, and on its own side.

A wheel that counts against its duty has a reversed encoder, or motor. Swapped encoders agree while
the robot drives straight; in a turn each wheel seems to count against its duty, as the other one
turns the other way. Both reversed look the same in a turn on the spot: the device then says
swapped, and ``sweepctl bringup``, which turns one wheel at a time, tells them apart.
"""

from __future__ import annotations

from protocol.messages.values import Fault

DRIVEN = 0.2
"""Least duty that turns a wheel: the dead band ends at 0.15 with a full battery, at 0.2 with an
empty one."""
IDLE = 0.05
"""Greatest duty of a wheel that is not driven."""
TURNS_M_S = 0.03
"""Least speed of a wheel that turns, m/s: two counts a period."""
STANDS_M_S = 0.005
"""Greatest speed of a wheel that stands, m/s."""
AGAINST_TICKS = 15
"""Periods in a row against the duty. A wheel that reverses runs on for 3 at the ramp's rate; in
this time a runaway makes 5 cm."""
ALSO_TICKS = 5
"""Periods of the other wheel by which it counts against its duty too."""
ALONE_TICKS = 25
"""Periods of one wheel while the other one does not: of swapped encoders that diverge on a straight
run, the second wheel turns back 0.1 s after the first."""
AGREES_TICKS = 30
"""Periods in a row with the duty after which a fault is gone."""
REVERSED = int(Fault.ENCODER_LEFT_REVERSED), int(Fault.ENCODER_RIGHT_REVERSED)
SWAPPED = int(Fault.ENCODERS_SWAPPED)
BITS = REVERSED[0] | REVERSED[1] | SWAPPED


class _Side:
    """One wheel: for how many periods in a row its counts have said what."""

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
        """Nothing is known."""
        self.bits = 0
        """Of ``protocol.messages.values.Fault``."""
        self.driven = False
        """Whether a wheel had a duty in the last period, or there is nothing to compare."""
        self._left, self._right = _Side(), _Side()

    def tick(self, duties: tuple[float, float], speeds_m_s: tuple[float, float]) -> None:
        """One control period: duties, and speeds by the counts."""
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
        """Take a fault back when the counts agree for long enough, as in bring-up mode."""
        for side, bit in zip((self._left, self._right), REVERSED, strict=True):
            if side.agrees >= AGREES_TICKS:
                self.bits &= ~bit
        if max(self._left.own, self._right.own) >= AGREES_TICKS:
            self.bits &= ~SWAPPED
