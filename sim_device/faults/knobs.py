"""Knobs: the values that faults change. They are neutral, and computed again at every change."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class WireKnobs:
    """One direction of the line."""

    flips: float = 0.0
    """Share of bytes in which a bit is turned over."""
    loss: float = 0.0
    """Share of bytes that do not arrive."""
    duplicates: float = 0.0
    """Share of bytes after which the last ``duplicate_bytes`` come again."""
    duplicate_bytes: int = 0
    bursts: float = 0.0
    """Share of bytes at which a stretch of ``burst_bytes`` turns into noise."""
    burst_bytes: int = 0
    garbled: bool = False
    """Sampled at another rate than sent: nothing of it is what it was."""
    silent: bool = False
    """Nothing arrives."""
    latency_us: int = 0
    jitter_us: int = 0
    """Latency beyond ``latency_us``, uniform up to this."""


def either(a: float, b: float) -> float:
    """Return the probability of at least one of two independent events."""
    return 1.0 - (1.0 - a) * (1.0 - b)


@dataclass(frozen=True, slots=True)
class Walker:
    """A person who walks to and fro across the robot's path."""

    ahead_m: float
    """How far ahead of where the robot stood at the beginning."""
    reach_m: float
    """How far to either side."""
    speed_m_s: float
    radius_m: float


@dataclass(slots=True)
class Knobs:
    """Everything at once."""

    up: WireKnobs = field(default_factory=WireKnobs)
    """Device to host."""
    down: WireKnobs = field(default_factory=WireKnobs)
    """Host to device."""
    unplugged: bool = False

    stuck_left: bool = False
    stuck_right: bool = False
    slip_left: float = 0.0
    slip_right: float = 0.0
    lifted: bool = False
    moved: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Index of an obstacle → how far it is moved, metres."""
    walker: Walker | None = None

    imu_frozen: bool = False
    gyro_bias_deg_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias_g: tuple[float, float, float] = (0.0, 0.0, 0.0)
    encoder_dropout_left: float = 0.0
    encoder_dropout_right: float = 0.0
    encoder_reversed_left: bool = False
    encoder_reversed_right: bool = False
    encoders_swapped: bool = False
    i2c_stuck: bool = False
    imu_clock: float = 0.0
    """Share by which the inertial sensor's own clock runs fast."""
    adc_frozen: bool = False
    ultrasonic_blind: bool = False
    ultrasonic_lie_m: float | None = None
    bumper_stuck_left: bool = False
    bumper_stuck_right: bool = False

    drift_ppm: float = 0.0
    """Additional drift of the device's clock, ppm."""

    def wires(self, way: str) -> list[WireKnobs]:
        """Return the directions of ``way``: ``up``, ``down`` or ``both``."""
        return {"up": [self.up], "down": [self.down], "both": [self.up, self.down]}[way]

    def sides(self, side: str) -> list[str]:
        """The sides that ``side`` names: ``left``, ``right`` or ``both``."""
        return ["left", "right"] if side == "both" else [side]
