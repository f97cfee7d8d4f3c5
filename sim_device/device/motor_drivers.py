"""The motor drivers' enable input: on in a driving mode, off when a stopped robot is at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device.device.modes import DeviceState

if TYPE_CHECKING:
    from sim_device.device.wheel_control import WheelControl

_STOPPED = DeviceState.STOPPED
_RESTING = frozenset({DeviceState.STOPPED, DeviceState.IDLE})
"""States without motion. In these states the motor drivers are disabled when the robot is at
rest."""
_STEP = 0.5e-4
"""Smallest duty that is not rounded to 0: half of the PWM timer's resolution of 1e-4."""
BRAKE_TICKS = 50
"""Number of control periods for which the motors continue to brake at rest after a latched stop:
0.5 s. Without braking, the robot would roll down a slope."""


class MotorDrivers:
    """Enables and disables the motor drivers; disabled at boot."""

    def __init__(self) -> None:
        self.enabled = False
        self._rest_ticks = 0

    def switch(self, state: DeviceState, duties: tuple[float, float], wheels: WheelControl) -> None:
        """Enable the drivers in a driving mode; disable them when a stopped robot is at rest.

        In idle they are disabled at once, and in a latched stop after ``BRAKE_TICKS``.
        """
        if state not in _RESTING:
            self.enabled, self._rest_ticks = True, 0
        elif self.enabled:
            left, right = duties
            rests = abs(left) < _STEP and abs(right) < _STEP and not wheels.moving
            self._rest_ticks = self._rest_ticks + 1 if rests else 0
            brake_ticks = BRAKE_TICKS if state is _STOPPED else 1
            self.enabled = self._rest_ticks < brake_ticks
