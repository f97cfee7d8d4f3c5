"""Coverage curves: coverage at multiples of the reference time, path and energy."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.evaluation.metrics import CoverageMeter, CoverageReport

    Track = Sequence[tuple[float, float, float, float]]

_PATH_STEP_M = 0.02
"""Minimum distance between two points of a drawn path, m."""
MULTIPLES = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0)
"""Multiples of the references at which curves have points. The reference time is sweepable area /
(W · cruise speed). The reference path is area / W. The reference energy is the reference time at
the power of the cruise speed. They are not lower bounds: the recovery planner drives faster than
the cruise speed, and a turn in place sweeps floor without path."""


def over_time(
    meter: CoverageMeter, report: CoverageReport, *, cut: bool = False
) -> list[float | None]:
    """Return the coverage at multiples of the reference time.

    After the end of the run the coverage is constant. If the run was ended before its planner had
    finished (``cut``), the coverage at later points is unknown: None.
    """
    times = [multiple * report.reference_time_s for multiple in MULTIPLES]
    shares = meter.share_at(report, times)
    return [
        None if cut and time > report.duration_s + 1e-6 else round(share, 4)
        for time, share in zip(times, shares, strict=True)
    ]


def over_energy(
    meter: CoverageMeter,
    report: CoverageReport,
    drawn: Sequence[tuple[float, float]],
    unit_wh: float,
    *,
    cut: bool = False,
) -> list[float | None]:
    """Return the coverage at multiples of the reference energy.

    Args:
        meter: the metric of the room.
        report: the metrics of the run.
        drawn: time since the first pose, s, and energy drawn until then, Wh, ascending.
        unit_wh: the reference energy, Wh.
        cut: the run was ended before its planner had finished.

    """
    times, energies = zip(*drawn, strict=True) if drawn else ((0.0,), (0.0,))
    final = meter.share_at(report, [report.duration_s + 1.0])[0]
    shares: list[float | None] = []
    for multiple in MULTIPLES:
        energy_wh = multiple * unit_wh
        if energy_wh > energies[-1]:
            shares.append(None if cut else round(final, 4))
        else:
            time_s = float(np.interp(energy_wh, energies, times))
            shares.append(round(meter.share_at(report, [time_s])[0], 4))
    return shares


def over_path(
    meter: CoverageMeter, report: CoverageReport, track: Track, *, cut: bool = False
) -> list[float | None]:
    """Return the coverage at multiples of the reference path; it does not depend on the speed."""
    steps = [math.dist(a[1:3], b[1:3]) for a, b in pairwise(track)]
    path_m = np.concatenate([[0.0], np.cumsum(steps)]) if track else np.zeros(1)
    begun = track[0][0] if track else 0.0
    unit_m = report.path_m / report.path_ratio if report.path_ratio > 0.0 else math.inf
    shares: list[float | None] = []
    for multiple in MULTIPLES:
        index = int(np.searchsorted(path_m, multiple * unit_m, side="right"))
        if index >= len(track):
            final = meter.share_at(report, [report.duration_s + 1.0])[0]
            shares.append(None if cut else round(final, 4))
        else:
            shares.append(round(meter.share_at(report, [track[index][0] - begun])[0], 4))
    return shares


def thinned(places: list[tuple[float, float]]) -> list[list[float]]:
    """Return a path without the points that are closer than ``_PATH_STEP_M``."""
    kept: list[list[float]] = []
    for x, y in places:
        if not kept or abs(x - kept[-1][0]) + abs(y - kept[-1][1]) >= _PATH_STEP_M:
            kept.append([round(x, 3), round(y, 3)])
    return kept
