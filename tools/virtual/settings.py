"""What a test asks a virtual sweeper to be."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Settings:
    """What a virtual sweeper is made with, in a process of its own or in the test's."""

    room: str = "case-1"
    """One that ships with the project, or a path."""
    noise: str = "typical"
    seed: int = 0
    faults: tuple[str, ...] = ()
    """``kind@time[:for][:args]``; times in seconds since the device booted."""
    node: int = 1
    link: str = "pty"
    """``pty``, ``tcp``, ``slcan`` or ``udpcan``; in virtual time only: serial or CAN."""
