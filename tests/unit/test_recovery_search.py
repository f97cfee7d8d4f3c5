"""The recovery planner's search on grids drawn by hand."""

from __future__ import annotations

import itertools
import math

import numpy as np

from bridge.coverage.recovery.choice import Chooser
from bridge.coverage.recovery.evidence import EvidenceMap
from bridge.coverage.recovery.lane_kernels import scan_lanes
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.travel_kernels import _clear_line, passable, travel, way_back
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel

QUEUE = np.zeros((64, 4096), dtype=np.int32)
FAR = 1 << 24
CELLS = np.zeros(1024, dtype=np.int32)


def floor(rows: int, cols: int) -> np.ndarray:
    return np.full((rows, cols), 2, dtype=np.uint8)


def reach(open_: np.ndarray, row: int, col: int, most: int = FAR) -> np.ndarray:
    dist = np.zeros(open_.shape, dtype=np.int32)
    travel(open_, row, col, most, dist, QUEUE)
    return dist


def test_travel_counts_straight_and_diagonal_steps() -> None:
    dist = reach(floor(20, 20), 5, 5)
    assert dist[5, 5] == 0
    assert dist[5, 15] == 100
    assert dist[15, 15] == 140
    assert dist[8, 15] == 3 * 14 + 7 * 10


def test_travel_goes_round_a_wall_and_not_through() -> None:
    open_ = floor(21, 21)
    open_[:, 10] = 0
    assert (reach(open_, 10, 5)[:, 11:] == -1).all()
    open_[0, 10] = 2
    dist = reach(open_, 10, 5)
    # up to the gap, through it, and down again: 10 rows each way, 10 columns
    assert dist[10, 15] == 10 * 14 + 10 * 10


def test_travel_stops_at_its_bound() -> None:
    dist = reach(floor(30, 30), 15, 15, 55)
    assert dist[15, 20] == 50
    assert dist[15, 21] == -1


def test_beside_a_wall_is_dear_and_the_wall_shut() -> None:
    near, lens, been = (np.zeros((9, 9), dtype=np.uint8) for _ in range(3))
    open_ = np.zeros((9, 9), dtype=np.uint8)
    near[4, 4] = 1
    passable(near, lens, been, open_)
    assert open_[4, 4] == 0
    assert open_[4, 5] == open_[3, 4] == 1
    assert open_[4, 6] == open_[3, 5] == 2
    been[4, 4] = 1
    passable(near, lens, been, open_)
    assert open_[4, 4] == 2  # the robot was there, whatever the evidence says


def test_the_way_has_few_corners_and_a_free_line_between_them() -> None:
    open_ = floor(40, 40)
    open_[10:, 20] = 0
    dist = reach(open_, 35, 5)
    corners = np.zeros((50, 2), dtype=np.int32)
    count = way_back(open_, dist, 35, 35, corners, CELLS)
    assert 3 <= count <= 6
    assert corners[0].tolist() == [35, 5]
    assert corners[count - 1].tolist() == [35, 35]
    for a, b in itertools.pairwise(corners[:count]):
        (r0, c0), (r1, c1) = a.tolist(), b.tolist()
        beside = max(abs(r1 - r0), abs(c1 - c0)) == 1
        assert beside or _clear_line(open_, r0, c0, r1, c1, 1)
    assert way_back(open_, np.full_like(dist, -1), 35, 35, corners, CELLS) == 0


def best_lane(target: np.ndarray, here: tuple[float, float]) -> list[float]:
    ways = np.zeros(target.shape, dtype=np.int32)
    row, col = np.indices(target.shape)
    ways[:] = 10 * np.hypot(row - here[0], col - here[1])
    best = np.zeros(8)
    # 20 cm/s, 1 s/rad, 1 s a stop, 2 cells an edge; rows along the heading
    prices = np.array([20.0, 1.0, 1.0, 2.0, 0.0])
    scan_lanes(target, ways, 7, 10, 3, here[0], here[1], 0.0, prices, best, np.zeros(target.shape[1], dtype=np.int32))
    return best.tolist()


def test_the_lane_beside_what_is_swept_is_taken_before_one_that_leaves_a_sliver() -> None:
    target = np.zeros((60, 100), dtype=np.uint8)
    target[10:50, 10:90] = 1
    score, row, first, last, backwards, new, *_ = best_lane(target, (10.0, 8.0))
    # rows 10 … 16 are seven cells wide and leave nothing below them
    assert (row, first, last, backwards) == (13, 10, 89, 0)
    assert new == 7 * 80
    assert score > 0.0


def test_a_lane_is_taken_from_its_nearer_end() -> None:
    target = np.zeros((60, 100), dtype=np.uint8)
    target[10:50, 10:90] = 1
    _, row, _, _, backwards, *_ = best_lane(target, (49.0, 95.0))
    assert row == 46
    assert backwards == 1


def test_nothing_left_is_no_choice() -> None:
    options = RecoveryOptions()
    memory = EvidenceMap(RobotModel(), options, Pose2(0.0, 0.0, 0.0))
    memory.swept[:] = 1
    assert Chooser(options).choose(memory, Pose2(0.0, 0.0, 0.0), 0.0) is None


def test_lanes_follow_the_walls_direction() -> None:
    options = RecoveryOptions()
    memory = EvidenceMap(RobotModel(), options, Pose2(0.0, 0.0, 0.0))
    choice = Chooser(options).choose(memory, Pose2(0.0, 0.0, 0.0), math.radians(30.0))
    assert choice is not None
    assert choice.kind == "lane"
    turned = math.remainder(choice.heading_rad - math.radians(30.0), 0.5 * math.pi)
    assert abs(turned) < 1e-9
