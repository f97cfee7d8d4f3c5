"""Disk space and durability of a log's file."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from io import FileIO
from typing import TYPE_CHECKING, BinaryIO

from bridge.errors import OutputExistsError
from bridge.files import writing_mode
from bridge.record.errors import LogWriteError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from _typeshed import ReadableBuffer

RESERVE_BYTES = 128 * 1024
"""Disk space reserved for schemas, channels and the run's summary, bytes. It includes a margin."""
RESERVE_PER_WRITE = 640
"""Disk space reserved per write for the index in the summary, bytes: 30 channels, uncompressed."""
_STEP_BYTES = 64 * 1024
_FULL = {errno.ENOSPC, errno.EDQUOT}


GONE = "it was deleted or renamed during the recording"
REPLACED = "another file took its name during the recording"


class LogFile(FileIO):
    """File of a log. A second, unnamed file reserves disk space for the end of the log.

    If the disk is full, the failed write releases the reserved space. The end of the log then fits
    on the disk, and the log is complete.
    """

    def __init__(
        self,
        path: Path,
        mode: str,
        *,
        sync: Callable[[int], None] | None = None,
        ballast: Callable[[Path], BinaryIO | None] | None = None,
    ) -> None:
        """Open the file. ``sync`` is called after each write.

        Raises:
            OSError: the file cannot be opened, or the disk has no space for its end.

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
            if "x" in mode:  # a new, empty file
                path.unlink(missing_ok=True)
            raise

    def write(self, data: ReadableBuffer, /) -> int:
        """Write data. On failure, release the space that is reserved for the end.

        Raises:
            OSError: the write or the reservation failed, or the file was deleted or renamed.

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
        """Check that the file still has its name. Data in a deleted file would be lost.

        Raises:
            FileNotFoundError: the file was deleted, or another file has its name.

        """
        try:
            named = self._path.stat()
        except (FileNotFoundError, NotADirectoryError):
            raise FileNotFoundError(errno.ENOENT, GONE) from None
        except OSError:  # without permission for the folder the check is not possible
            return
        own = os.fstat(self.fileno())
        if (named.st_dev, named.st_ino) != (own.st_dev, own.st_ino):
            raise FileNotFoundError(errno.ENOENT, REPLACED)

    def close(self) -> None:
        """Close the file and release the reserved space."""
        self._release()
        super().close()

    def _hold(self) -> None:
        if self._ballast is None:
            return
        while self._held < self._needed:
            # Write random bytes, because compressing file systems would reserve no space for zeros.
            self._ballast.write(os.urandom(_STEP_BYTES))
            self._held += _STEP_BYTES

    def _release(self) -> None:
        ballast, self._ballast = getattr(self, "_ballast", None), None
        if ballast is not None:
            with contextlib.suppress(OSError):
                ballast.close()


def hold_room(folder: Path) -> BinaryIO | None:
    """Create an unnamed file. Return None if the folder does not support it, for example in /dev.

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
        OutputExistsError: the file exists, and ``force`` is False.
        LogWriteError: the file cannot be created, or the disk is full.

    """
    try:
        mode = writing_mode(path, force=force)
        file = LogFile(path, mode, sync=_datasync if fsync else None)
        if fsync:
            _sync_folder(path.parent)
    except FileExistsError:
        raise OutputExistsError(path) from None
    except OSError as error:
        raise LogWriteError.of(path, error) from None
    return file


def _datasync(number: int) -> None:
    """Wait until the written data and the file's size are on the disk."""
    if hasattr(os, "fdatasync"):
        os.fdatasync(number)
    else:
        os.fsync(number)


def _sync_folder(folder: Path) -> None:
    """Wait until the file's name is on the disk. Only POSIX systems support it."""
    if os.name != "posix":
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
