"""Properties of a virtual device, for any kind of firmware."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.uart.link import Link

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel
    from protocol.link import LinkBase
    from sim_device.sweeper import VirtualSweeper


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Properties of a device."""

    plan: FloorPlan
    model: RobotModel
    seed: int
    """Seed of everything random."""
    noise: str
    """Name of the noise level."""
    node: int = 1
    """Node number, 1 to 15."""
    boot_id: int | None = None
    """Boot id; None: it follows from the seed."""
    link: type[LinkBase] = Link
    """UART or CAN."""
    local: bool = True
    """True if only a host beside the robot can reach the link."""
    key: bytes | None = None
    """Key of authenticated motion; None: none."""


def python_sweeper(wanted: Wanted) -> VirtualSweeper:
    """Make a device with the firmware's model in Python."""
    # The device may run its own planner. A later import would delay a control period.
    import bridge.coverage.recovery.planner  # noqa: F401 - imported in advance
    from sim_device.sweeper import VirtualSweeper

    device = VirtualSweeper(
        wanted.plan,
        wanted.model,
        seed=wanted.seed,
        noise=wanted.noise,
        node=wanted.node,
        link=wanted.link,
        boot_id=wanted.boot_id,
        local=wanted.local,
    )
    device.flash.key = wanted.key
    device.firmware.keyring.take()
    return device
