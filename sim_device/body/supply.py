"""What feeds the motors: battery, logic rail and the L298N bridges, with their bookkeeping."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device.body import drive_kernel as k
from sim_device.body.drive_kernel import TICK_S, switch
from sim_device.body.power import BatteryParameters
from sim_device.body.slow_kernel import sag, settle
from sim_device.body.truth import EnergyBalance

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from bridge.motion.robot_model import RobotModel

    Floats = NDArray[np.float64]


class Supply:
    """The duties, and the part of the kernels' body that is the battery's."""

    __slots__ = ("_body", "left", "right")

    def __init__(self, battery: BatteryParameters | None, model: RobotModel, body: Floats) -> None:
        """Write the battery into the ``body``; it defaults to the model's."""
        battery = battery or BatteryParameters(full_v=model.battery_v, capacity_ah=model.battery_ah)
        self._body = b = body
        b[k.FULL_V], b[k.CAPACITY_AH] = battery.full_v, battery.capacity_ah
        b[k.EMPTY_RATIO], b[k.OHM] = battery.empty_ratio, battery.resistance_ohm
        b[k.KNEE], b[k.KNEE_FALL] = battery.knee, battery.knee_fall
        b[k.KNEE_OHM] = battery.knee_resistance
        self.left = self.right = 0.0
        """How the bridges are switched, -1..1 each."""
        self.set_charge(battery.state_of_charge)

    @property
    def state_of_charge(self) -> float:
        """0..1."""
        return float(self._body[k.CHARGE_AH] / self._body[k.CAPACITY_AH])

    @property
    def bridges_v(self) -> tuple[float, float]:
        """Left and right voltage behind the bridge."""
        switch(self.left, self.right, self._body)
        return float(self._body[k.VOLT_L]), float(self._body[k.VOLT_R])

    def set_charge(self, fraction: float) -> None:
        """Make the battery that full (limited to 0..1); what was drawn is booked before."""
        settle(self._body)
        self._body[k.CHARGE_AH] = self._body[k.CAPACITY_AH] * min(1.0, max(0.0, fraction))
        sag(self._body)

    def energy(self, state: list[float]) -> EnergyBalance:
        """Where the battery's energy went, what is not settled yet included.

        ``state`` is the body's, as it is now.
        """
        open_ms = state[k.TICK] - state[k.SETTLED_MS]
        electronics_c = state[k.ELECTRONICS_A] * open_ms * TICK_S
        open_c = state[k.DRAWN_C] - state[k.SETTLED_C] + electronics_c
        supply_v = state[k.SUPPLY_V]
        return EnergyBalance(
            state[k.BATTERY_J] + open_c * supply_v,
            state[k.INTERNAL_J] + open_c * (state[k.OPEN_V] - supply_v),
            state[k.ELECTRONICS_J] + electronics_c * supply_v,
            state[k.BRIDGE_J],
            state[k.WINDING_J],
            state[k.SHAFT_J],
        )
