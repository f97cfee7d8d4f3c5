"""The gyro at rest: its bias, how sure that is, and how it wanders. Pure."""

from __future__ import annotations

import math
from statistics import fmean, stdev
from typing import TYPE_CHECKING, NamedTuple

from bridge.errors import BridgeError

if TYPE_CHECKING:
    from collections.abc import Sequence

MIN_SAMPLES = 100
BLOCK_S = 1.0
REST_RAD_S = math.radians(20.0)
"""Greatest rate at rest by the data sheet (PS-MPU-6000A-00, section 6.1)."""
SHAKEN_RAD_S = math.radians(0.5)
"""Of one reading: ten times the chip's noise at 100 Hz is a robot that is touched."""


class AxisBias(NamedTuple):
    """One axis at rest; rad/s."""

    name: str
    bias_rad_s: float
    sure_rad_s: float
    """Standard error of the bias, from means over a second: noise of neighbours is related."""
    wander_rad_s: float
    """Greatest less least of those means."""


def biases(samples: Sequence[tuple[float, tuple[float, float, float]]]) -> tuple[AxisBias, ...]:
    """x, y and z from readings at rest, each with the device's time (s).

    Raises:
        BridgeError: too few readings, or the robot did not stand still.

    """
    if len(samples) < MIN_SAMPLES:
        raise BridgeError(f"only {len(samples)} readings of the gyro; {MIN_SAMPLES} are needed")
    found = []
    for index, name in enumerate("xyz"):
        values = [rates[index] for _, rates in samples]
        bias, sigma = fmean(values), stdev(values)
        means = _blocks(samples, index)
        wander = max(means) - min(means)
        if sigma > SHAKEN_RAD_S:
            shown = math.degrees(sigma)
            raise BridgeError(
                f"the robot was moved: {name} strays by {shown:.2f} °/s; let it stand"
            )
        sure = stdev(means) / math.sqrt(len(means)) if len(means) > 1 else sigma
        found.append(AxisBias(name, bias, sure, wander))
    return tuple(found)


def complaint(axis: AxisBias) -> str | None:
    """What is wrong with a bias, if anything."""
    if abs(axis.bias_rad_s) <= REST_RAD_S:
        return None
    return (
        f"{axis.name} tells {math.degrees(axis.bias_rad_s):+.1f} °/s at rest; the data sheet "
        "allows 20: does the robot stand still? else the chip is broken"
    )


def _blocks(samples: Sequence[tuple[float, tuple[float, float, float]]], index: int) -> list[float]:
    start_s = samples[0][0]
    blocks: dict[int, list[float]] = {}
    for t_s, rates in samples:
        blocks.setdefault(int((t_s - start_s) / BLOCK_S), []).append(rates[index])
    longest = max(len(values) for values in blocks.values())
    return [fmean(values) for values in blocks.values() if len(values) > longest // 2]
