"""Errors of writing and reading logs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from bridge.errors import BridgeError
from bridge.files import cause

if TYPE_CHECKING:
    from pathlib import Path


class LogError(BridgeError):
    """Base of all errors of recording and reading."""

    def __init__(self, path: Path, text: str) -> None:
        super().__init__(text)
        self.path = path


class LogWriteError(LogError):
    """The log cannot be opened or written: no folder, no permission, disk full."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(path, f"cannot write {path}: {reason}")
        self.reason = reason

    @classmethod
    def of(cls, path: Path, error: OSError) -> Self:
        """Create the error from a system error. The text names a remedy if one is known."""
        return cls(path, cause(path, error))


class LogGoneError(LogWriteError):
    """The log's file was deleted or replaced during the recording, so the log is lost."""


class LogReadError(LogError):
    """The file is missing, is not an MCAP file, or is damaged before its first record."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(path, f"cannot read {path}: {reason}")
        self.reason = reason
