"""Counters for the device's own status and link reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable


class LineHealth(NamedTuple):
    """Counters of the link's queues and of its CAN controller, as in ``link_counters``."""

    receive_dropped: int = 0
    """Always 0: nothing sets it on the virtual device. The C firmware counts its own queue."""
    send_dropped: int = 0
    can_send_errors: int = 0
    can_receive_errors: int = 0
    can_bus_offs: int = 0


@dataclass(slots=True)
class Counters:
    """Counters since the boot."""

    line_health: Callable[[], LineHealth] = LineHealth
    """Function that returns the counters of the link's queues and of its CAN controller."""
    stale: int = 0
    """Number of rejected setpoints."""
    load_percent: int = 0
    """Busy share of the last ten control periods, %."""
