"""The recovery planner's search on handmade grids."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.coverage.recovery.lane_kernels import BestLane, LaneCosts, scan_lanes
from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.search import Chooser
from bridge.coverage.recovery.travel_kernels import (
    RING,
    TravelSearch,
    clear_line,
    trace_path,
    travel,
)
from bridge.coverage.recovery.window import Buffers, SearchWindow
from bridge.coverage.recovery.window_kernels import (
    CELL_WEIGHT,
    GIVEN_UP,
    OCCUPIED,
    SWEPT,
    BestPerimeter,
    PerimeterCosts,
    copy_window,
    keep_holes,
    mark_targets,
    scan_perimeters,
    weigh_pieces,
)
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST
from support.recovery import choose

if TYPE_CHECKING:
    from bridge.motion.observation import Observation

QUEUE = np.zeros((RING, 4096), dtype=np.int32)
FAR = 1 << 24
CELLS = np.zeros(1024, dtype=np.int32)


def floor(rows: int, cols: int) -> np.ndarray:
    """Return a free floor with a closed border, like a window of the map."""
    open_ = np.zeros((rows, cols), dtype=np.uint8)
    open_[1:-1, 1:-1] = 2
    return open_


def reach(
    open_: np.ndarray, row: int, col: int, maximum: int = FAR, budget: int = 1 << 30
) -> np.ndarray:
    dist = np.full(open_.shape, -1, dtype=np.int32)
    counts = np.zeros(RING, dtype=np.int32)
    dist[row, col] = 0
    QUEUE[0, 0] = row * open_.shape[1] + col
    search = TravelSearch()
    search.waiting = counts[0] = 1
    cells = (open_.ravel(), open_.shape[1])
    while not travel(*cells, maximum, budget, dist.ravel(), QUEUE, counts, search)[1]:
        pass
    dist[dist > maximum] = -1
    return dist


def test_travel_counts_straight_and_diagonal_steps() -> None:
    dist = reach(floor(20, 20), 5, 5)
    assert dist[5, 5] == 0
    assert dist[5, 15] == 100
    assert dist[15, 15] == 140
    assert dist[8, 15] == 3 * 14 + 7 * 10


def test_travel_goes_round_a_wall_and_not_through() -> None:
    open_ = floor(23, 23)
    open_[:, 11] = 0
    assert (reach(open_, 11, 6)[:, 12:] == -1).all()
    open_[1, 11] = 2
    dist = reach(open_, 11, 6)
    # The path goes up to the gap, through it, and down again: 10 rows in each direction, 10
    # columns.
    assert dist[11, 16] == 10 * 14 + 10 * 10


def test_travel_stops_at_its_bound() -> None:
    dist = reach(floor(30, 30), 15, 15, 55)
    assert dist[15, 20] == 50
    assert dist[15, 21] == -1


def test_travel_in_slices_finds_the_same() -> None:
    open_ = floor(40, 40)
    open_[10:30, 20] = 0
    open_[5:10, 5:20] = 1
    assert (reach(open_, 20, 10, budget=7) == reach(open_, 20, 10)).all()


def window(**layers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``open_`` and ``done`` for the inner 9 × 9 cells of a map of 11 × 11 cells."""
    empty = np.zeros((11, 11), dtype=np.uint8)
    inflated, blocked, visited, swept, wall, attempts = (
        layers.get(name, empty)
        for name in ("inflated", "blocked", "visited", "swept", "wall", "attempts")
    )
    open_, done = np.zeros((9, 9), dtype=np.uint8), np.zeros((9, 9), dtype=np.uint8)
    copy_window(inflated, blocked, visited, swept, wall, attempts, 2, 1, 1, open_, done)
    return open_, done


def at(row: int, col: int, value: int = 1) -> np.ndarray:
    """Return a map of 11 × 11 cells with one mark, at a cell of the inner 9 × 9."""
    layer = np.zeros((11, 11), dtype=np.uint8)
    layer[row + 1, col + 1] = value
    return layer


def test_beside_a_wall_is_dear_and_the_wall_shut() -> None:
    open_, _ = window(inflated=at(4, 4))
    assert open_[4, 4] == 0
    assert open_[4, 5] == open_[3, 4] == 1
    assert open_[4, 6] == open_[3, 5] == 2
    assert not open_[0].any()
    assert not open_[:, 8].any()
    open_, _ = window(inflated=at(4, 4), visited=at(4, 4))
    assert open_[4, 4] == 2  # the robot was there, so the cell is free


