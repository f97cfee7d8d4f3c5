"""Battery, logic rail and what the power monitor reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sim_device.noise import Draws, NoiseLevel
    from sim_device.plant import Plant

_SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True, slots=True)
class BatteryParameters:
    """A four-cell pack; its voltage falls in a straight line with its charge."""

    full_v: float = 16.0
    """Open-circuit voltage when full."""
    capacity_ah: float = 9.0
    empty_ratio: float = 0.85
    """Open-circuit voltage when empty, relative to full."""
    resistance_ohm: float = 0.15
    """Pack, connectors and wiring."""
    state_of_charge: float = 1.0
    """At power-on, 0..1."""


class Draw(NamedTuple):
    """What flowed out of the battery over some time."""

    charge_c: float
    energy_j: float


class Battery:
    """State of charge and terminal voltage."""

    __slots__ = ("_booked_c", "_p", "charge_ah", "current_a", "drawn_j")

    def __init__(self, parameters: BatteryParameters) -> None:
        """Start at the parameters' state of charge, with no current."""
        self._p = parameters
        self.charge_ah = parameters.capacity_ah * parameters.state_of_charge
        self.current_a = 0.0
        self.drawn_j = 0.0
        """Energy drawn at the terminals since power-on."""
        self._booked_c = 0.0

    @property
    def state_of_charge(self) -> float:
        """0..1."""
        return max(0.0, self.charge_ah / self._p.capacity_ah)

    @property
    def terminal_v(self) -> float:
        """Voltage under the present current."""
        p = self._p
        ratio = p.empty_ratio + (1.0 - p.empty_ratio) * self.state_of_charge
        return max(0.0, p.full_v * ratio - self.current_a * p.resistance_ohm)

    def draw(self, drawn: Draw) -> None:
        """Book what was drawn; the voltage stays until ``settle``."""
        self._booked_c += drawn.charge_c
        self.drawn_j += drawn.energy_j

    def settle(self, duration_s: float) -> None:
        """Let what was booked over a duration lower the charge and sag the voltage."""
        self.current_a = self._booked_c / duration_s
        self.charge_ah -= self._booked_c / _SECONDS_PER_HOUR
        self._booked_c = 0.0


class PowerReading(NamedTuple):
    """What the device's monitor measures."""

    battery_v: float
    rail_v: float
    """5 V logic rail."""
    left_a: float
    """Motor current; negative while it brakes."""
    right_a: float


_RAIL_V = 5.0
_RAIL_HEADROOM_V = 1.5
"""The linear regulator's dropout: below 6.5 V at the battery the rail falls with it."""


class PowerMonitor:
    """Reads the two rails and both motor currents."""

    __slots__ = ("_draws", "_noise", "_plant")

    def __init__(self, plant: Plant, noise: NoiseLevel, draws: Draws) -> None:
        """Watch ``plant``; ``draws`` is the monitor's own."""
        self._plant = plant
        self._noise = noise
        self._draws = draws

    def read(self) -> PowerReading:
        """One reading of all four."""
        supply_v = self._plant.supply_v
        left_a, right_a = self._plant.motor_currents_a
        rail_v = max(0.0, min(_RAIL_V, supply_v - _RAIL_HEADROOM_V))
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
