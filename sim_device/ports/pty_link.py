"""The symbolic link with a stable name that a running emulator claims and releases."""

from __future__ import annotations

import os
import struct
import sys
from contextlib import suppress
from typing import TYPE_CHECKING
from zlib import crc32

from sim_device.ports.base import PortUnavailableError
from sim_device.ports.folder_lock import folder_locked

if TYPE_CHECKING:
    from pathlib import Path


class PtyLink:
    """A symbolic link with a stable name to a pseudo-terminal.

    The owner locks one byte of the pseudo-terminal, at an offset computed from the link's path. The
    system releases the lock when the process ends, so another emulator can replace a stale link.
    """

    def __init__(self, path: Path, slave: int) -> None:
        """Claim the name for the open pseudo-terminal ``slave``.

        Raises:
            PortUnavailableError: another emulator has the name, the path is not a link, or the link
                cannot be created.

        """
        self.path = path
        self._target = os.ttyname(slave)
        offset = crc32(os.fsencode(path.parent.resolve() / path.name))
        with folder_locked(path):
            try:
                if path.is_symlink():
                    self._take_over(offset)
                path.symlink_to(self._target)
            except OSError as error:
                if isinstance(error, PortUnavailableError):
                    raise
                raise PortUnavailableError(
                    f"cannot make the link {path}: {error.strerror}"
                ) from None
            _lock(slave, offset)

    def _take_over(self, offset: int) -> None:
        """Remove a stale link, which an emulator has left behind."""
        target = self.path.readlink()
        if self.path.is_char_device():
            try:
                other = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            except OSError as error:
                raise PortUnavailableError(
                    f"the link {self.path} leads to {target}, which is not ours: {error.strerror}"
                ) from None
            try:
                if not _lock(other, offset):
                    raise PortUnavailableError(
                        f"the link {self.path} belongs to another emulator that still runs "
                        f"(on {target}); end it, or choose another --pty-link"
                    )
            finally:
                os.close(other)
        self.path.unlink()

    def remove(self) -> None:
        """Remove the link, unless it now points to another pseudo-terminal."""
        with suppress(OSError), folder_locked(self.path):
            if str(self.path.readlink()) == self._target:
                self.path.unlink()


def _lock(fd: int, offset: int) -> bool:
    """Lock one byte while ``fd`` is open; return False if another process has the lock."""
    import fcntl  # noqa: PLC0415 - not on every platform

    try:
        if sys.platform == "linux":
            # This lock belongs to the open file, so it also excludes other open files of this
            # process.
            wanted = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, offset, 1, 0)
            fcntl.fcntl(fd, fcntl.F_OFD_SETLK, wanted)
        else:
            fcntl.lockf(fd, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, offset)
    except (BlockingIOError, PermissionError):
        return False
    return True
