"""Who the virtual device says that it is."""

from __future__ import annotations

from dataclasses import dataclass

from protocol.messages.device import Hello
from protocol.messages.values import Capability, ResetCause

NAME = "virtual sweeper"
VERSION = (0, 1, 0)
CAPABILITIES = (
    Capability.ENCODERS
    | Capability.IMU
    | Capability.ULTRASONIC
    | Capability.INFRARED
    | Capability.BUMPER
    | Capability.CLIFF
    | Capability.ONBOARD_PLANNER
)


@dataclass(frozen=True, slots=True)
class Identity:
    """What tells this device and this boot from others."""

    node: int
    uid: bytes
    boot_id: int
    reset_cause: ResetCause = ResetCause.POWER_ON

    def hello(self, catalogue_hash: int, session_id: int, *, keyed: bool) -> Hello:
        """Its hello; ``keyed``: only signed motion is obeyed."""
        capabilities = CAPABILITIES | Capability.AUTHENTICATION if keyed else CAPABILITIES
        return Hello(
            catalogue_hash,
            self.uid,
            self.boot_id,
            session_id,
            self.reset_cause,
            int(capabilities),
            *VERSION,
            NAME,
        )
