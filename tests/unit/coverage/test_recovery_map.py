"""The recovery planner's map and its kernels, on floors so small that results are by hand."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.coverage.recovery.evidence_kernels import (
    add_wall,
    beam,
    bump_area,
    clear_body,
    fresh_ahead,
    speed_limit_m_s,
    sweep,
)
from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.motion.control.braking import Braking
from bridge.motion.control.hidden_ahead import HiddenAheadTuning, contact_speed
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST

if TYPE_CHECKING:
    from bridge.motion.observation import Observation

MODEL = RobotModel()


def layers(rows: int, cols: int, count: int) -> list[np.ndarray]:
    return [np.zeros((rows, cols), dtype=np.uint8) for _ in range(count)]


def observed(
    x: float, y: float, theta: float = 0.0, *, time_s: float = 0.0, right_m: float | None = None
) -> Observation:
    pose = Pose2(x, y, theta)
    return AT_REST._replace(time_s=time_s, pose=pose, v_m_s=0.2, infrared_right_m=right_m)


def test_a_straight_sweep_marks_exactly_the_centres_passed() -> None:
    (swept,) = layers(11, 20, 1)
    # The path goes from column 4.0 to 10.0 along row 5.5, with half width 2. It covers the cell
    # centres in columns 4.5 … 9.5 and rows 3.5 … 7.5.
    assert sweep(swept, 4.0, 5.5, 0.0, 10.0, 5.5, 0.0, 2.0, 0.0) == 6 * 5
    assert swept[3:8, 4:10].all()
    assert swept.sum() == 30
    assert sweep(swept, 10.0, 5.5, 0.0, 4.0, 5.5, 0.0, 2.0, 0.0) == 0


def test_a_turn_in_place_sweeps_a_disc() -> None:
    (swept,) = layers(21, 21, 1)
    angles = np.linspace(0.0, math.pi, 90)
    for a, b in itertools.pairwise(angles):
        sweep(swept, 10.5, 10.5, a, 10.5, 10.5, b, 6.0, 0.0)
    row, col = np.indices(swept.shape)
    distance = np.hypot(row - 10, col - 10)
    assert swept[distance < 5.9].all()
    assert not swept[distance > 6.01].any()


def test_evidence_is_revocable_and_leaves_no_trace() -> None:
    wall, inflated = layers(21, 21, 2)
    add_wall(wall, inflated, 10, 10, 1, 3.0)
    assert inflated.sum() == 0  # one reading is not certain
    add_wall(wall, inflated, 10, 10, 1, 3.0)
    assert inflated.sum() == 29  # grid points within a radius of 3 cells
    add_wall(wall, inflated, 10, 12, 2, 3.0)
    assert inflated.max() == 2
    add_wall(wall, inflated, 10, 12, -1, 3.0)
    add_wall(wall, inflated, 10, 10, -1, 3.0)
    assert inflated.sum() == 0


def test_a_beam_clears_passed_cells_and_marks_its_hit() -> None:
    wall, inflated = layers(9, 30, 2)
    add_wall(wall, inflated, 4, 10, 2, 2.0)
    beam(wall, inflated, 2.5, 4.5, 1.0, 0.0, 15.0, 18.0, 2, 2.0)
    assert wall[4, 10] == 1
    assert wall[4, 20] == 2
    assert inflated[4, 10] == 0
    assert inflated[4, 20] == 1


def test_where_the_body_is_nothing_else_is() -> None:
    wall, inflated, visited = layers(21, 21, 3)
    add_wall(wall, inflated, 10, 13, 6, 3.0)
    add_wall(wall, inflated, 10, 18, 6, 3.0)
    clear_body(wall, inflated, visited, 10.5, 10.5, 5.0, 3.0)
    assert wall[10, 13] == 0
    assert wall[10, 18] == 6
    assert visited[10, 10] == 1


def test_a_bump_forbids_only_cells_common_to_all_possible_contacts() -> None:
    (blocked,) = layers(41, 41, 1)
    # Both bumper switches mean a contact within 10° of straight ahead. The footprint's radius is 8
    # cells.
    bump_area(blocked, 20.5, 20.5, math.radians(-10), math.radians(10), 8.0)
    assert blocked[20, 22] == 1  # two cells ahead, the wall would be inside the footprint
    assert blocked[20, 20] == 0  # the robot is here
    assert blocked[20, 16] == 0
    marked = np.argwhere(blocked)
    for row, col in marked:
        for bearing in (-10.0, 0.0, 10.0):
            touch = (
                20.5 + 8.0 * math.sin(math.radians(bearing)),
                20.5 + 8.0 * math.cos(math.radians(bearing)),
            )
            assert math.hypot(row + 0.5 - touch[0], col + 0.5 - touch[1]) < 8.0


def test_the_share_not_swept_ahead() -> None:
    (swept,) = layers(40, 40, 1)
    assert fresh_ahead(swept, 20.0, 20.0, 0.0, 2.0, 10.0, -3.0, 3.0) == 1.0
    swept[20:, :] = 1
    assert fresh_ahead(swept, 20.0, 20.0, 0.0, 2.0, 10.0, 0.5, 3.0) == 0.0
    assert fresh_ahead(swept, 20.0, 20.0, 0.0, 2.0, 10.0, -3.0, -0.5) == 1.0
    assert fresh_ahead(swept, 20.0, 20.0, math.pi, 2.0, 10.0, 0.5, 3.0) == 1.0


def test_the_speed_limit_makes_contact_with_known_obstacles_soft() -> None:
    (wall,) = layers(81, 81, 1)
    wall[40, 60] = 2  # the centre is 20 cells (0.4 m) ahead of the axle at (40.5, 40.5)
    given = (0.02, 0.17, 0.17, 0.17, 0.026, 0.3, 0.0, 0.3)

    def at(x: float, y: float = 40.5, heading: float = 0.0) -> float:
        return speed_limit_m_s(wall, x, y, heading, *given)

    assert at(40.5) == pytest.approx(0.3)  # the braking distance from 0.3 m/s is 0.15 m
    assert at(47.5) == pytest.approx(math.sqrt(0.026**2 + 2 * 0.3 * (0.26 - 0.17)))
    assert at(52.0) == pytest.approx(0.026)
    assert at(52.0, heading=math.pi) == pytest.approx(0.3)
    # At 9 cells to the side the obstacle does not count. At 6 cells the contact angle is 45° or
    # more.
    assert at(55.0, 40.5 - 9.0) == pytest.approx(0.3)
    assert at(55.0, 40.5 - 6.0) == pytest.approx(0.026 / math.sqrt(1 - (0.12 / 0.17) ** 2))
    wall[40, 60] = 1
    assert at(52.0) == pytest.approx(0.3)  # one reading is not enough


@pytest.mark.parametrize("aside", [-0.16, -0.1, 0.0, 0.05, 0.14, 0.18])
@pytest.mark.parametrize("ahead", [-0.1, 0.02, 0.1, 0.2, 0.3, 0.5])
def test_the_map_limits_the_speed_as_a_hidden_obstacle_does(aside: float, ahead: float) -> None:
    (wall,) = layers(81, 81, 1)
    wall[40, 40] = 2
    rim, touch, brake, fast = 0.17, 0.026, Braking(0.3, 0.1), 0.3
    x, y = 40.5 - ahead / 0.02, 40.5 - aside / 0.02
    known = speed_limit_m_s(
        wall, x, y, 0.0, 0.02, rim, rim, rim, touch, brake.decel, brake.latency_s, fast
    )
    assert known == pytest.approx(min(contact_speed(abs(aside), ahead, rim, brake, touch), fast))


def test_the_wall_that_is_followed_does_not_slow_the_robot() -> None:
    memory = EvidenceMap(MODEL, RecoveryOptions(), Pose2(0.0, 0.0, 0.0))
    for k in range(40):
        memory.update(observed(0.02 * k, 0.0, time_s=0.1 * k, right_m=0.06))
    pose, limits = Pose2(0.3, 0.0, 0.0), (Braking(0.3, 0.1), HiddenAheadTuning().contact_m_s)
    assert memory.speed_limit_m_s(pose, -1, *limits) == pytest.approx(MODEL.max_speed_m_s)
    assert memory.speed_limit_m_s(pose, 0, *limits) < 0.2
    assert memory.speed_limit_m_s(Pose2(0.3, 0.0, -0.5 * math.pi), 0, *limits) < 0.03


def test_the_infrared_maps_a_wall_where_it_stands() -> None:
    memory = EvidenceMap(MODEL, RecoveryOptions(), Pose2(0.0, 0.0, 0.0))
    # the right infrared sits at (0.05, -0.10) and reads 0.06: a wall at y = -0.16
    for k in range(20):
        memory.update(observed(0.02 * k, 0.0, time_s=0.1 * k, right_m=0.06))
    column, row = memory.to_cells(0.2, -0.16 + 1e-6)
    assert memory.wall[int(row), int(column)] >= 2
    assert memory.wall.sum(axis=1).argmax() == int(row)
    beside = memory.to_cells(0.2, -0.05)
    assert memory.inflated[int(beside[1]), int(beside[0])] > 0  # 11 cm from the wall: forbidden
    here = memory.to_cells(0.2, 0.0)
    assert memory.visited[int(here[1]), int(here[0])] == 1


def test_the_map_grows_without_losing_anything() -> None:
    memory = EvidenceMap(MODEL, RecoveryOptions(), Pose2(1.0, 1.0, 0.0))
    before = memory.shape
    for k in range(600):
        memory.update(observed(1.0 - 0.01 * k, 1.01, math.pi, time_s=0.02 * k))
    assert memory.shape != before
    for x in (1.0, -2.0, -4.9):
        column, row = memory.to_cells(x - 0.01, 1.01)
        assert memory.swept[int(row), int(column)] == 1
    assert memory.swept.sum() == memory.new_cells
    # 6 m by the mouth's width minus its margins: seven cells around the axle's cell
    assert memory.new_cells * 4e-4 == pytest.approx(6.0 * 0.14, rel=0.05)


def test_the_packed_map_holds_two_bits_a_cell() -> None:
    memory = EvidenceMap(MODEL, RecoveryOptions(), Pose2(0.0, 0.0, 0.0))
    for corner in ((0.0, 0.0), (7.68, 0.0), (7.68, 7.18), (0.0, 7.18), (0.0, 0.0)):
        memory.update(observed(*corner))
        memory.update(observed(corner[0] + 0.02, corner[1]))
    # a 60 m² flat: 8.0 by 7.5 m, and 5 cm beyond the walls that the robot touches
    kept = memory.packed()
    assert (kept.rows, kept.columns) == (380, 406)
    assert len(kept.cells) == 380 * 406 // 4
    assert kept.size_bytes < 40_000


def test_a_map_packed_elsewhere_is_rejected() -> None:
    memory = EvidenceMap(MODEL, RecoveryOptions(), Pose2(0.0, 0.0, 0.0))
    far = EvidenceMap(MODEL, RecoveryOptions(), Pose2(9.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="not a part of this map"):
        memory.unpack(far.packed())
