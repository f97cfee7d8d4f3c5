"""What a device is to its line, its faults and its port, whatever runs its firmware."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from protocol.messages.values import ResetCause
    from sim_device.body.plant import Plant, Truth
    from sim_device.device.clock import DeviceClock
    from sim_device.sensors.sensors import SensorSuite


class RiggedDevice(Protocol):
    """A body with sensors and a firmware: ``VirtualSweeper``, or one with a chip of its own.

    Times passed in are microseconds since the device was first switched on.
    """

    plant: Plant
    sensors: SensorSuite
    clock: DeviceClock

    def step(self, data: bytes, now_us: int) -> bytes:
        """Live until ``now_us``, then take ``data``; give what the device writes meanwhile."""

    def next_deadline_us(self) -> int:
        """When the device has something to do next, bytes aside."""

    @property
    def truth(self) -> Truth:
        """What is really so."""

    def reset(self, cause: ResetCause, off_s: float = 0.0) -> None:
        """Reset the chip where the body stands."""

    def hang(self) -> None:
        """Let the firmware stand still until its watchdog resets it."""

    def crash(self) -> None:
        """Let the processor fault: it keeps a record of where, and resets."""

    def fail_crystal(self, drift_ppm: float) -> None:
        """Let the crystal stop: the chip resets and goes on by its own oscillator."""
