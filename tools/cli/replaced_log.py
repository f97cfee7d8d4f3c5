"""The file that a log takes the place of, kept until there is a device to record."""

from __future__ import annotations

import contextlib
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


class ReplacedLog:
    """An older log under a name of its own: a connect that fails must not cost it."""

    def __init__(self, log: Path, *, force: bool) -> None:
        """Move the file aside, where ``force`` allows it to be replaced."""
        self._log = log
        self._kept: Path | None = None
        # A link stays a link, and a device file holds nothing to keep.
        if force and log.is_file() and not log.is_symlink():
            kept = log.with_name(f"{log.name}.{os.getpid()}.replaced")
            with contextlib.suppress(OSError):  # opening the log will say why
                log.rename(kept)
                self._kept = kept

    def drop(self) -> None:
        """The new log has something to say: remove the old one."""
        kept, self._kept = self._kept, None
        if kept is not None:
            with contextlib.suppress(OSError):
                kept.unlink()

    def put_back(self) -> None:
        """There is no new log: the old one takes its place again."""
        kept, self._kept = self._kept, None
        if kept is not None:
            with contextlib.suppress(OSError):
                kept.rename(self._log)
