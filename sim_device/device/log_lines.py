"""Lines for people, on their way to the host: few enough not to crowd the wire."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.messages.device import LogText

if TYPE_CHECKING:
    from protocol.messages.values import LogLevel

LOG_PERIOD_US = 100_000
"""At most ten log lines a second; what waits longer is dropped, oldest first."""
LOG_WAITING = 16
LOG_BYTES = 120
"""A line's length on the wire, whatever name a host gives itself."""


class LogLines:
    """A short queue."""

    def __init__(self) -> None:
        self.waiting: list[LogText] = []
        self._sent_us = -LOG_PERIOD_US

    def add(self, level: LogLevel, line: str) -> None:
        """Queue a line for the host."""
        text = line.encode()[:LOG_BYTES].decode(errors="ignore")
        self.waiting.append(LogText(level, text))
        del self.waiting[:-LOG_WAITING]

    def take(self, now_us: int) -> LogText | None:
        """The next line, if one may be sent now."""
        if not self.waiting or now_us - self._sent_us < LOG_PERIOD_US:
            return None
        self._sent_us = now_us
        return self.waiting.pop(0)
