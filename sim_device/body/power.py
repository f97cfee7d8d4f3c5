"""Battery, logic rail and what the power monitor reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from sim_device.noise import Draws, NoiseLevel

RAIL_V, RAIL_DROPOUT_V = 5.0, 1.5
"""Voltage and dropout of the logic rail, V: below 6.5 V at the battery it falls with it."""
RAIL_WHOLE_V = RAIL_V + RAIL_DROPOUT_V
"""At the battery: from here on the logic rail has all its voltage."""
BRIDGE_LOGIC_V = 4.5
"""L298 datasheet, electrical characteristics: least logic supply; below it the bridges are off."""


@dataclass(frozen=True, slots=True)
class BatteryParameters:
    """A four-cell pack with a protection circuit; ``drive_kernel`` has its state.

    The open-circuit voltage falls in a straight line with the charge down to the knee, and
    steeply below it, where the internal resistance grows as well: a load then sags what is
    left. At 0 the pack's protection opens: no voltage at all, until it is charged. Over each
    10 ms the terminals' voltage is constant: it follows the current of those before.
    """

    full_v: float = 16.0
    """Open-circuit voltage when full."""
    capacity_ah: float = 9.0
    empty_ratio: float = 0.85
    """Open-circuit voltage when empty, relative to full, were it not for the knee."""
    resistance_ohm: float = 0.15
    """Pack, connectors and wiring."""
    state_of_charge: float = 1.0
    """At power-on, 0..1."""
    knee: float = 0.05
    """State of charge below which the voltage falls steeply ..."""
    knee_fall: float = 0.4
    """Share by which the voltage falls when empty: 8.2 V, about 2 V a cell, where protection
    circuits open."""
    knee_resistance: float = 4.0
    """Growth of the resistance at 0, as a multiple of itself."""


def rail_5v_v(supply_v: float) -> float:
    """Give the logic rail behind its linear regulator (78M05, 1.5 V of dropout)."""
    return max(0.0, min(RAIL_V, supply_v - RAIL_DROPOUT_V))


class PowerReading(NamedTuple):
    """What the device's monitor measures."""

    battery_v: float
    rail_v: float
    """5 V logic rail."""
    left_a: float
    """Motor current; negative while it brakes."""
    right_a: float


class Powered(Protocol):
    """What the monitor is connected to."""

    @property
    def supply_v(self) -> float:
        """Voltage of the battery's terminals."""

    @property
    def rail_5v_v(self) -> float:
        """Voltage of the logic rail."""

    @property
    def motor_currents_a(self) -> tuple[float, float]:
        """Currents of the left and the right motor."""


class PowerMonitor:
    """Reads the two rails and both motor currents."""

    __slots__ = ("_draws", "_noise", "_plant")

    def __init__(self, plant: Powered, noise: NoiseLevel, draws: Draws) -> None:
        """Watch ``plant``; ``draws`` is the monitor's own."""
        self._plant = plant
        self._noise = noise
        self._draws = draws

    def read(self) -> PowerReading:
        """One reading of all four."""
        supply_v = self._plant.supply_v
        left_a, right_a = self._plant.motor_currents_a
        rail_v = self._plant.rail_5v_v
        normal, volt, amp = (
            self._draws.normal,
            self._noise.voltage_sigma_v,
            self._noise.current_sigma_a,
        )
        return PowerReading(
            max(0.0, supply_v + volt * normal()),
            max(0.0, rail_v + 0.3 * volt * normal()),  # its divider is 1:2, the battery's 1:6
            left_a + amp * normal(),
            right_a + amp * normal(),
        )
