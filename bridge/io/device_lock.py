"""Exclusive locks on device files."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from bridge.errors import PortBusyError, PortError


class DeviceLock:
    """Exclusive lock on a device file that another library opens without a lock."""

    def __init__(self, path: str) -> None:
        """Lock the file.

        Raises:
            PortBusyError: another process has the lock.
            PortError: the file does not exist or cannot be opened.

        """
        self._fd = -1
        try:
            import fcntl  # noqa: PLC0415 - not on every platform
        except ImportError:
            return
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.close()
            raise PortBusyError(path, owner_pid(path)) from None
        except FileNotFoundError:
            raise PortError(f"{path} does not exist; plug in the adapter") from None
        except OSError as error:
            self.close()
            raise PortError(f"cannot open {path}: {error.strerror}") from None

    def close(self) -> None:
        """Release the lock."""
        if self._fd >= 0:
            with suppress(OSError):
                os.close(self._fd)
            self._fd = -1


def owner_pid(path: str) -> int | None:
    """Return the process that holds a device file's lock; None if unknown. Linux only."""
    try:
        stat = Path(path).stat()
        locks = Path("/proc/locks").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    device = f"{os.major(stat.st_dev):02x}:{os.minor(stat.st_dev):02x}:{stat.st_ino}"
    for line in locks:
        fields = line.split()
        if device in fields and "FLOCK" in fields:
            pid = int(fields[fields.index(device) - 1])
            return pid if pid > 0 else None
    return None
