"""A robot that was moved by hand: it measures walls on driven floor, and misses known walls."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.motion.estimation.displacement import DisplacementCheck
from bridge.motion.estimation.wall_frames import Wall
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel

if TYPE_CHECKING:
    from collections.abc import Iterator

MODEL = RobotModel()
STEP_M = 0.01


class Map:
    """The walls, with the interface of the filter's wall map."""

    def __init__(self) -> None:
        self.walls: list[tuple[Wall, float, float]] = []
        self.found: tuple[Wall, float] | None = None

    def add(self, x_m: float, y_m: float, normal_rad: float, half_m: float = 1.0) -> Wall:
        wall = Wall(x_m, y_m, -half_m, half_m, 2.0 * half_m, 5, number=len(self.walls))
        self.walls.append((wall, normal_rad, 0.0))
        return wall

    def known(self) -> Iterator[tuple[Wall, float, float]]:
        return iter(self.walls)

    def take_found(self) -> tuple[Wall, float] | None:
        found, self.found = self.found, None
        return found


class Drive:
    """Straight drives parallel to x, with or without a wall on the left."""

    def __init__(self) -> None:
        self.check, self.walls = DisplacementCheck(MODEL), Map()
        self.confirmed = 0
        self.sigmas_m = (0.01, 0.01)
        """Standard deviations of the position along x and y, m."""

    def along(
        self,
        from_m: float,
        to_m: float,
        y_m: float,
        left_m: float | None = None,
        found: tuple[Wall, float] | None = None,
    ) -> None:
        count = round(abs(to_m - from_m) / STEP_M)
        heading = 0.0 if to_m > from_m else math.pi
        for k in range(count + 1):
            x_m = from_m + (to_m - from_m) * k / count
            self.walls.found = found
            self.confirmed += self.check.update(
                Pose2(x_m, y_m, heading), 0.0, (left_m, None), self.walls, self.sigma_along_m
            )

    def sigma_along_m(self, direction_rad: float) -> float:
        along_x, along_y = self.sigmas_m
        return math.hypot(along_x * math.cos(direction_rad), along_y * math.sin(direction_rad))


def test_a_wall_on_driven_floor_shows_that_the_robot_was_moved() -> None:
    drive = Drive()
    drive.along(0.0, 3.0, 0.0)
    assert drive.check.evidence == (0, 0.0)
    drive.along(0.0, 1.0, -0.25, left_m=0.15)  # this wall is on the floor of the first drive
    assert drive.check.evidence[0] >= 8
    assert not drive.check.displaced, "as long as furniture"
    drive.along(1.0, 1.6, -0.25, left_m=0.15)
    assert drive.check.displaced


def test_walls_at_the_edge_of_driven_floor_are_an_error_of_the_estimate() -> None:
    drive = Drive()
    drive.along(0.0, 3.0, 0.0)
    drive.along(0.0, 2.0, -0.25, left_m=0.09)  # 6 cm beside the path of the first drive
    assert drive.check.evidence[0] >= 8
    assert drive.check.evidence[1] >= 1.2
    assert not drive.check.displaced
    drive.along(0.0, 0.4, -0.25, left_m=0.15)
    assert drive.check.displaced, "with walls on the path itself"


def test_a_wall_beside_driven_floor_is_none() -> None:
    drive = Drive()
    drive.along(0.0, 3.0, 0.0, left_m=0.06)
    drive.along(0.0, 3.0, -0.25, left_m=0.29)
    assert drive.check.evidence[0] == 0


def test_a_robot_that_drives_through_a_wall_of_the_map_was_moved() -> None:
    drive = Drive()
    drive.walls.add(1.0, 0.0, math.pi / 2.0)
    drive.along(0.0, 2.0, 0.0)
    assert drive.check.displaced
    aside = Drive()
    aside.walls.add(1.0, 0.0, math.pi / 2.0)
    aside.along(0.0, 2.0, -0.15)
    assert aside.check.evidence[0] == 0


@pytest.mark.parametrize(("normal_rad", "cleared"), [(math.pi / 2.0, True), (0.0, False)])
def test_a_known_wall_removes_evidence_across_its_own_direction(
    normal_rad: float, *, cleared: bool
) -> None:
    drive = Drive()
    wall = drive.walls.add(0.0, 5.0, normal_rad)
    drive.along(0.0, 3.0, 0.0, found=(wall, normal_rad))
    drive.along(0.0, 1.0, -0.25, left_m=0.15)
    assert drive.check.evidence[0] >= 8
    drive.along(1.0, 1.1, -0.25, found=(wall, normal_rad))
    assert (drive.check.evidence[0] == 0) is cleared


def test_a_wall_that_was_first_seen_after_the_evidence_confirms_nothing() -> None:
    drive = Drive()
    wall = drive.walls.add(0.0, 5.0, math.pi / 2.0)
    drive.along(0.0, 3.0, 0.0)
    drive.along(0.0, 1.0, -0.25, left_m=0.15)
    drive.along(1.0, 3.0, -0.25, found=(wall, math.pi / 2.0))
    assert drive.check.evidence[0] >= 8


def test_the_estimate_is_confirmed_by_known_walls_across_both_directions() -> None:
    drive = Drive()
    one, other = drive.walls.add(0.0, 5.0, math.pi / 2.0), drive.walls.add(9.0, 0.0, 0.0)
    drive.along(0.0, 1.5, 0.0, found=(one, math.pi / 2.0))
    assert drive.confirmed == 0
    drive.along(1.5, 3.0, 0.0, found=(other, 0.0))
    assert drive.confirmed == 1


@pytest.mark.parametrize(
    ("sigmas_m", "shown"), [((0.1, 0.03), True), ((0.0, 0.033), False), ((0.0, 0.1), False)]
)
def test_what_the_uncertainty_across_the_wall_explains_is_no_evidence(
    sigmas_m: tuple[float, float], *, shown: bool
) -> None:
    drive = Drive()
    drive.sigmas_m = sigmas_m
    drive.along(0.0, 3.0, 0.0)
    drive.along(0.0, 1.6, -0.25, left_m=0.15)  # the wall is on the axle's path, so 10 cm off
    assert drive.check.displaced is shown


@pytest.mark.parametrize(("sigma_m", "shown"), [(0.05, True), (0.054, False)])
def test_a_wall_may_be_crossed_by_three_standard_deviations(sigma_m: float, *, shown: bool) -> None:
    drive = Drive()
    drive.sigmas_m = (0.0, sigma_m)
    drive.walls.add(1.0, 0.0, math.pi / 2.0)
    drive.along(0.0, 2.0, 0.0)
    assert drive.check.displaced is shown
