"""Measures the delays that a busy machine causes, because a real-time verdict depends on them."""

from __future__ import annotations

import time
from pathlib import Path

PRESSURE = Path("/proc/pressure/cpu")
"""Path of the kernel's pressure stall information (PSI): the time in which tasks waited for a core.
"""
BUSY = 0.3
"""Maximum share of a test's time in which tasks waited for a core. Above it, a failure is no
verdict. On two idle cores the real-time tests stay below it, except when many programs start
together.
"""


def waited_ns() -> int:
    """Return the total time for which the threads of this process waited for a core, ns.

    The result is 0 if the time is unknown.
    """
    total = 0
    for task in Path("/proc/self/task").glob("*/schedstat"):
        try:
            total += int(task.read_text(encoding="ascii").split()[1])
        except (OSError, IndexError):
            continue  # the thread has ended, or the kernel has no statistics
    return total


class Busy:
    """Measures how busy the machine is from now on."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()
        self._before_us = _pressure_us()

    @property
    def elapsed_s(self) -> float:
        return time.monotonic() - self._began_s

    @property
    def share(self) -> float:
        """Return the share of the time since the start in which tasks waited for a core.

        The result is 0 if the share is unknown.
        """
        return (_pressure_us() - self._before_us) / 1e6 / max(self.elapsed_s, 1e-6)

    @property
    def excuses(self) -> bool:
        """Return whether the machine's load may be the cause of a real-time failure."""
        return self.share > BUSY


def _pressure_us() -> int:
    try:
        some = PRESSURE.read_text(encoding="ascii").splitlines()[0]
        return int(some.rpartition("total=")[2])
    except (OSError, ValueError, IndexError):
        return 0
