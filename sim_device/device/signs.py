"""Detects reversed and swapped encoders: compares each wheel's counts with its motor's duty.

If a wheel counts against its duty, its encoder or motor is reversed. Swapped encoders (left and
right exchanged) look correct while the robot drives straight. In a turn in place the wheels turn in
opposite directions, so with swapped encoders both wheels count against their duties. Two reversed
encoders give the same counts in a turn in place. The device reports both cases as swapped encoders.
``sweepctl bringup`` turns one wheel at a time, so it can distinguish these faults.
"""

from __future__ import annotations

from protocol.messages.values import Fault

DRIVEN = 0.2
"""Minimum duty that turns a wheel. The dead band ends at 0.15 with a full battery, and at 0.2 with
an empty battery."""
IDLE = 0.05
"""Maximum duty of a wheel that is not driven."""
TURNS_M_S = 0.03
"""Minimum speed of a turning wheel, m/s: two counts per control period."""
STANDS_M_S = 0.005
"""Maximum speed of a standing wheel, m/s."""
AGAINST_TICKS = 15
"""Number of consecutive control periods with counts against the duty that set a fault. A wheel that
changes its direction may turn against its new duty for 3 periods. With reversed encoders, the robot
travels 5 cm out of control before the fault is set."""
ALSO_TICKS = 5
"""Minimum number of periods in which the other wheel also counts against its duty, for a fault of
both wheels."""
ALONE_TICKS = 25
"""Number of periods against the duty that set a fault of one wheel while the other wheel counts
correctly. With swapped encoders on a straight path, the second wheel begins to count against its
duty 0.1 s after the first wheel, so a shorter time would report one reversed encoder."""
AGREES_TICKS = 30
"""Number of consecutive periods with counts in the direction of the duty that clear a fault."""
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
    """Compares motor duties with encoder counts."""

    def __init__(self) -> None:
        """Start without a fault."""
        self.bits = 0
        """Fault bits (``protocol.messages.values.Fault``)."""
        self.driven = False
        """True if a wheel had a nonzero duty in the last period."""
        self._left, self._right = _Side(), _Side()

    def tick(self, duties: tuple[float, float], speeds_m_s: tuple[float, float]) -> None:
        """Process the duties and measured speeds of one control period."""
        self.driven = duties != (0.0, 0.0)
        left, right = self._left, self._right
        (left_duty, right_duty), (left_m_s, right_m_s) = duties, speeds_m_s
        left.tick(left_duty, left_m_s, right_duty, right_m_s)
        right.tick(right_duty, right_m_s, left_duty, left_m_s)
        if self.bits:
            self._clear_agreeing()
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

    def _clear_agreeing(self) -> None:
        """Clear a fault when counts have agreed with duties long enough, also in bring-up mode."""
        for side, bit in zip((self._left, self._right), REVERSED, strict=True):
            if side.agrees >= AGREES_TICKS:
                self.bits &= ~bit
        if max(self._left.own, self._right.own) >= AGREES_TICKS:
            self.bits &= ~SWAPPED
