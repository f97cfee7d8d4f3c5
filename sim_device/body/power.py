"""Battery, logic rail and power monitor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from sim_device.noise import Draws, NoiseLevel

RAIL_V, RAIL_DROPOUT_V = 5.0, 1.5
"""Voltage and dropout of the logic rail, V. Below a battery voltage of 6.5 V the rail falls with
it."""
RAIL_WHOLE_V = RAIL_V + RAIL_DROPOUT_V
"""Battery voltage from which the logic rail has its full voltage, V."""
BRIDGE_LOGIC_V = 4.5
"""Minimum logic supply of the bridges, V; below it they are off. L298 datasheet, electrical
characteristics."""


@dataclass(frozen=True, slots=True)
class BatteryParameters:
    """A four-cell pack with a protection circuit; ``drive_kernel`` holds its state.

    The open-circuit voltage falls in a straight line with the charge down to the knee. Below the
    knee it falls steeply and the internal resistance grows, so a load pulls the voltage down
    further. At 0 the protection circuit opens: there is no voltage until the pack is charged. The
    terminal voltage is constant over each 10 ms and follows the current of the period before.
    """

    full_v: float = 16.0
    """Open-circuit voltage of the full pack, V."""
    capacity_ah: float = 9.0
    empty_ratio: float = 0.85
    """Open-circuit voltage of the empty pack without the knee, as a share of the full one."""
    resistance_ohm: float = 0.15
    """Resistance of pack, connectors and wiring, Ω."""
    state_of_charge: float = 1.0
    """State of charge at power-on, 0..1."""
    knee: float = 0.05
    """State of charge below which the voltage falls steeply."""
    knee_fall: float = 0.4
    """Share by which the voltage falls below the knee when empty. It leaves 8.2 V, about 2 V a
    cell, where protection circuits open."""
    knee_resistance: float = 4.0
    """Growth of the resistance when empty, as a multiple of the resistance."""


def rail_5v_v(supply_v: float) -> float:
    """Return the logic rail behind its linear regulator (78M05, 1.5 V of dropout)."""
    return max(0.0, min(RAIL_V, supply_v - RAIL_DROPOUT_V))


class PowerReading(NamedTuple):
    """One measurement of the device's power monitor."""

    battery_v: float
    rail_v: float
    """Voltage of the 5 V logic rail, V."""
    left_a: float
    """Current of the left motor, A; negative while it brakes."""
    right_a: float


class Powered(Protocol):
    """The supply that the monitor measures."""

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
        """Measure ``plant``; ``draws`` belongs to the monitor."""
        self._plant = plant
        self._noise = noise
        self._draws = draws

    def read(self) -> PowerReading:
        """Return one reading of all four quantities."""
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
            # the rail's divider is 1:2, the battery's 1:6
            max(0.0, rail_v + 0.3 * volt * normal()),
            left_a + amp * normal(),
            right_a + amp * normal(),
        )
