"""How much the machine has kept programs from running: what real-time verdicts allow for."""

from __future__ import annotations

import time
from pathlib import Path

PRESSURE = Path("/proc/pressure/cpu")
"""The kernel's account of the time in which a task waited for a core (its document on PSI)."""
BUSY = 0.3
"""Share of a test's time with a task that waits, above which a failure is no verdict: the
real-time tests on two idle cores stay below it but for the start of many programs at once."""


def waited_ns() -> int:
    """For how long threads of this process have waited for a core, ns in all; 0 where unknown."""
    total = 0
    for task in Path("/proc/self/task").glob("*/schedstat"):
        try:
            total += int(task.read_text(encoding="ascii").split()[1])
        except (OSError, IndexError):
            continue  # the thread has ended, or the kernel keeps no account
    return total


class Busy:
    """How busy the machine is from now on."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()
        self._before_us = _pressure_us()

    @property
    def elapsed_s(self) -> float:
        return time.monotonic() - self._began_s

    @property
    def share(self) -> float:
        """Of the time since: how much of it some task waited for a core; 0 where unknown."""
        return (_pressure_us() - self._before_us) / 1e6 / max(self.elapsed_s, 1e-6)

    @property
    def excuses(self) -> bool:
        """Whether a real-time failure since says more about the machine than about the program."""
        return self.share > BUSY


def _pressure_us() -> int:
    try:
        some = PRESSURE.read_text(encoding="ascii").splitlines()[0]
        return int(some.rpartition("total=")[2])
    except (OSError, ValueError, IndexError):
        return 0
