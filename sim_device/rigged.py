"""Interface of a device (with any kind of firmware) for link, faults and port."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from protocol.messages.values import ResetCause
    from sim_device.body.plant import Plant, Truth
    from sim_device.device.clock import DeviceClock
    from sim_device.line.device_end import DeviceEnd
    from sim_device.sensors.sensors import SensorSuite


class RiggedDevice(Protocol):
    """A plant with sensors and a firmware: ``VirtualSweeper``, or a device with its own chip.

    Times are microseconds since the device was first switched on.
    """

    plant: Plant
    sensors: SensorSuite
    clock: DeviceClock
    cannot: Mapping[str, str]
    """Kinds of fault that the device rejects, each with the reason."""

    def step(self, data: bytes, now_us: int) -> bytes:
        """Advance to ``now_us``, then receive ``data``; return the bytes that the device sends."""

    def attach_line(self, end: DeviceEnd) -> None:
        """Use the counters of this end of the link; ignored by a chip with its own counters."""

    def next_deadline_us(self) -> int:
        """Return the time of the device's next work if it receives no bytes."""

    @property
    def truth(self) -> Truth:
        """Return the true state."""

    def reset(self, cause: ResetCause, off_s: float = 0.0) -> None:
        """Reset the chip; the plant does not change."""

    def hang(self) -> None:
        """Freeze the firmware until its watchdog resets it."""

    def crash(self) -> None:
        """Cause a processor fault. The chip stores a crash record and resets."""

    def fail_crystal(self, drift_ppm: float) -> None:
        """Stop the crystal. The chip resets and then uses its internal oscillator."""
