"""Options of a host."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.motion.geometry import Pose2
from protocol.uart.link import Link

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.estimation.tuning import EstimationTuning
    from protocol.link import LinkBase

_ORIGIN = Pose2(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class HostOptions:
    """Options of a host, set before its run."""

    unix_offset_ns: int
    """Unix time minus the host's monotonic clock, ns."""
    planner: str = ""
    """Name of the planner in the log; empty: no planner."""
    start: Pose2 = _ORIGIN
    """Start pose in the map frame."""
    node: int | None = None
    """Node of the device; None: the only device that answers."""
    link: type[LinkBase] = Link
    """Framing of the device's port: serial or CAN."""
    key: bytes | None = field(default=None, repr=False)
    """Key that signs motion commands if the device requires signed commands."""
    min_delay_ns: tuple[int, int] = (0, 0)
    """Declared minimum delays to and from the device, ns (:class:`TimeSync`)."""
    estimation: EstimationTuning | None = None
    """Tuned constants of the estimation; None: the defaults."""
    plan: FloorPlan | None = None
    """Room that the measured walls are compared with; None: unknown."""