def test_the_reason_identifies_the_action() -> None:
    _, done = window(swept=at(2, 2), attempts=at(3, 3, 2), wall=at(4, 4, 2))
    assert (done[2, 2], done[3, 3], done[4, 4]) == (SWEPT, GIVEN_UP, OCCUPIED)
    _, done = window(attempts=at(3, 3), wall=at(4, 4))
    assert not done.any()  # one fruitless attempt or one reading is not enough


def test_targets_are_cells_that_the_mouth_reaches() -> None:
    dist = np.full((30, 30), -1, dtype=np.int32)
    dist[10:20, 10:20] = 50
    dist[12, 12] = 200
    done = np.zeros((30, 30), dtype=np.uint8)
    done[15, 15] = SWEPT
    target, ways = np.zeros((30, 30), dtype=np.uint8), np.zeros((30, 30), dtype=np.int32)
    count = mark_targets(dist, 100, done, target, ways, 12)
    row, col = np.indices(dist.shape)
    off_row, off_col = np.clip(row, 10, 19) - row, np.clip(col, 10, 19) - col
    expected = (off_row**2 + off_col**2 <= 12) & (done == 0)
    assert (target.astype(bool) == expected).all()  # neighbours reach the farther cell
    assert count == expected.sum()
    assert (ways[12, 12], ways[10, 10], ways[9, 9]) == (-1, 50, -1)


def test_the_perimeter_pass_begins_beside_the_unswept_wall() -> None:
    open_ = floor(40, 40)
    open_[:8] = 0
    open_[8, 1:-1] = 1
    done = np.zeros((40, 40), dtype=np.uint8)
    done[:, :20] = SWEPT
    ways = np.where(open_ > 0, 10, -1).astype(np.int32)
    best, prices = (
        BestPerimeter(),
        PerimeterCosts(28.0, 0.85, 0.9, 500.0, 70.0, 2.0, 40.0, 4, 4.0, 15.0),
    )
    scan_perimeters(open_, ways, done, 20.0, 20.0, 0.0, prices, best)
    assert best.score > 0.0
    assert best.row == 8
    assert best.col >= 20
    assert abs(best.bearing_rad + 0.5 * math.pi) < 0.2


def test_the_path_has_few_corners_with_free_lines_between() -> None:
    open_ = floor(42, 42)
    open_[10:, 20] = 0
    dist = reach(open_, 35, 5)
    corners = np.zeros((50, 2), dtype=np.int32)
    count = trace_path(open_, dist, 35, 35, corners, CELLS)
    assert 3 <= count <= 6
    assert corners[0].tolist() == [35, 5]
    assert corners[count - 1].tolist() == [35, 35]
    for a, b in itertools.pairwise(corners[:count]):
        (r0, c0), (r1, c1) = a.tolist(), b.tolist()
        beside = max(abs(r1 - r0), abs(c1 - c0)) == 1
        assert beside or clear_line(open_, r0, c0, r1, c1, 1)
    assert trace_path(open_, np.full_like(dist, -1), 35, 35, corners, CELLS) == 0


def weighed(target: np.ndarray, *, done: np.ndarray | None = None) -> np.ndarray:
    """Return the targets' weights, in cells; a return is worth 100 cells, a piece of 20 is small.

    All floor is passable. The search has reached the targets only.
    """
    rows, cols = target.shape
    if done is None:
        done = np.where(target > 0, 0, SWEPT).astype(np.uint8)
    ways = np.where(target > 0, 10, -1).astype(np.int32)
    queue = np.zeros(rows * cols, dtype=np.int32)
    weights = target.copy()
    weigh_pieces(weights, floor(rows, cols), done, ways, queue, 100.0, 20, 5)
    return weights / CELL_WEIGHT


def test_a_piece_weighs_more_than_its_cells_by_one_return() -> None:
    target = np.zeros((40, 60), dtype=np.uint8)
    target[10:15, 10:20] = 1  # a piece of 50 cells
    target[15, 20] = 1  # it touches the piece at a corner
    target[30:32, 10:15] = 1  # a small piece of 10 cells
    target[30:32, 30:32] = 1  # a speck
    weights = weighed(target)
    assert weights[10:16, 10:21].sum() == pytest.approx(51 + 100, abs=4)
    assert weights[30:32, 10:15].sum() == pytest.approx(10 + 100 * 10 / 20, abs=1)
    assert weights[30:32, 30:32].sum() == 4
    assert ((weights > 0) == (target > 0)).all()


