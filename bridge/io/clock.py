"""The host's clock."""

from __future__ import annotations

import time

from protocol.clock import HostNs


def now() -> HostNs:
    """Monotonic time."""
    return HostNs(time.monotonic_ns())


def unix_offset_ns() -> int:
    """Unix time less monotonic time, now; taken once per log."""
    before = time.monotonic_ns()
    unix = time.time_ns()
    return unix - (before + time.monotonic_ns()) // 2


def pause(duration_s: float) -> None:
    """Wait where there is no port to wait on: it is gone and its return is awaited."""
    time.sleep(max(0.0, duration_s))
