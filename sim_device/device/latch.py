"""The latched stop: the most severe cause stays latched until a command clears this cause."""

from __future__ import annotations

from protocol.messages.values import StopCause, latched_cause


class StopLatch:
    """Stores the most severe cause of a stop until a command clears this cause.

    A device boots with the latched cause ``SESSION_END``, so it moves only after this cause is
    cleared.
    """

    def __init__(self, cause: StopCause = StopCause.SESSION_END) -> None:
        self.cause = cause

    @property
    def latched(self) -> bool:
        """True if a stop is latched and the robot must not move."""
        return self.cause is not StopCause.NONE

    def latch(self, cause: int) -> bool:
        """Latch a cause; return False if an equal or more severe cause is already latched."""
        held, self.cause = self.cause, latched_cause(self.cause, cause)
        return self.cause is not held

    def clear(self, cause: int) -> bool:
        """Release the latch if ``cause`` is the latched cause; return whether it was released."""
        if not self.latched or cause != self.cause:
            return False
        self.cause = StopCause.NONE
        return True
