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
class CrashRecord:
    """What a fault handler keeps in memory that a reset does not clear."""

    pc: int
    """Program counter: the instruction that faulted."""
    lr: int
    """Link register: where its function was called from."""
    cfsr: int
    """Configurable fault status register (PM0214, section 4.4.10): what kind of fault."""
    uptime_us: int

    @property
    def text(self) -> str:
        """A line for the host."""
        return (
            f"crash after {self.uptime_us // 1000} ms: "
            f"pc 0x{self.pc:08x}, lr 0x{self.lr:08x}, cfsr 0x{self.cfsr:08x}"
        )


@dataclass(frozen=True, slots=True)
class Identity:
    """What tells this device and this boot from others."""

    node: int
    uid: bytes
    boot_id: int
    reset_cause: ResetCause = ResetCause.POWER_ON
    crash: CrashRecord | None = None
    """Of the life before, if it ended so."""
    crystal_failed: bool = False
    """The clock comes from the internal oscillator, which is no clock for a CAN bus."""

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
