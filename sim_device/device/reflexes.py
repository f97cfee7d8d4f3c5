"""The device's reflexes at a cliff and at a pressed bumper: they limit any requested speed.

At a cliff the robot may reverse and turn, but not drive forward. With a pressed bumper the robot
drives slowly. These reflexes do not latch a stop. But a stop is latched if the robot stays over a
cliff: see :meth:`Reflexes.over`.
"""

from __future__ import annotations

from bridge.motion.estimation.odometry import encoder_delta

CREEP_M_S = 0.05
"""Maximum forward speed with a pressed bumper, m/s. It is high enough for the wheel control, and
harmless when the robot pushes an obstacle."""
OVER_M = 0.05
"""Forward travel beyond the floor's edge that latches a stop, m. The reflex itself stops the robot
from 0.2 m/s within 2 to 3 cm."""
OVER_TICKS = 100
"""Maximum number of control periods with a forward command over a cliff before a stop is latched: 1
s. A host reacts to a cliff within 0.07 s. Periods with a reverse command do not count, because the
robot needs 1.0 s to return after a speed of 0.28 m/s."""
SHOWN_TICKS = 10
"""Number of control periods for which a limit stays reported: one period of the status message."""


class Reflexes:
    """Limits the forward speed, once in each control period in which the robot may drive."""

    def __init__(self) -> None:
        """Start without a limit; both reflexes are enabled."""
        self.at_cliff = self.at_bumper = True
        """True if the reflex is enabled, as set by its parameter."""
        self._shown = 0
        self._ticks = 0
        """Number of control periods with a forward command and without floor ahead."""
        self._counts: tuple[int, int] | None = None
        self._ahead = 0
        """Sum of both wheels' encoder counts since the cliff was detected, forward positive."""

    @property
    def limited(self) -> bool:
        """Whether a speed was limited within the last ``SHOWN_TICKS`` periods."""
        return self._shown > 0

    @property
    def counting(self) -> bool:
        """True while the robot is at the cliff."""
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
        """Return the allowed forward speed; ``contacts``: left bumper, right bumper, cliff."""
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
                encoder_delta(before, now) for before, now in zip(self._counts, counts, strict=True)
            )
        self._counts = counts
