"""Errors of the library of runs."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING

from bridge.errors import BridgeError

if TYPE_CHECKING:
    from pathlib import Path


_BUSY = {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY}
"""Result codes of a healthy index that cannot be used now."""


class LibraryError(BridgeError):
    """The library cannot use a folder, selection, tag or name."""

    exit_status = 2


class NoRunError(LibraryError):
    """``latest`` or ``latest~N`` refers to a run that does not exist."""


class IndexBusyError(LibraryError):
    """The index cannot be used now: another process uses it, or the disk is full."""

    exit_status = 1

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"the index {path} cannot be used: {reason}; try again")


class IndexDamagedError(LibraryError):
    """The index is damaged. It contains tags and notes, so it is not replaced."""

    exit_status = 1

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(
            f"the index {path} cannot be used: {reason}; delete it to make a new one (its tags and "
            "notes are lost)"
        )


def index_error(path: Path, error: sqlite3.DatabaseError) -> LibraryError:
    """Return the error for an exception of the database."""
    kind = IndexBusyError if error.sqlite_errorcode & 0xFF in _BUSY else IndexDamagedError
    return kind(path, str(error))
