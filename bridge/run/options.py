"""What a host may be told before its run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.motion.geometry import Pose2
from protocol.uart.link import Link

if TYPE_CHECKING:
    from protocol.link import LinkBase

_ORIGIN = Pose2(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class HostOptions:
    """What a run may be told beforehand."""

    unix_offset_ns: int
    """Unix time less the host's monotonic clock."""
    planner: str = ""
    start: Pose2 = _ORIGIN
    """Where the robot stands at first, in the frame of the map."""
    node: int | None = None
    link: type[LinkBase] = Link
    """What the device is connected by."""
    key: bytes | None = field(default=None, repr=False)
    """Signs what moves the robot, where the device asks for it."""
    min_delay_ns: tuple[int, int] = (0, 0)
    """Declared: no frame to the device, none from it is quicker (:class:`TimeSync`)."""
