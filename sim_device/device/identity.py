"""The identity that the virtual device reports."""

from __future__ import annotations

from dataclasses import dataclass

from protocol.messages.device import Hello
from protocol.messages.values import Capability, ResetCause

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

    def hello(self, catalogue_hash: int, session_id: int, *, keyed: bool) -> Hello:
        """Return the device's hello; ``keyed`` means that motion commands must be signed."""
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
