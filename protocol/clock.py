"""The two clocks of a link, as types that cannot be mixed."""

from __future__ import annotations

from typing import NewType

HostNs = NewType("HostNs", int)
"""Host's monotonic clock, nanoseconds."""
DeviceUs = NewType("DeviceUs", int)
"""Device's clock, microseconds since boot, wraps undone."""

_SPAN = 1 << 32
_HALF = 1 << 31


def extend_us(reference: DeviceUs, low32: int) -> DeviceUs:
    """The moment nearest to ``reference`` whose low 32 bits are ``low32``."""
    delta = (low32 - reference + _HALF) % _SPAN - _HALF
    return DeviceUs(reference + delta)
