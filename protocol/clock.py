"""Types for the two clocks of a link; a type checker rejects mixing them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NewType, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

HostNs = NewType("HostNs", int)
"""Host's monotonic clock, ns."""
DeviceUs = NewType("DeviceUs", int)
"""Device's clock, µs since boot, with wraps undone."""

Stamps = TypeVar("Stamps", int, "NDArray[np.int64]")
"""A stamp, or an array of stamps, µs."""

_SPAN = 1 << 32
_HALF = 1 << 31


def elapsed_us(since_us: Stamps, until_us: Stamps) -> Stamps:
    """Return the microseconds from one stamp to another, by their low 32 bits.

    The result is negative for an earlier stamp. It is valid for stamps less than 35 minutes apart.
    """
    return (until_us - since_us + _HALF) % _SPAN - _HALF


def extend_us(reference: DeviceUs, low32: int) -> DeviceUs:
    """Extend a 32-bit stamp to the time nearest to ``reference`` with these low bits."""
    return DeviceUs(reference + elapsed_us(reference, low32))
