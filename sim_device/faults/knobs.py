"""Knobs: the values that faults change. Each change starts again from neutral values."""

from __future__ import annotations

from dataclasses import dataclass, field

from sim_device.sensors.faults import SensorFaultValues


@dataclass(slots=True)
class WireKnobs:
    """Faults of one direction of the link."""

    flips: float = 0.0
    """Share of bytes with one inverted bit, 0..1."""
    loss: float = 0.0
    """Share of bytes that are lost, 0..1."""
    duplicates: float = 0.0
    """Share of bytes after which the last ``duplicate_bytes`` bytes are repeated, 0..1."""
    duplicate_bytes: int = 0
    bursts: float = 0.0
    """Share of bytes at which a burst starts, 0..1: the next ``burst_bytes`` bytes become noise."""
    burst_bytes: int = 0
    garbled: bool = False
    """True: sender and receiver have different baud rates, and no byte arrives intact."""
    silent: bool = False
    """True: nothing arrives."""
    latency_us: int = 0
    jitter_us: int = 0
    """Maximum latency in addition to ``latency_us``, µs, uniformly distributed."""


def either(a: float, b: float) -> float:
    """Return the probability of at least one of two independent events."""
    return 1.0 - (1.0 - a) * (1.0 - b)


@dataclass(frozen=True, slots=True)
class Walker:
    """A person who walks back and forth across the robot's path."""

    ahead_m: float
    """Distance of the walker's path ahead of the robot's initial place, m."""
    reach_m: float
    """Distance that the walker goes to either side, m."""
    speed_m_s: float
    radius_m: float


@dataclass(frozen=True, slots=True)
class Carry:
    """Place where a lifted robot is put down, relative to its old place; room frame."""

    dx_m: float
    dy_m: float
    turn_deg: float


@dataclass(slots=True)
class Knobs(SensorFaultValues):
    """All knobs: the sensor faults, and the attributes below."""

    up: WireKnobs = field(default_factory=WireKnobs)
    """Faults from device to host."""
    down: WireKnobs = field(default_factory=WireKnobs)
    """Faults from host to device."""
    unplugged: bool = False
    bus_off: bool = False
    """True: the device's CAN controller is in the bus-off state."""

    stuck_left: bool = False
    stuck_right: bool = False
    slip_left: float = 0.0
    slip_right: float = 0.0
    carry: Carry | None = None
    """Place where the robot is put down after it was carried."""
    moved: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Displacement of each moved obstacle by its index, (dx, dy) in m."""
    walker: Walker | None = None

    drift_ppm: float = 0.0
    """Additional drift of the device's clock, ppm."""

    def wires(self, way: str) -> list[WireKnobs]:
        """Return the knobs of the direction ``way``: ``up``, ``down`` or ``both``."""
        return {"up": [self.up], "down": [self.down], "both": [self.up, self.down]}[way]

    def sides(self, side: str) -> list[str]:
        """Return the list of sides for ``left``, ``right`` or ``both``."""
        return ["left", "right"] if side == "both" else [side]
