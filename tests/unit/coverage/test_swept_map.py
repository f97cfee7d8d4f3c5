"""The live map of the swept floor: its marks, its growth, its export."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bridge.coverage.swept_map import SWEPT, UNKNOWN, SweptMap
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel

MODEL = RobotModel()


def test_a_lane_marks_its_band_without_gaps() -> None:
    swept = SweptMap(MODEL)
    for k in range(501):
        swept.update(Pose2(0.004 * k, 0.01, 0.0))
    grid = swept.to_occupancy()
    rows, columns = np.nonzero(grid.cells == SWEPT)
    assert set(np.unique(grid.cells)) == {UNKNOWN, SWEPT}
    xs = grid.origin_x_m + columns * 0.02
    ys = grid.origin_y_m + rows * 0.02
    assert xs.min() == pytest.approx(0.0, abs=0.021)
    assert xs.max() == pytest.approx(2.0, abs=0.021)
    assert ys.min() == pytest.approx(-0.07, abs=0.021)
    band = grid.cells[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert (band == SWEPT).all()
    assert swept.swept_m2 == pytest.approx(2.0 * 0.16, rel=0.15)


def test_missed_updates_are_joined_and_a_jump_is_not() -> None:
    swept = SweptMap(MODEL)
    swept.update(Pose2(0.0, 0.0, 0.0))
    swept.update(Pose2(0.3, 0.0, 0.0))
    joined = swept.swept_m2
    assert joined > 0.3 * 0.15
    swept.update(Pose2(3.0, 0.0, 0.0))
    assert swept.swept_m2 < joined + 0.16 * 0.05


def test_turning_in_place_marks_a_disc() -> None:
    swept = SweptMap(MODEL)
    for k in range(200):
        swept.update(Pose2(1.0, 1.0, math.remainder(0.02 * k, math.tau)))
    assert swept.swept_m2 == pytest.approx(math.pi * 0.08**2, rel=0.3)


def test_it_grows_in_every_direction_and_keeps_its_marks() -> None:
    swept = SweptMap(MODEL)
    places = [(0.0, 0.0), (7.0, 0.0), (-7.0, 3.0), (1.0, -8.0), (0.5, 9.0)]
    for x, y in places:
        swept.update(Pose2(x, y, 0.3))
    grid = swept.to_occupancy()
    for x, y in places:
        row = math.floor((y - grid.origin_y_m) / 0.02)
        column = math.floor((x - grid.origin_x_m) / 0.02)
        assert (grid.cells[row - 1 : row + 2, column - 1 : column + 2] == SWEPT).any()
    assert (grid.cells == SWEPT).sum() <= 5 * 9


def test_export_is_a_copy_and_its_revision_shows_changes() -> None:
    swept = SweptMap(MODEL)
    assert swept.to_occupancy().cells.size == 0
    swept.update(Pose2(0.0, 0.0, 0.0))
    first = swept.to_occupancy()
    revision = swept.revision
    swept.update(Pose2(0.0005, 0.0, 0.0))
    assert swept.revision == revision
    swept.update(Pose2(0.1, 0.0, 0.0))
    assert swept.revision > revision
    assert (first.cells == SWEPT).sum() < (swept.to_occupancy().cells == SWEPT).sum()


def test_a_pose_beyond_all_bounds_is_dropped() -> None:
    swept = SweptMap(MODEL)
    swept.update(Pose2(0.0, 0.0, 0.0))
    before = swept.to_occupancy()
    swept.update(Pose2(1e6, -1e6, 0.0))
    swept.update(Pose2(math.nan, 0.0, 0.0))
    after = swept.to_occupancy()
    assert np.array_equal(after.cells, before.cells)
    assert after[1:] == before[1:]
    swept.update(Pose2(0.1, 0.0, 0.0))
    assert (swept.to_occupancy().cells == SWEPT).sum() > 0


def test_what_was_covered_since_the_last_confirmation_can_be_removed() -> None:
    swept = SweptMap(MODEL)
    swept.update(Pose2(0.0, 0.0, 0.0))
    swept.update(Pose2(0.4, 0.0, 0.0))
    swept.confirm()
    before_m2, cells = swept.swept_m2, swept.to_occupancy().cells.copy()
    swept.update(Pose2(0.4, 0.3, 0.0))
    swept.update(Pose2(-3.0, 0.3, 0.0))  # the map grows
    revision = swept.revision
    removed_m2 = swept.swept_m2 - before_m2
    assert removed_m2 > 0.0
    assert swept.revert() == pytest.approx(removed_m2)
    assert swept.swept_m2 == pytest.approx(before_m2)
    assert swept.revision > revision
    assert (swept.to_occupancy().cells >= 0).sum() == (cells >= 0).sum()
    assert swept.revert() == 0.0
