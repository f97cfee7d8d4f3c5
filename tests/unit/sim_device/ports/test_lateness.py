"""Percentiles of the lateness of periods, compared with percentiles of the sorted values."""

from __future__ import annotations

import numpy as np
import pytest

from sim_device.ports.real_time_loop import Lateness


@pytest.mark.parametrize("seed", range(5))
def test_percentiles_are_within_nine_percent(seed: int) -> None:
    values = np.random.default_rng(seed).lognormal(5.0, 1.5, 5000).astype(int)
    lateness = Lateness()
    for value in values.tolist():
        lateness.add(value)
    assert lateness.periods == 5000
    assert lateness.worst_us == values.max()
    for percent in (50.0, 90.0, 99.0, 99.5):
        true = float(np.percentile(values, percent, method="inverted_cdf"))
        assert true <= lateness.percentile_us(percent) <= true * 1.1 + 1.0


def test_the_ends() -> None:
    lateness = Lateness()
    assert lateness.percentile_us(99.0) == 0
    lateness.add(0)
    assert (lateness.percentile_us(99.0), lateness.worst_us) == (0, 0)
    lateness.add(10**12)
    assert lateness.worst_us == 10**12
    assert 0 < lateness.percentile_us(100.0) <= 10**12