def test_a_piece_that_continues_beyond_the_search_weighs_its_cells() -> None:
    target = np.zeros((40, 60), dtype=np.uint8)
    target[10:15, 10:20] = 1
    done = np.where(target > 0, 0, SWEPT).astype(np.uint8)
    done[12, 20] = 0  # unswept and passable, but no path to it is known
    assert weighed(target, done=done).sum() == 50
    done[12, 20] = GIVEN_UP
    assert weighed(target, done=done).sum() > 140
    target[:] = 0
    target[1:8, 10:20] = 1  # beside the border of the window
    assert weighed(target).sum() == 70


def best_lane(
    target: np.ndarray,
    here: tuple[float, float],
    transit_share: float = 1.0,
    lane_rows: int = 7,
    *,
    last_row: int = 999,
) -> BestLane:
    """Return the best lane. The axle can reach the rows up to ``last_row``."""
    row, col = np.indices(target.shape)
    ways = np.where(row > last_row, -1, 10 * np.hypot(row - here[0], col - here[1]))
    ways = ways.astype(np.int32)
    best = BestLane()
    sums = np.zeros((2, target.shape[1]), dtype=np.int32)
    # 20 cm/s, 1 s/rad, 1 s a stop, 2 cells an edge; rows along the heading; transit costs its time
    costs = (20.0, 1.0, 1.0, 2.0, 0.0, 2.0, 40.0)
    prices = LaneCosts(*costs, 7, 10, lane_rows, transit_share, 15.0, 1)
    scan_lanes(target, ways, here[0], here[1], 0.0, prices, best, sums)
    return best


def test_a_lane_beside_swept_floor_is_preferred_to_one_that_leaves_a_sliver() -> None:
    target = np.zeros((60, 100), dtype=np.uint8)
    target[10:50, 10:90] = 1
    best = best_lane(target, (10.0, 8.0))
    # rows 10 … 16 are seven cells wide and leave nothing below them
    assert (best.row, best.first, best.last, best.backwards) == (13, 10, 89, False)
    assert best.new == 7 * 80
    assert best.score > 0.0


@pytest.mark.parametrize(
    ("lane_rows", "first_row", "row"), [(5, 10, 12), (6, 10, 13), (7, 10, 13), (8, 10, 14)]
)
def test_the_axle_drives_in_the_middle_of_the_rows_of_a_lane(
    lane_rows: int, first_row: int, row: int
) -> None:
    target = np.zeros((60, 100), dtype=np.uint8)
    target[first_row : first_row + lane_rows, 10:90] = 1
    best = best_lane(target, (10.0, 8.0), lane_rows=lane_rows)
    assert best.row == row, "with an even number, the axle drives before this row"
    assert best.new == lane_rows * 80


def test_floor_beyond_the_last_lane_beside_a_wall_costs_no_lane() -> None:
    target = np.zeros((60, 100), dtype=np.uint8)
    target[15:20, 10:90] = 1  # the lane in row 14 sweeps three of these rows
    assert best_lane(target, (14.0, 8.0)).new == 5 * 80
    best = best_lane(target, (14.0, 8.0), last_row=14)
    assert (best.row, best.new) == (14, 3 * 80)
    # its rate has no cost for the frontier: 80 cells of 2 cm and a stop, at 20 cm/s
    assert best.rate == pytest.approx(240 / (160 / 20 + 1), rel=0.1)


def test_an_uncertain_robot_plans_narrower_lanes() -> None:
    for sigma_m, strip_m, lane_rows in ((0.0, 0.16, 7), (0.03, 0.12, 6)):
        memory = EvidenceMap(RobotModel(), RecoveryOptions(), Pose2(0.0, 0.0, 0.0))
        for k in range(201):
            at = Pose2(0.01 * k, 0.0, 0.0)
            memory.update(seen(at)._replace(lateral_sigma_m=sigma_m))
        assert memory.swept.any(axis=1).sum() * 0.02 == pytest.approx(strip_m)
        assert SearchWindow(memory, memory.box(), 2, Buffers()).lane_rows == lane_rows


