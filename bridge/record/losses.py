"""Count of frames that are missing from a log, by sequence numbers."""

from __future__ import annotations

_WRAP = 1 << 8
_HALF = _WRAP // 2


class LossCounter:
    """Counts gaps in one sender's sequence numbers.

    A log sorts messages of one time by topic, so a number may come late. That is not a loss.
    """

    def __init__(self) -> None:
        self._newest: int | None = None
        self._first = 0
        self._seen = 0
        self.lost = 0
        """Number of losses; it never decreases."""

    def add(self, sequence: int) -> None:
        """Add the number of a received message."""
        if self._newest is None:
            self._newest = self._first = sequence
        else:
            step = (sequence - self._newest + _HALF) % _WRAP - _HALF
            self._newest = max(self._newest, self._newest + step)
        self._seen += 1

    def update(self) -> int:
        """Return the new losses since the last call."""
        if self._newest is None:
            return 0
        missing = self._newest - self._first + 1 - self._seen
        new = max(0, missing - self.lost)
        self.lost += new
        return new
