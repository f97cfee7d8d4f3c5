"""What the device does by itself at a cliff and with a bumper pressed, whoever asks for speed.

At a cliff the robot may reverse and turn, and no more go ahead; with a bumper pressed it creeps.
Neither latches a stop. A robot that stays over a cliff does: see :attr:`Reflexes.over`.
"""

from __future__ import annotations

CREEP_M_S = 0.05
"""Forward speed with a bumper pressed, m/s: the wheels still follow it, and a push hurts nobody."""
OVER_M = 0.05
"""Travel ahead with no floor before it, m; from 0.2 m/s the reflex needs 2 to 3 cm."""
OVER_TICKS = 100
"""Control periods in which a host asks for speed ahead over a cliff: 1 s. One that sees the cliff
asks for 0.07 s. The time to reverse does not count: from 0.28 m/s it takes 1.0 s to be back."""
SHOWN_TICKS = 10
"""Control periods for which a limit stays visible: one period of the status message."""
_HALF_WRAP, _MASK = 0x8000, 0xFFFF


class Reflexes:
    """Limits the forward speed, once a control period in which the robot may drive."""

    def __init__(self) -> None:
        """Nothing is limited; both reflexes are on."""
        self.at_cliff = self.at_bumper = True
        """Which are on, by parameter."""
        self._shown = 0
        self._ticks = 0
        """Periods without floor ahead in which speed ahead was asked for."""
        self._counts: tuple[int, int] | None = None
        self._ahead = 0
        """Counts of both wheels since the floor ended, forward positive."""

    @property
    def limited(self) -> bool:
        """Whether a speed was held back lately."""
        return self._shown > 0

    @property
    def counting(self) -> bool:
        """Whether the floor ended, and the robot has yet to leave the place."""
        return self._counts is not None

    def over(self, metres_per_count: float) -> bool:
        """Whether the robot would go on over a cliff: asked to for 1 s, or 5 cm further ahead."""
        ahead_m = 0.5 * self._ahead * metres_per_count
        return self._ticks >= OVER_TICKS or ahead_m >= OVER_M

    def rest(self) -> None:
        """A period in which nothing drives by itself."""
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
        """Forward speed that is allowed; contacts are left and right bumper, and cliff."""
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
