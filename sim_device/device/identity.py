"""The identity that the virtual device reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.messages.device import Hello
from protocol.messages.values import Capability, ResetCause

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

NAME = "virtual sweeper"
VERSION = (0, 2, 0)
CAPABILITIES = (
    Capability.ENCODERS
    | Capability.IMU
    | Capability.ULTRASONIC
    | Capability.INFRARED
    | Capability.BUMPER
    | Capability.CLIFF
    | Capability.ONBOARD_PLANNER
)


def capabilities_of(model: RobotModel) -> Capability:
    """Return the capabilities of a robot, without those of sensors that are not fitted."""
    missing = Capability(0)
    if not model.ultrasonic.fitted:
        missing |= Capability.ULTRASONIC
    if not (model.infrared_left.fitted or model.infrared_right.fitted):
        missing |= Capability.INFRARED
    return CAPABILITIES & ~missing


@dataclass(frozen=True, slots=True)
class CrashRecord:
    """Record that the fault handler stores in memory that a reset does not clear."""

    pc: int
    """Program counter: address of the instruction that faulted."""
    lr: int
    """Link register: return address of the faulting function."""
    cfsr: int
    """Configurable fault status register (PM0214, section 4.4.10): the kind of fault."""
    uptime_us: int

    @property
    def text(self) -> str:
        """Return a line for the host."""
        return (
            f"crash after {self.uptime_us // 1000} ms: "
            f"pc 0x{self.pc:08x}, lr 0x{self.lr:08x}, cfsr 0x{self.cfsr:08x}"
        )


@dataclass(frozen=True, slots=True)
class Identity:
    """Identifies this device and this boot."""

    node: int
    uid: bytes
    boot_id: int
    reset_cause: ResetCause = ResetCause.POWER_ON
    crash: CrashRecord | None = None
    """Crash that ended the previous boot, if any."""
    crystal_failed: bool = False
    """True: the chip runs on its internal oscillator, which is too inaccurate for a CAN bus."""
    capabilities: Capability = CAPABILITIES
    """Connected parts and features."""

    def hello(self, catalogue_hash: int, session_id: int, *, keyed: bool) -> Hello:
        """Return the device's hello; ``keyed`` means that motion commands must be signed."""
        capabilities = self.capabilities | (Capability.AUTHENTICATION if keyed else 0)
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
