"""Queue of log lines for the host, with a limited rate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.messages.device import LogText

if TYPE_CHECKING:
    from protocol.messages.values import LogLevel

LOG_PERIOD_US = 100_000
"""Minimum time between log lines, µs: ten lines per second. A full queue drops its oldest line."""
LOG_WAITING = 16
LOG_BYTES = 120
"""Maximum length of a log line, bytes."""


class LogLines:
    """A short queue of log lines."""

    def __init__(self) -> None:
        self.waiting: list[LogText] = []
        self._sent_us = -LOG_PERIOD_US

    def add(self, level: LogLevel, line: str) -> None:
        """Queue a line for the host."""
        text = line.encode()[:LOG_BYTES].decode(errors="ignore")
        self.waiting.append(LogText(level, text))
        del self.waiting[:-LOG_WAITING]

    def take(self, now_us: int) -> LogText | None:
        """Return the next line, or None if no line may be sent now."""
        if not self.waiting or now_us - self._sent_us < LOG_PERIOD_US:
            return None
        self._sent_us = now_us
        return self.waiting.pop(0)
