"""The lock that says whose a device file is."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from bridge.errors import PortBusyError, PortError


class DeviceLock:
    """An exclusive lock on a device file that another library opens without one."""

    def __init__(self, path: str) -> None:
        """Take it.

        Raises:
            PortBusyError: another process has it.
            PortError: there is no such file, or it may not be opened.

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
            raise PortError(f"{path} does not exist; is the adapter plugged in?") from None
        except OSError as error:
            self.close()
            raise PortError(f"cannot open {path}: {error.strerror}") from None

    def close(self) -> None:
        """Give it back."""
        if self._fd >= 0:
            with suppress(OSError):
                os.close(self._fd)
            self._fd = -1


def owner_pid(path: str) -> int | None:
    """The process that holds the lock on a device file, where the system tells (Linux)."""
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
