"""The geometry of a room: rays, distances, corners and the start."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import sim_device
from bridge.floor_plan.floor_plan import FloorPlanError, StartBlockedError, parse_floorplan
from bridge.motion.robot_model import RobotModel
from sim_device.world.world import World
from support.sim_body import box, room, world

ROOMS = sorted((Path(sim_device.__file__).parent / "rooms").glob("*.json"))


@pytest.mark.parametrize("path", ROOMS, ids=lambda p: p.stem)
def test_every_shipped_room_holds_the_robot(path: Path) -> None:
    made = World(parse_floorplan(path.read_text(encoding="utf-8")), RobotModel())
    start = made.plan.start
    assert made.clearance_m(start.x_m, start.y_m) >= 0.0


def test_a_start_too_near_to_a_wall_is_rejected_in_one_line() -> None:
    with pytest.raises(StartBlockedError, match=r"\(0\.1, 5\).*60\.0 mm") as caught:
        world(room((0.1, 5.0, 0.0)))
    assert caught.value.overlap_m == pytest.approx(0.06)
    assert isinstance(caught.value, FloorPlanError)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("start", [(-1.0, 5.0, 0.0), (10.0, 10.0, 0.0)])
def test_a_start_off_the_floor_is_rejected(start: tuple[float, float, float]) -> None:
    with pytest.raises(StartBlockedError, match="stands in"):
        world(room(start, obstacles=(box(8.0, 8.0, 12.0, 12.0),)))


def test_a_start_that_just_touches_is_accepted() -> None:
    world(room((0.16, 5.0, 0.0)))


def test_the_nearest_point_of_a_face_and_of_a_corner() -> None:
    made = world(room((1.0, 1.0, 0.0), obstacles=(box(5.0, 5.0, 6.0, 6.0),)))
    face = made.nearest(4.0, 5.5)
    assert face == pytest.approx((1.0, 5.0, 5.5, -1.0, 0.0))
    corner = made.nearest(6.3, 6.4)
    assert corner == pytest.approx((0.5, 6.0, 6.0, 0.6, 0.8))
    assert made.clearance_m(6.3, 6.4) == pytest.approx(0.34)
    assert made.nearest(5.0, 5.5)[0] == 0.0


def test_rays_meet_the_first_wall_with_its_angle() -> None:
    made = world(room((1.0, 1.0, 0.0), obstacles=(box(5.0, 5.0, 6.0, 6.0),)))
    angles = np.array([0.0, math.pi / 2, math.pi, math.radians(45.0)])
    ranges, cosines = made.cast(np.full(4, 3.0), np.full(4, 5.5), np.cos(angles), np.sin(angles))
    assert ranges == pytest.approx([2.0, 14.5, 3.0, 14.5 * math.sqrt(2.0)])
    assert cosines == pytest.approx([1.0, 1.0, 1.0, math.sqrt(0.5)])


def test_a_ray_along_an_obstacle_side_hits_the_edge_across_it() -> None:
    made = world(room((1.0, 1.0, 0.0), obstacles=(box(5.0, 5.0, 6.0, 6.0),)))
    ranges, _ = made.cast(np.array([2.0]), np.array([5.0]), np.array([1.0]), np.array([0.0]))
    assert ranges == pytest.approx([3.0])


def test_no_ray_slips_through_a_corner() -> None:
    made = world(room((1.0, 1.0, 0.0)))
    x, y = 7.3, 4.1
    to = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [0.0, 20.0]]) - [x, y]
    far = np.hypot(to[:, 0], to[:, 1])
    ranges, _ = made.cast(np.full(4, x), np.full(4, y), to[:, 0] / far, to[:, 1] / far)
    assert ranges == pytest.approx(far)


def test_corners_record_whether_they_jut_into_the_floor() -> None:
    l_shape = ((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 2.0), (2.0, 4.0), (0.0, 4.0))
    clockwise = box(0.5, 0.5, 0.6, 0.6)[::-1]
    made = world(room((1.0, 3.0, 0.0), walls=l_shape, obstacles=(clockwise,)))
    juts = {(x, y): bool(j) for x, y, j in made.corners.tolist()}
    assert [p for p in l_shape if juts[p]] == [(2.0, 2.0)]
    assert all(juts[p] for p in clockwise)


def test_near_sides_are_those_within_the_distance() -> None:
    made = world(room((1.0, 1.0, 0.0), obstacles=(box(5.0, 5.0, 6.0, 6.0),)))
    assert len(made.edges_near(4.5, 5.5, 0.6)) == 1
    assert len(made.edges_near(10.0, 10.0, 3.0)) == 0
    assert len(made.edges_near(10.0, 10.0, 100.0)) == len(made.edges) == 8


def test_repeated_corners_are_no_sides() -> None:
    walls = ((0.0, 0.0), (0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0))
    assert len(world(room((1.0, 1.0, 0.0), walls=walls)).edges) == 4
