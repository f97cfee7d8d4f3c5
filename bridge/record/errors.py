"""What can go wrong with a log, each in one clear line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from bridge.errors import BridgeError
from bridge.files import cause

if TYPE_CHECKING:
    from pathlib import Path


class LogError(BridgeError):
    """Base of everything that recording and reading may raise."""

    def __init__(self, path: Path, text: str) -> None:
        super().__init__(text)
        self.path = path


class LogWriteError(LogError):
    """The log cannot be opened or written: no such folder, no permission, disk full."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(path, f"cannot write {path}: {reason}")
        self.reason = reason

    @classmethod
    def of(cls, path: Path, error: OSError) -> Self:
        """Say what the system refused, and what to do where that is known."""
        return cls(path, cause(path, error))


class LogGoneError(LogWriteError):
    """The log's file was deleted or replaced while it was being recorded: there is no log."""


class LogReadError(LogError):
    """The file is missing, is no MCAP, or is damaged before its first record."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(path, f"cannot read {path}: {reason}")
        self.reason = reason
