"""Power supply of the motors: battery, logic rail and L298N bridges, and the energy balance."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device.body.battery import BatteryParameters
from sim_device.body.drive_kernel import TICK_S, discharge_battery, sag, switch
from sim_device.body.truth import EnergyBalance

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from sim_device.body.drive_kernel import Body

BROWN_OUT_V = 4.0
"""Brown-out voltage of the 5 V rail, V. At this voltage the 3.3 V supply falls below brown-out
level 3 (2.7 to 3.6 V in RM0090, section 5.2.3), and the chip stays in reset."""
SUPPLY_GOOD_V = 4.3
"""Voltage of the 5 V rail at which a brown-out ends, V."""


class Supply:
    """The duties, and the battery's values in the kernel's ``Body``."""

    __slots__ = ("_body", "left", "right")

    def __init__(self, battery: BatteryParameters | None, model: RobotModel, body: Body) -> None:
        """Write the battery's values into ``body``; the default battery is the model's battery."""
        battery = battery or BatteryParameters(full_v=model.battery_v, capacity_ah=model.battery_ah)
        self._body = b = body
        b.full_v, b.capacity_ah = battery.full_v, battery.capacity_ah
        b.empty_ratio, b.battery_ohm = battery.empty_ratio, battery.resistance_ohm
        b.knee, b.knee_fall = battery.knee, battery.knee_fall
        b.knee_resistance = battery.knee_resistance
        self.left = self.right = 0.0
        """Duties of the bridges, -1..1 each."""
        self.set_charge(battery.state_of_charge)

    @property
    def state_of_charge(self) -> float:
        """State of charge, 0..1."""
        return self._body.charge_ah / self._body.capacity_ah

    @property
    def bridges_v(self) -> tuple[float, float]:
        """Voltages of the left and the right motor after the bridge, V."""
        switch(self.left, self.right, self._body)
        return self._body.left.volt, self._body.right.volt

    def set_charge(self, fraction: float) -> None:
        """Set the battery's charge, 0..1; at 0 it has no voltage."""
        discharge_battery(self._body)
        self._body.charge_ah = self._body.capacity_ah * min(1.0, max(0.0, fraction))
        sag(self._body)

    def energy(self) -> EnergyBalance:
        """Energy balance of the battery up to the present tick."""
        b = self._body
        electronics_c = b.electronics_a * (b.tick - b.settled_ms) * TICK_S
        open_c = b.drawn_c - b.settled_c + electronics_c
        supply_v = b.supply_v
        return EnergyBalance(
            b.battery_j + open_c * supply_v,
            b.internal_j + open_c * (b.open_v - supply_v),
            b.electronics_j + electronics_c * supply_v,
            b.bridge_j,
            b.winding_j,
            b.shaft_j,
        )
