"""Settings of a virtual sweeper in a test."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SweeperSettings:
    """Properties of a virtual sweeper, in a child process or in the process of the test."""

    room: str = "case-1"
    """Name of a shipped room, or path of a room file."""
    noise: str = "typical"
    """Noise level: ``none``, ``paper``, ``typical`` or ``harsh``."""
    seed: int = 0
    """Seed of everything random."""
    faults: tuple[str, ...] = ()
    """Faults, ``kind@time[:for][:args]``; times in seconds since the device booted."""
    node: int = 1
    """Node number of the device, 1 to 15."""
    link: str = "pty"
    """``pty``, ``tcp``, ``slcan`` or ``udpcan``. In virtual time it only selects UART or CAN."""
    target: str = "python"
    """Firmware of the device: the model in Python, or ``core``, the C firmware."""
    firmware: str | None = None
    """Firmware library to run instead of the C core; None: the C core of sweepctl."""

    def __post_init__(self) -> None:
        """Check the combination.

        Raises:
            ValueError: a firmware library without the target that runs it.

        """
        if self.firmware is not None and self.target != "core":
            raise ValueError(f"firmware={self.firmware!r} needs target='core'")
