"""Compiled loops over a raster, compared with handmade pictures and with a brute-force search."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.evaluation.holes import depth_cells
from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.robot_model import RobotModel

if TYPE_CHECKING:
    from numpy.typing import NDArray


def drawn(*rows: str) -> NDArray[np.bool_]:
    return np.array([[cell == "#" for cell in row] for row in rows])


def test_depth_is_counted_to_the_nearest_cell_outside() -> None:
    assert depth_cells(drawn("...", "...")) == 0.0
    # the cells beyond the edge count as outside
    assert depth_cells(drawn("###", "###", "###")) == 2.0
    hole = np.ones((9, 9), dtype=np.bool_)
    hole[4, 4] = False
    assert depth_cells(hole) == pytest.approx(math.sqrt(8.0))  # two cells off in x and y


def test_depth_is_that_of_a_search_of_all_pairs() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        mask = rng.random((11, 14)) < 0.9
        padded = np.pad(mask, 1)
        inside, outside = np.argwhere(padded), np.argwhere(~padded)
        apart = np.linalg.norm(inside[:, None] - outside[None, :], axis=2)
        assert depth_cells(mask) == pytest.approx(float(apart.min(axis=1).max()))


def test_reading_intermediate_figures_does_not_change_the_result() -> None:
    room = '{"name": "a", "walls": [[0,0],[2,0],[2,2],[0,2]], "obstacles": [], "start": [0.5,1,0]}'
    meter = CoverageMeter(parse_floorplan(room), RobotModel())
    path = [(0.02 * i, 0.5 + 0.004 * i, 1.0, 0.0) for i in range(251)]
    track = meter.track()
    shares = []
    for i, pose in enumerate(path):
        track.add(*pose)
        if i % 50 == 0:
            shares.append(track.report().coverage.mouth_free)
    assert shares == sorted(shares)
    # one metre with the mouth width of 0.16 m, as a share of 4 m²
    assert shares[-1] == pytest.approx(0.04, abs=5e-4)
    report = meter.measure(path)
    assert shares[-1] == pytest.approx(report.coverage.mouth_free, abs=1e-4)
    assert report.path_m == pytest.approx(1.0)