def test_a_lane_is_taken_from_its_nearer_end() -> None:
    target = np.zeros((60, 100), dtype=np.uint8)
    target[10:50, 10:90] = 1
    best = best_lane(target, (49.0, 95.0))
    assert best.row == 46
    assert best.backwards


def test_a_large_distant_target_waits_if_transit_costs_more_than_its_time() -> None:
    target = np.zeros((60, 260), dtype=np.uint8)
    target[10:17, 20:80] = 1
    target[10:17, 150:250] = 1
    near = best_lane(target, (13.0, 90.0), 4.0)
    far = best_lane(target, (13.0, 90.0))
    assert (near.last, far.first) == (79, 150)
    # the rate of a lane does not contain the additional cost
    assert near.rate < far.rate
    assert near.score < near.rate


def test_a_small_piece_beside_the_robot_comes_before_a_long_lane() -> None:
    target = np.zeros((60, 200), dtype=np.uint8)
    target[10:15, 40:50] = 1
    target[30:50, 60:190] = 1
    here = (13.0, 38.0)
    assert best_lane(target, here).row > 30
    prices = LaneCosts(20.0, 1.0, 1.0, 2.0, 0.0, 2.0, 40.0, 7, 10, 7, 1.0, 15.0, CELL_WEIGHT)
    weights = (weighed(target) * CELL_WEIGHT).astype(np.uint8)
    row, col = np.indices(target.shape)
    ways = (10 * np.hypot(row - here[0], col - here[1])).astype(np.int32)
    best, sums = BestLane(), np.zeros((2, target.shape[1]), dtype=np.int32)
    scan_lanes(weights, ways, *here, 0.0, prices, best, sums)
    assert best.row < 20
    assert best.new == 50
    assert best.rate < best.score


def seen(pose: Pose2) -> Observation:
    return AT_REST._replace(time_s=pose.x_m, pose=pose, v_m_s=0.2)


def test_only_remaining_pieces_that_hold_a_disc_are_holes() -> None:
    target = np.zeros((30, 30), dtype=np.uint8)
    target[2:5, 2:28] = 1  # a sliver of 6 cm
    target[10:14, 10:14] = 1
    target[10, 10] = target[13, 13] = 0  # a hole of 8 cm, rounded
    target[20:24, 20:23] = 1
    hole = np.ones_like(target)
    before = target.copy()
    assert keep_holes(target, hole, 4) == 14
    assert (target[10:14, 10:14] == before[10:14, 10:14]).all()
    assert target.sum() == 14
    assert keep_holes(target, hole, 4) == 14, "twice is once"


def test_a_hole_is_worth_returning_for_but_a_sliver_is_not() -> None:
    """A swept hall has a hole at its far end, or the same floor in a sliver."""
    for rows, cols, taken in ((5, 5, True), (2, 13, False)):
        pose = Pose2(0.0, 0.0, 0.0)
        memory = EvidenceMap(RobotModel(), RecoveryOptions(), pose)
        for k in range(121):
            memory.update(seen(Pose2(0.02 * k, 0.0, 0.0)))
        memory.swept[:] = 1
        column, row = (int(at) for at in memory.to_cells(2.4, 0.0))
        memory.swept[row : row + rows, column : column + cols] = 0
        choice = choose(Chooser(RecoveryOptions()), memory, pose, 0.0)
        assert (choice is not None) is taken
        if choice is not None:
            x, y = choice.path[-1]
            assert math.hypot(x - 2.4, y) < 0.3
            assert choice.rate_m2_s < memory.geometry.area_m2(memory.geometry.min_rate)


def test_nothing_left_is_no_choice() -> None:
    options = RecoveryOptions()
    memory = EvidenceMap(RobotModel(), options, Pose2(0.0, 0.0, 0.0))
    memory.swept[:] = 1
    assert choose(Chooser(options), memory, Pose2(0.0, 0.0, 0.0), 0.0) is None


def test_lanes_follow_the_walls_direction() -> None:
    options = RecoveryOptions()
    memory = EvidenceMap(RobotModel(), options, Pose2(0.0, 0.0, 0.0))
    choice = choose(Chooser(options), memory, Pose2(0.0, 0.0, 0.0), math.radians(30.0))
    assert choice is not None
    assert choice.kind == "lane"
    turned = math.remainder(choice.heading_rad - math.radians(30.0), 0.5 * math.pi)
    assert abs(turned) < 1e-9
