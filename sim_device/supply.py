"""What feeds the motors: battery, logic rail and the L298N bridges, with their bookkeeping."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device import drive_kernel as k
from sim_device.drive_kernel import TICK_S
from sim_device.power import (
    BRIDGE_LOGIC_V,
    RAIL_WHOLE_V,
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

_SUPPLY_V, _DUTY_L, _DUTY_R, _VOLT_L, _VOLT_R = k.SUPPLY_V, k.DUTY_L, k.DUTY_R, k.VOLT_L, k.VOLT_R


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
        self._electronics_j = self._electronics_a = 0.0
        self._left_v = self._right_v = 0.0
        self.stale = True
        """Whether the duty or the battery changed since the voltages were worked out."""
        self.renew()

    def set_duty(self, left: float, right: float) -> None:
        """Switch the bridges, -1..1 each."""
        if left != self._left or right != self._right:
            self._left, self._right = left, right
            self.stale = True

    @property
    def supply_v(self) -> float:
        """The battery's voltage under its load."""
        return self.battery.terminal_v

    @property
    def bridges_v(self) -> tuple[float, float]:
        """Left and right voltage behind the bridge."""
        if self.stale:
            self.renew()
        return self._left_v, self._right_v

    def renew(self) -> None:
        """Work out the voltages and tell the kernel; to be done while they are ``stale``."""
        self.stale = False
        supply_v = self.battery.terminal_v
        left, right = self._left, self._right
        if supply_v >= RAIL_WHOLE_V:
            self._electronics_a = self._electronics_w / supply_v
        else:  # the rail's load takes less
            self._electronics_a = self._electronics_w / RAIL_WHOLE_V if supply_v > 0.0 else 0.0
            if rail_5v_v(supply_v) < BRIDGE_LOGIC_V:
                left = right = 0.0
        terminal_v, drop_v, p = self._motor.terminal_v, self._drop_v, self._p
        p[_SUPPLY_V] = supply_v
        p[_DUTY_L] = left
        p[_DUTY_R] = right
        p[_VOLT_L] = self._left_v = terminal_v(left, supply_v, drop_v)
        p[_VOLT_R] = self._right_v = terminal_v(right, supply_v, drop_v)

    def settle(self, tick_ms: int, drawn_c: float) -> None:
        """Let the battery feel what was drawn since the last time.

        Args:
            tick_ms: Now.
            drawn_c: By the motors since power-on.

        """
        battery = self.battery
        duration_s = (tick_ms - self._settled_ms) * TICK_S
        electronics_c = self._electronics_a * duration_s
        self._electronics_j += electronics_c * battery.terminal_v
        battery.draw(drawn_c - self._settled_c + electronics_c, duration_s)
        self._settled_ms = tick_ms
        self._settled_c = drawn_c
        self.stale = True

    def set_charge(self, fraction: float, tick_ms: int, drawn_c: float) -> None:
        """Make the battery that full; what was drawn so far is booked before."""
        if tick_ms > self._settled_ms:
            self.settle(tick_ms, drawn_c)
        self.battery.set_charge(fraction)
        self.stale = True

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
