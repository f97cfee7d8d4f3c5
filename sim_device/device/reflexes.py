"""The device's own reaction to a cliff and to a pressed bumper, whatever speed is requested.

At a cliff the robot may reverse and turn, but not drive forward. With a pressed bumper it drives
slowly. Neither reflex latches a stop. A robot that stays over a cliff does: see
:attr:`Reflexes.over`.
"""

from __future__ import annotations

CREEP_M_S = 0.05
"""Forward speed with a pressed bumper, m/s: fast enough for the wheel control, and harmless in a
push."""
OVER_M = 0.05
"""Travel ahead without floor that latches a stop, m. From 0.2 m/s the reflex needs 2 to 3 cm."""
OVER_TICKS = 100
"""Maximum number of control periods with a forward command over a cliff before a stop latches: 1 s.
A host that detects the cliff needs 0.07 s. The time to reverse does not count, because from 0.28
m/s the robot needs 1.0 s to come back."""
SHOWN_TICKS = 10
"""Number of control periods for which a limit stays visible: one period of the status message."""
_HALF_WRAP, _MASK = 0x8000, 0xFFFF


class Reflexes:
    """Limits the forward speed, once per control period in which the robot may drive."""

    def __init__(self) -> None:
        """Start without a limit; both reflexes are on."""
        self.at_cliff = self.at_bumper = True
        """Enabled reflexes, by parameter."""
        self._shown = 0
        self._ticks = 0
        """Number of periods without floor ahead in which forward speed was requested."""
        self._counts: tuple[int, int] | None = None
        self._ahead = 0
        """Counts of both wheels since the floor ended, forward positive."""

    @property
    def limited(self) -> bool:
        """Whether a speed was limited within the last ``SHOWN_TICKS`` periods."""
        return self._shown > 0

    @property
    def counting(self) -> bool:
        """True while the robot is at the place where the floor ended."""
        return self._counts is not None

    def over(self, metres_per_count: float) -> bool:
        """Return True if a stop must latch: 1 s of forward commands, or 5 cm beyond the edge."""
        ahead_m = 0.5 * self._ahead * metres_per_count
        return self._ticks >= OVER_TICKS or ahead_m >= OVER_M

    def rest(self) -> None:
        """Count a control period without a motion command."""
        self._ticks = self._ahead = 0
        self._counts = None
        if self._shown:
            self._shown -= 1

    def limit(
        self,
        v_m_s: float,
        contacts: tuple[bool, bool, bool],
        counts: tuple[int, int],
    ) -> float:
        """Return the allowed forward speed; contacts are left and right bumper, and cliff."""
        left, right, cliff = contacts
        allowed_m_s = v_m_s
        if cliff and self.at_cliff:
            self._ticks += v_m_s > 0.0
            self._follow(counts)
            allowed_m_s = min(v_m_s, 0.0)
        else:
            self._ticks = self._ahead = 0
            self._counts = None
        if (left or right) and self.at_bumper:
            allowed_m_s = min(allowed_m_s, CREEP_M_S)
        if allowed_m_s < v_m_s:
            self._shown = SHOWN_TICKS
        elif self._shown:
            self._shown -= 1
        return allowed_m_s

    def _follow(self, counts: tuple[int, int]) -> None:
        if self._counts is not None:
            self._ahead += sum(
                (now - before + _HALF_WRAP & _MASK) - _HALF_WRAP
                for now, before in zip(counts, self._counts, strict=True)
            )
        self._counts = counts
