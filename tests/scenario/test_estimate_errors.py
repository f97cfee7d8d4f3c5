"""Consistency of the host's covariance near walls: whole stack, both noise levels.

For each noise level there are ten whole runs. Each run counts as one value, because its samples are
correlated. The mean NEES of (x, y, yaw) varies by about 1.1 between runs, so the mean of ten runs
has a standard error of 0.35. The bounds are half and one and a half times the ideal value: a
covariance three times too large or too small exceeds them. `python -m bench.consistency` measures
larger rooms.
"""

from __future__ import annotations

import functools
import statistics

import numpy as np
import pytest

from support.estimate_errors import (
    Reported,
    anees,
    average,
    estimate_errors,
    share_inside,
    yaw_anees,
)
from support.selection import seeds
from support.sim_body import box, room

pytestmark = pytest.mark.slow

ROOM = room((0.3, 0.3, 0.0), walls=box(0.0, 0.0, 1.7, 1.4), obstacles=(box(0.85, 0.65, 1.2, 1.0),))
"""Room that takes about two minutes: perimeter, lanes, and a box that the robot passes around."""
RUNS = 10
LEVELS = ("typical", "harsh")


@functools.cache
def reported(noise: str, seed: int) -> tuple[Reported, ...]:
    """Return the errors of one run, which is driven once for all callers."""
    return tuple(estimate_errors(ROOM, noise, seed, every_s=5.0))


@pytest.mark.parametrize("noise", LEVELS)
@pytest.mark.parametrize("seed", seeds(1, RUNS - 1))
def test_no_run_is_far_from_its_own_estimate(noise: str, seed: int) -> None:
    run = reported(noise, seed)
    assert len(run) > 10
    assert 0.2 < statistics.fmean(t.nees for t in run) < 10.0


CONSERVATIVE = pytest.mark.xfail(strict=True, reason="σ is about twice the error")


@pytest.mark.nightly
@pytest.mark.parametrize("noise", [pytest.param("typical", marks=CONSERVATIVE), "harsh"])
def test_the_covariance_among_walls_is_right_within_a_factor_of_two(noise: str) -> None:
    runs = [reported(noise, seed) for seed in range(RUNS)]
    whole, yaw = anees(runs), yaw_anees(runs)
    assert 1.5 < whole.mean < 4.5, f"NEES of x, y, yaw: {whole}, 3 is right"
    assert 0.5 < yaw.mean < 2.0, f"of the yaw alone: {yaw}, 1 is right"
    assert share_inside(runs) > 0.85, "95 % should lie in the ellipse of 95 %"


# ---- tests of the measure itself ----------------------------------------------------------


def drawn(factor: float) -> list[list[Reported]]:
    """Return errors drawn from a covariance; the reported covariance is ``factor`` times larger."""
    rng = np.random.default_rng(5)
    mix = np.array([[0.02, 0.0, 0.0], [0.005, 0.01, 0.0], [0.001, -0.002, 0.006]])
    true = mix @ mix.T
    return [
        [Reported(float(i), mix @ rng.normal(size=3), factor * true) for i in range(30)]
        for _ in range(RUNS)
    ]


def test_errors_of_the_very_covariance_have_a_nees_of_3() -> None:
    runs = drawn(1.0)
    assert anees(runs).mean == pytest.approx(3.0, abs=0.35)
    assert yaw_anees(runs).mean == pytest.approx(1.0, abs=0.2)
    assert share_inside(runs) == pytest.approx(0.95, abs=0.03)
    assert anees(drawn(4.0)).mean == pytest.approx(0.25 * anees(runs).mean)


def test_the_interval_is_the_runs_own_spread() -> None:
    """The interval is Student's t for 3 degrees of freedom (3.182) times 1.291 / √4."""
    assert average([1.0, 2.0, 3.0, 4.0]) == pytest.approx((2.5, 3.182 * 1.291 / 2.0), abs=1e-3)


def test_the_truth_has_the_time_of_the_sample() -> None:
    """Without noise 3 mm and 0.6° remain. A truth 20 ms too late adds 1.5 mm, and 2° in a turn."""
    run = estimate_errors(ROOM, "none", 1, every_s=0.5)
    off = np.abs([t.error for t in run])
    assert np.median(np.hypot(off[:, 0], off[:, 1])) < 0.003
    assert np.degrees(off[:, 2].max()) < 0.8
    # This is the spread that turns and lanes cause, without the slow drift. A truth 20 ms too late
    # has 1.7°.
    yaw = np.array([t.error[2] for t in run])
    drift = [np.median(yaw[max(k - 5, 0) : k + 6]) for k in range(len(yaw))]
    assert np.degrees(np.percentile(np.abs(yaw - drift), 95)) < 0.5
