"""Rate limit for repeated actions."""

from __future__ import annotations


class TokenBucket:
    """Token bucket that allows a few actions at once, then one per period."""

    def __init__(self, at_once: int, period_ns: int) -> None:
        """Allow ``at_once`` actions at once and one more per ``period_ns``."""
        self._burst_ns = (at_once - 1) * period_ns
        self._period_ns = period_ns
        self._used_ns = 0
        """Time at which all tokens are available again, ns."""

    def due_ns(self) -> int:
        """Return the time of the next allowed action, ns."""
        return self._used_ns - self._burst_ns

    def rested(self, now_ns: int) -> bool:
        """Return True if all tokens are available."""
        return now_ns >= self._used_ns

    def take(self, now_ns: int) -> None:
        """Use one token."""
        self._used_ns = max(self._used_ns, now_ns) + self._period_ns
