"""What a log's file may ask of the disk: room for its own end, and that bytes outlive the power."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from io import FileIO
from typing import TYPE_CHECKING, BinaryIO

from bridge.errors import OutputExistsError
from bridge.files import check_target
from bridge.record.errors import LogWriteError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from _typeshed import ReadableBuffer

RESERVE_BYTES = 128 * 1024
"""Schemas, channels and the run's summary, with room."""
RESERVE_PER_WRITE = 640
"""Of the index that the file's end has for each chunk: 30 channels, uncompressed."""
_STEP_BYTES = 64 * 1024
_FULL = {errno.ENOSPC, errno.EDQUOT}


GONE = "it was deleted or renamed while it was being recorded"
REPLACED = "another file took its name while it was being recorded"


class LogFile(FileIO):
    """A log's file. Room for its end is held from the beginning, in a file without a name.

    So a full disk is noticed while the log can still be closed whole: the write that fails
    gives that room back, and what ends the file finds it.
    """

    def __init__(
        self,
        path: Path,
        mode: str,
        *,
        sync: Callable[[int], None] | None = None,
        ballast: Callable[[Path], BinaryIO | None] | None = None,
    ) -> None:
        """Open it; with ``sync`` every write has reached the disk when it returns.

        Raises:
            OSError: it cannot be opened, or there is no room for so much as its end.

        """
        super().__init__(path, mode)
        self._path = path.absolute()
        self._sync = sync
        self._ballast: BinaryIO | None = None
        self._held = self._needed = 0
        try:
            self._ballast = (ballast or hold_room)(path.parent)
            self._needed = RESERVE_BYTES
            self._hold()
        except OSError:
            self._release()
            self.close()
            if "x" in mode:  # it is ours, and empty
                path.unlink(missing_ok=True)
            raise

    def write(self, data: ReadableBuffer, /) -> int:
        """Write; a failure frees the room that is held for the file's end.

        Raises:
            OSError: it could not be written, or held, or its name is no longer that of this file.

        """
        try:
            self._check_name()
            written = super().write(data)
            if self._sync is not None:
                self._sync(self.fileno())
            if self._ballast is not None:
                self._needed += RESERVE_PER_WRITE
                self._hold()
        except OSError:
            self._release()
            raise
        return written

    def _check_name(self) -> None:
        """See that the file still has its name: what goes into a deleted one is lost.

        Raises:
            FileNotFoundError: it was deleted, or another file has its name.

        """
        try:
            named = self._path.stat()
        except (FileNotFoundError, NotADirectoryError):
            raise FileNotFoundError(errno.ENOENT, GONE) from None
        except OSError:  # a folder that may not be looked into says nothing of the file
            return
        own = os.fstat(self.fileno())
        if (named.st_dev, named.st_ino) != (own.st_dev, own.st_ino):
            raise FileNotFoundError(errno.ENOENT, REPLACED)

    def close(self) -> None:
        """Close it, and let go of what was held."""
        self._release()
        super().close()

    def _hold(self) -> None:
        if self._ballast is None:
            return
        while self._held < self._needed:
            # Not zeros: file systems that compress would hold nothing.
            self._ballast.write(os.urandom(_STEP_BYTES))
            self._held += _STEP_BYTES

    def _release(self) -> None:
        ballast, self._ballast = getattr(self, "_ballast", None), None
        if ballast is not None:
            with contextlib.suppress(OSError):
                ballast.close()


def hold_room(folder: Path) -> BinaryIO | None:
    """Make a file without a name; None where the folder takes none, as that of devices.

    Raises:
        OSError: the disk is full.

    """
    try:
        return tempfile.TemporaryFile(dir=folder, buffering=0)
    except OSError as error:
        if error.errno in _FULL:
            raise
        return None


def open_log_file(path: Path, *, force: bool, fsync: bool = False) -> LogFile:
    """Create a log's file.

    Raises:
        OutputExistsError: it exists and ``force`` is not set.
        LogWriteError: it cannot be made, or there is no room for it.

    """
    try:
        check_target(path)
        file = LogFile(path, "wb" if force else "xb", sync=_datasync if fsync else None)
        if fsync:
            _sync_folder(path.parent)
    except FileExistsError:
        raise OutputExistsError(path) from None
    except OSError as error:
        raise LogWriteError.of(path, error) from None
    return file


def _datasync(number: int) -> None:
    """See to it that what was written is on the disk, with the size that it gives the file."""
    if hasattr(os, "fdatasync"):
        os.fdatasync(number)
    else:
        os.fsync(number)


def _sync_folder(folder: Path) -> None:
    """The name itself must outlive a loss of power too; only Unix has a way to ask for it."""
    if os.name != "posix":
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
