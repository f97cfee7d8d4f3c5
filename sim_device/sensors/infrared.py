"""Triangulating infrared ranger: one diffuse beam, a voltage, and the firmware's inverse.

Source: Sharp GP2Y0A41SK0F, sheet OP13008EN, electro-optical characteristics: 0.4 V at 30 cm
and 2.25 V more at 4 cm (white paper, 90 %), 4 to 30 cm. With the optics' V = A/(d + B) these
give A = 0.1225 V·m and B = 6.2 mm. What follows from it:

- the noise is the voltage's: its sigma in distance grows as (d + B)²;
- closer than ``PEAK_SHARE`` of the least range the light's spot leaves the detector and the
  voltage falls again: a wall at 2 cm reads like one at 5.5 cm, nearer ones farther still.
  Between the peak and the least range it reads the least range;
- a darker wall sends back less light: more noise, as the root of it, and a range too long by
  ``DARK_ERROR`` of itself per unit of reflectance (2 % for the 18 % grey card against the white
  one, the distance between their curves in the datasheet's figure).

The firmware's curve is that of white paper and of this very part ("after calibration"). The
16.5 ms that a measurement takes are below the period of its readings and left out.
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
"""Share of the minimum range at which the voltage is highest: 3.2 cm of 4 cm in the figure."""
DARK_ERROR = 0.03
_SIGMA_AT_M = 0.10
_NO_LIGHT_V = 0.02
"""Voltage below which the inverse is undefined, V; it is beyond 6 m."""


def volts(distance_m: float, peak_m: float) -> float:
    """Output for white paper at a distance; it folds back nearer than ``peak_m``."""
    if distance_m >= peak_m:
        return GAIN_V_M / (distance_m + OFFSET_M)
    return GAIN_V_M / (peak_m + OFFSET_M) * distance_m / peak_m


def metres(output_v: float) -> float:
    """Invert the voltage as the firmware does, beyond the peak; ``inf``: no light."""
    return GAIN_V_M / output_v - OFFSET_M if output_v > _NO_LIGHT_V else math.inf


def sigma_v(sigma_m: float) -> float:
    """Voltage noise of which a wall of white paper at 10 cm makes ``sigma_m``."""
    return sigma_m * GAIN_V_M / (_SIGMA_AT_M + OFFSET_M) ** 2


class Reflectances:
    """How bright each edge of the room is, drawn once in the edges' order, and remembered."""

    __slots__ = ("_drawn", "_draws", "_spread")

    def __init__(self, noise: NoiseLevel, draws: Draws) -> None:
        """``draws`` is its own."""
        self._spread, self._draws = noise.infrared_reflectance_spread, draws
        self._drawn: list[float] = []

    def of(self, edge: int) -> float:
        """Reflectance of an edge, 0..1; -1, a walker, is as dark as the level has it."""
        if edge < 0:
            return WHITE_PAPER - self._spread
        while edge >= len(self._drawn):
            self._drawn.append(WHITE_PAPER - self._spread * self._draws.uniform())
        return self._drawn[edge]


class Infrared:
    """One ranger at its mount."""

    __slots__ = ("_draws", "_mount", "_peak_m", "_sigma_v", "reflectances")

    def __init__(
        self, mount: RangerMount, noise: NoiseLevel, draws: Draws, reflectances: Reflectances
    ) -> None:
        """``draws`` may be shared with the ranger on the other side: one value a reading."""
        self._mount, self._draws, self.reflectances = mount, draws, reflectances
        self._peak_m = PEAK_SHARE * mount.min_range_m
        self._sigma_v = sigma_v(noise.infrared_sigma_m)

    def reading(self, exact_m: float, edge: int) -> float | None:
        """What it reads with the beam's end at ``exact_m`` on an edge; ``None``: out of range."""
        normal = self._draws.normal()
        if exact_m == math.inf:
            return None
        reflectance = self.reflectances.of(edge)
        seen_m = exact_m * (1.0 + DARK_ERROR * (WHITE_PAPER - reflectance))
        noise_v = self._sigma_v * math.sqrt(WHITE_PAPER / reflectance) * normal
        range_m = metres(volts(seen_m, self._peak_m) + noise_v)
        mount = self._mount
        return None if range_m > mount.max_range_m else max(range_m, mount.min_range_m)
