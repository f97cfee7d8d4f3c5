"""Quadrature encoders: absolute counts of the wheels' angles, 16 bits, wrapping."""

from __future__ import annotations

from math import floor, pi
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from sim_device.plant import Plant

_MASK = 0xFFFF
_TAU = 2.0 * pi


class Encoders:
    """Both counters, zero at power-on and rising forwards.

    They count what the wheels turn: a slipping wheel counts too. Errors of the wheels
    themselves (diameter, slip) are the plant's.
    """

    __slots__ = ("_counts_per_rad", "_plant")

    def __init__(self, plant: Plant, model: RobotModel) -> None:
        """Count ``model.counts_per_turn`` per turn of ``plant``'s wheels."""
        self._plant = plant
        self._counts_per_rad = model.counts_per_turn / _TAU

    def read(self) -> tuple[int, int]:
        """Left and right counter, 0..65535."""
        left_rad, right_rad = self._plant.wheel_angles_rad
        per_rad = self._counts_per_rad
        # An edge lies between two counts: the counter holds the whole counts passed.
        return floor(left_rad * per_rad) & _MASK, floor(right_rad * per_rad) & _MASK
