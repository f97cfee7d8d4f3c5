"""Gyro bias at standstill, its standard error and its drift. No I/O."""

from __future__ import annotations

import math
from statistics import fmean, stdev
from typing import TYPE_CHECKING, NamedTuple

from bridge.errors import BridgeError

if TYPE_CHECKING:
    from collections.abc import Sequence

MIN_SAMPLES = 100
"""Minimum number of samples for a bias."""
BLOCK_S = 1.0
"""Duration of a block of samples, s. The standard error is computed from the blocks' means."""
REST_RAD_S = math.radians(20.0)
"""Maximum gyro rate at standstill, rad/s (data sheet PS-MPU-6000A-00, section 6.1)."""
MOVED_RAD_S = math.radians(0.5)
"""Standard deviation of the rate above which the robot was moved, rad/s. It is ten times the noise
at 100 Hz."""


class AxisBias(NamedTuple):
    """Bias of one axis."""

    name: str
    bias_rad_s: float
    sigma_rad_s: float
    """Standard error of the bias, rad/s. It is from means over 1 s, because consecutive samples are
    correlated."""
    range_rad_s: float
    """Difference between the largest and the smallest of these means, rad/s."""


def biases(samples: Sequence[tuple[float, tuple[float, float, float]]]) -> tuple[AxisBias, ...]:
    """Return the biases of x, y and z. Each sample at standstill has its device time (s).

    Raises:
        BridgeError: there are too few samples, or the robot was moved.

    """
    if len(samples) < MIN_SAMPLES:
        raise BridgeError(f"only {len(samples)} gyro samples; {MIN_SAMPLES} are needed")
    found = []
    for index, name in enumerate("xyz"):
        values = [rates[index] for _, rates in samples]
        bias, sigma = fmean(values), stdev(values)
        means = _blocks(samples, index)
        if sigma > MOVED_RAD_S:
            shown = math.degrees(sigma)
            raise BridgeError(
                f"the robot was moved: the {name} rate varies by {shown:.2f} °/s; keep it still"
            )
        error = stdev(means) / math.sqrt(len(means)) if len(means) > 1 else sigma
        found.append(AxisBias(name, bias, error, max(means) - min(means)))
    return tuple(found)


def complaint(axis: AxisBias) -> str | None:
    """Return why a bias is implausible; None if it is plausible."""
    if abs(axis.bias_rad_s) <= REST_RAD_S:
        return None
    return (
        f"{axis.name} reads {math.degrees(axis.bias_rad_s):+.1f} °/s at standstill, but the data "
        "sheet allows 20; check that the robot does not move, else replace the chip"
    )


def _blocks(samples: Sequence[tuple[float, tuple[float, float, float]]], index: int) -> list[float]:
    start_s = samples[0][0]
    blocks: dict[int, list[float]] = {}
    for t_s, rates in samples:
        blocks.setdefault(int((t_s - start_s) / BLOCK_S), []).append(rates[index])
    longest = max(len(values) for values in blocks.values())
    return [fmean(values) for values in blocks.values() if len(values) > longest // 2]
