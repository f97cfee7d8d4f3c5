"""Quadrature encoders: absolute 16-bit counts of the wheel angles; the counts wrap."""

from __future__ import annotations

from math import floor, pi
from typing import TYPE_CHECKING

from sim_device.sensors.faults import CountDropout, Miswiring

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from sim_device.body.plant import Plant
    from sim_device.sensors.faults import SensorFaults

_MASK = 0xFFFF
_TAU = 2.0 * pi


class EncoderCounters:
    """Both counters; they are 0 at power-on and increase in forward motion.

    They also count the turns of a slipping wheel. The plant models the errors of the wheels
    (diameter, slip).
    """

    __slots__ = (
        "_before",
        "_counts_per_rad",
        "_dropouts",
        "_faults",
        "_lossy",
        "_plant",
        "_wiring",
    )

    def __init__(self, plant: Plant, model: RobotModel, faults: SensorFaults) -> None:
        """Count ``model.counts_per_turn`` per turn of ``plant``'s wheels; apply ``faults``."""
        self._plant, self._faults = plant, faults
        self._counts_per_rad = model.counts_per_turn / _TAU
        self._dropouts = CountDropout(), CountDropout()
        self._lossy = False
        """True after a fault has caused lost counts."""
        self._before: tuple[int, int] | None = None
        self._wiring: Miswiring | None = None
        """State of the encoder wiring faults; None before the first wiring fault."""

    def read(self) -> tuple[int, int]:
        """Return the left and the right counter, 0..65535."""
        felt, per_rad, faults = self._plant.felt, self._counts_per_rad, self._faults
        # An encoder edge is between two counts; the counter is the number of passed edges.
        counts = floor(felt[3] * per_rad) & _MASK, floor(felt[4] * per_rad) & _MASK
        if faults.encoder_dropout_left or faults.encoder_dropout_right or self._lossy:
            counts = self._lose(*counts)
        else:
            self._before = counts
        miswired = (
            faults.encoder_reversed_left or faults.encoder_reversed_right or faults.encoders_swapped
        )
        if self._wiring is None:
            if not miswired:
                return counts
            self._wiring = Miswiring(counts)
        return self._wiring.apply(counts, faults)

    def _lose(self, left: int, right: int) -> tuple[int, int]:
        faults, (lost_left, lost_right) = self._faults, self._dropouts
        if not self._lossy and self._before is not None:
            lost_left.before, lost_right.before = self._before
        self._lossy = True
        return (
            lost_left.apply(left, faults.encoder_dropout_left),
            lost_right.apply(right, faults.encoder_dropout_right),
        )
