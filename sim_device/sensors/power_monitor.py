"""Power monitor: voltages of battery and logic rail, and currents of both motors."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from sim_device.noise import Draws, NoiseLevel


class PowerReading(NamedTuple):
    """One measurement of the device's power monitor."""

    battery_v: float
    rail_v: float
    """Voltage of the 5 V logic rail, V."""
    left_a: float
    """Current of the left motor, A; negative while the motor brakes."""
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
        """Measure ``plant``; no other object may use ``draws``."""
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
            # the rail's voltage divider is 1:2, the battery's divider 1:6
            max(0.0, rail_v + 0.3 * volt * normal()),
            left_a + amp * normal(),
            right_a + amp * normal(),
        )
