"""How often something may be done."""

from __future__ import annotations


class Pace:
    """Bounds how often something is done: a few times at once, then once a period."""

    def __init__(self, at_once: int, period_ns: int) -> None:
        """All of ``at_once`` are free."""
        self._burst_ns = (at_once - 1) * period_ns
        self._period_ns = period_ns
        self._used_ns = 0
        """Until when all of them are free again."""

    def due_ns(self) -> int:
        """When the next may be done."""
        return self._used_ns - self._burst_ns

    def rested(self, now_ns: int) -> bool:
        """Whether all of them are free."""
        return now_ns >= self._used_ns

    def take(self, now_ns: int) -> None:
        """Do one."""
        self._used_ns = max(self._used_ns, now_ns) + self._period_ns
