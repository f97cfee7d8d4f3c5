"""The host's clock and sleep."""

from __future__ import annotations

import time

from protocol.clock import HostNs


def now() -> HostNs:
    """Return monotonic time, ns."""
    return HostNs(time.monotonic_ns())


def unix_offset_ns() -> int:
    """Return Unix time minus monotonic time, ns."""
    before = time.monotonic_ns()
    unix = time.time_ns()
    return unix - (before + time.monotonic_ns()) // 2


def pause(duration_s: float) -> None:
    """Sleep. Used if there is no port to wait for."""
    time.sleep(max(0.0, duration_s))
