"""What feeds the motors: battery, logic rail and the L298N bridges, with their bookkeeping."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device import drive_kernel as k
from sim_device.drive_kernel import TICK_S
from sim_device.power import (
    BRIDGE_LOGIC_V,
    RAIL_DROPOUT_V,
    RAIL_V,
    Battery,
    BatteryParameters,
    rail_5v_v,
)
from sim_device.truth import EnergyBalance

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from bridge.motion.robot_model import RobotModel
    from sim_device.motors import MotorParameters

    Floats = NDArray[np.float64]


class Supply:
    """Gives the kernel its voltages, and books what it drew."""

    def __init__(
        self,
        battery: BatteryParameters | None,
        model: RobotModel,
        motor: MotorParameters,
        electronics_w: float,
        parameters: Floats,
    ) -> None:
        """Write voltages into the kernel's ``parameters``; the battery defaults to the model's."""
        self.battery = Battery(
            battery or BatteryParameters(full_v=model.battery_v, capacity_ah=model.battery_ah),
        )
        self._drop_v = model.driver_drop_v
        self._motor = motor
        self._electronics_w = electronics_w
        self._p = parameters
        self._left = self._right = 0.0
        self._settled_ms, self._settled_c = 0, 0.0
        self._electronics_j = 0.0
        self.supply_v = self.left_v = self.right_v = self._electronics_a = 0.0
        self.renew()

    def set_duty(self, left: float, right: float) -> None:
        """Switch the bridges, -1..1 each."""
        if left != self._left or right != self._right:
            self._left, self._right = left, right
            self.renew()

    def renew(self) -> None:
        """Work out the voltages anew: the duty or the battery changed."""
        supply_v = self.supply_v = self.battery.terminal_v
        # Below the regulator's dropout the rail's load takes less.
        self._electronics_a = self._electronics_w / max(supply_v, RAIL_V + RAIL_DROPOUT_V)
        if supply_v == 0.0:
            self._electronics_a = 0.0
        left, right = self._left, self._right
        if rail_5v_v(supply_v) < BRIDGE_LOGIC_V:
            left = right = 0.0
        terminal_v, drop_v = self._motor.terminal_v, self._drop_v
        self.left_v = terminal_v(left, supply_v, drop_v)
        self.right_v = terminal_v(right, supply_v, drop_v)
        p = self._p
        p[k.SUPPLY_V] = supply_v
        p[k.DUTY_L], p[k.DUTY_R] = left, right
        p[k.VOLT_L], p[k.VOLT_R] = self.left_v, self.right_v

    def settle(self, tick_ms: int, drawn_c: float) -> None:
        """Let the battery feel what was drawn since the last time.

        Args:
            tick_ms: Now.
            drawn_c: By the motors since power-on.

        """
        duration_s = (tick_ms - self._settled_ms) * TICK_S
        electronics_c = self._electronics_a * duration_s
        self._electronics_j += electronics_c * self.supply_v
        self.battery.draw(drawn_c - self._settled_c + electronics_c, duration_s)
        self._settled_ms, self._settled_c = tick_ms, drawn_c
        self.renew()

    def set_charge(self, fraction: float, tick_ms: int, drawn_c: float) -> None:
        """Make the battery that full; what was drawn so far is booked before."""
        if tick_ms > self._settled_ms:
            self.settle(tick_ms, drawn_c)
        self.battery.set_charge(fraction)
        self.renew()

    def energy(self, tick_ms: int, state: list[float]) -> EnergyBalance:
        """Where the battery's energy went, what is not settled yet included."""
        electronics_c = self._electronics_a * (tick_ms - self._settled_ms) * TICK_S
        open_c = state[k.DRAWN_C] - self._settled_c + electronics_c
        battery = self.battery
        return EnergyBalance(
            battery.drawn_j + open_c * self.supply_v,
            battery.internal_j + open_c * (battery.open_v - self.supply_v),
            self._electronics_j + electronics_c * self.supply_v,
            state[k.BRIDGE_J],
            state[k.WINDING_J],
            state[k.SHAFT_J],
        )
