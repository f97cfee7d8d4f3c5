"""Existing log that a new log replaces. It is removed when the new log has recorded a device."""

from __future__ import annotations

import contextlib
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


class ReplacedLog:
    """An existing log under a temporary name, so that a failed connect does not delete it."""

    def __init__(self, log: Path | None, *, force: bool) -> None:
        """Rename the existing file, if ``force`` allows it to be replaced."""
        self._log = log
        self._kept: Path | None = None
        # Not a symbolic link, because the new log is written to its target. Not a device file,
        # because it has no content.
        if log is not None and force and log.is_file() and not log.is_symlink():
            kept = log.with_name(f"{log.name}.{os.getpid()}.replaced")
            with contextlib.suppress(OSError):  # opening the log will report why
                log.rename(kept)
                self._kept = kept

    def drop(self) -> None:
        """Remove the old log, because the new log has recorded data."""
        kept, self._kept = self._kept, None
        if kept is not None:
            with contextlib.suppress(OSError):
                kept.unlink()

    def put_back(self) -> None:
        """Restore the name of the old log, because there is no new log."""
        kept, self._kept = self._kept, None
        if kept is not None and self._log is not None:
            with contextlib.suppress(OSError):
                kept.rename(self._log)
