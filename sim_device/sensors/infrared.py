"""Infrared ranger (triangulation): one beam, its output voltage, and the firmware's conversion.

Source: Sharp GP2Y0A41SK0F, sheet OP13008EN, electro-optical characteristics: range 4 to 30 cm; 0.4
V at 30 cm and 2.25 V more at 4 cm (white paper, 90 % reflectance). The optics give V = A/(d + B)
for the distance d, so A = 0.1225 V·m and B = 6.2 mm. Consequences:

- The noise is constant in voltage, so the sigma in distance grows as (d + B)².
- Below ``PEAK_SHARE`` of the minimum range, the light spot leaves the detector and the voltage
  falls again. A wall at 2 cm gives the reading of a wall at 5.5 cm; a closer wall gives a greater
  reading. Between this peak and the minimum range, the reading is the minimum range.
- A darker wall reflects less light. The noise grows with the square root of this loss. The reading
  is too long by the share ``DARK_ERROR`` of the range per unit of missing reflectance. A grey card
  (18 %) reads 2 % longer than white paper, as in the datasheet's figure.

The firmware converts with the white-paper curve of this individual sensor (as after a calibration).
A measurement takes 16.5 ms. This is less than the period of the readings, so the model omits the
delay.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim_device.noise import WHITE_PAPER

if TYPE_CHECKING:
    from bridge.motion.robot_model import RangerMount
    from sim_device.noise import Draws, NoiseLevel

_NEAR_M, _NEAR_V, _FAR_M, _FAR_V = 0.04, 2.65, 0.30, 0.40
OFFSET_M = (_FAR_V * _FAR_M - _NEAR_V * _NEAR_M) / (_NEAR_V - _FAR_V)
GAIN_V_M = _FAR_V * (_FAR_M + OFFSET_M)
PEAK_SHARE = 0.8
"""Distance with the highest voltage, as a share of the minimum range: 3.2 cm of 4 cm in the
datasheet's figure."""
DARK_ERROR = 0.03
_SIGMA_AT_M = 0.10
_NO_LIGHT_V = 0.02
"""Voltage below which no distance is computed, V; it corresponds to more than 6 m."""


def volts(distance_m: float, peak_m: float) -> float:
    """Return the output voltage for white paper at a distance; it falls again below ``peak_m``."""
    if distance_m >= peak_m:
        return GAIN_V_M / (distance_m + OFFSET_M)
    return GAIN_V_M / (peak_m + OFFSET_M) * distance_m / peak_m


def metres(output_v: float) -> float:
    """Return the firmware's distance for a voltage, beyond the peak; ``inf``: no reflection."""
    return GAIN_V_M / output_v - OFFSET_M if output_v > _NO_LIGHT_V else math.inf


def sigma_v(sigma_m: float) -> float:
    """Return the voltage noise that gives ``sigma_m`` for a wall of white paper at 10 cm."""
    return sigma_m * GAIN_V_M / (_SIGMA_AT_M + OFFSET_M) ** 2


class Reflectances:
    """Reflectance of each edge of the room, drawn once in the order of the edges."""

    __slots__ = ("_drawn", "_draws", "_spread")

    def __init__(self, noise: NoiseLevel, draws: Draws) -> None:
        """Store ``draws``, which no other object may use."""
        self._spread, self._draws = noise.infrared_reflectance_spread, draws
        self._drawn: list[float] = []

    def of(self, edge: int) -> float:
        """Return the reflectance of an edge, 0..1; the walker (-1) has the level's minimum."""
        if edge < 0:
            return WHITE_PAPER - self._spread
        while edge >= len(self._drawn):
            self._drawn.append(WHITE_PAPER - self._spread * self._draws.uniform())
        return self._drawn[edge]


class Infrared:
    """One infrared ranger at its mount."""

    __slots__ = ("_draws", "_mount", "_peak_m", "_sigma_v", "reflectances")

    def __init__(
        self, mount: RangerMount, noise: NoiseLevel, draws: Draws, reflectances: Reflectances
    ) -> None:
        """Use one value of ``draws`` per reading; both infrared rangers may share ``draws``."""
        self._mount, self._draws, self.reflectances = mount, draws, reflectances
        self._peak_m = PEAK_SHARE * mount.min_range_m
        self._sigma_v = sigma_v(noise.infrared_sigma_m)

    def reading(self, exact_m: float, edge: int) -> float | None:
        """Return the reading for a beam that ends at ``exact_m`` on an edge, m.

        ``None``: out of range.
        """
        normal = self._draws.normal()
        if exact_m == math.inf:
            return None
        reflectance = self.reflectances.of(edge)
        seen_m = exact_m * (1.0 + DARK_ERROR * (WHITE_PAPER - reflectance))
        noise_v = self._sigma_v * math.sqrt(WHITE_PAPER / reflectance) * normal
        range_m = metres(volts(seen_m, self._peak_m) + noise_v)
        mount = self._mount
        return None if range_m > mount.max_range_m else max(range_m, mount.min_range_m)
