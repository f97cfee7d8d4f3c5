"""Frames that are missing from a log, by their sequence numbers."""

from __future__ import annotations

_WRAP = 1 << 8
_HALF = _WRAP // 2


class LossCounter:
    """Counts what one sender's numbers pass over.

    A log keeps the messages of one moment by topic, not in the order of the wire, so a number
    may come a little late; it is no loss then.
    """

    def __init__(self) -> None:
        self._newest: int | None = None
        self._first = 0
        self._seen = 0
        self.lost = 0
        """So far, and never less than before."""

    def add(self, sequence: int) -> None:
        """Take the number of a message that came."""
        if self._newest is None:
            self._newest = self._first = sequence
        else:
            step = (sequence - self._newest + _HALF) % _WRAP - _HALF
            self._newest = max(self._newest, self._newest + step)
        self._seen += 1

    def update(self) -> int:
        """Losses since the last call: numbers that are still missing."""
        if self._newest is None:
            return 0
        missing = self._newest - self._first + 1 - self._seen
        new = max(0, missing - self.lost)
        self.lost += new
        return new
