"""Orthogonality of walls, and the uncertainty of the heading against them."""

from __future__ import annotations

import math

import pytest

from bridge.motion.estimation.wall_map import MAX_WALLS
from support.walled import DEGREE, ORIGIN, Room, line


def test_squareness_is_used_where_the_evidence_is_for_it() -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.inflate(0.0, 0.5 * DEGREE)
    room.believe(0.0, 0.0, 0.4 * DEGREE)
    room.walls.see_line(line(0.0, 0.8))  # orthogonal to the first; the heading is 0.4° off
    assert abs(room.filter.pose.theta_rad) < 0.15 * DEGREE


@pytest.mark.parametrize("degrees", [2.5, 4.0, 12.0])
def test_an_oblique_box_bends_nothing(degrees: float) -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.inflate(0.0, 0.5 * DEGREE)
    room.walls.see_line(line(degrees * DEGREE, 0.8))
    assert room.filter.pose == ORIGIN
    assert len(room.walls.walls) == 2
    assert all(wall.frame < 0 for wall in room.walls.walls)
    # and is a separate reference
    room.believe(0.0, 0.0, 0.3 * DEGREE)
    assert room.walls.see_line(line(degrees * DEGREE, 0.8))
    assert abs(room.filter.pose.theta_rad) < 0.1 * DEGREE


def test_long_walls_are_square_though_their_angle_is_less_sure() -> None:
    """The drift of 1.7° between two walls is below their uncertainty.

    A box's side is never so long.
    """
    for span_m, squared in ((0.3, False), (0.6, True)):
        room = Room()
        room.walls.see_line(line(math.pi / 2, 0.5, span_m))
        room.inflate(0.0, 1.5 * DEGREE)
        room.believe(0.0, 0.0, 1.7 * DEGREE)
        room.walls.see_line(line(0.0, 0.8, span_m))
        off = abs(room.filter.pose.theta_rad)
        assert (off < 0.15 * DEGREE) is squared
        assert off < 0.15 * DEGREE or off == pytest.approx(1.7 * DEGREE)


def test_two_frames_of_square_walls_become_one() -> None:
    """The pair looks oblique to the first pair until both have been followed for long enough."""
    room = Room()
    first = (line(math.pi / 2, 0.5), line(0.0, 0.8))
    for measurement in first:
        room.walls.see_line(measurement)
    room.inflate(0.0, 1.5 * DEGREE)
    room.believe(0.0, 0.0, 1.7 * DEGREE)
    for measurement in (line(-math.pi / 2, 1.5), line(math.pi, 1.8)):
        room.walls.see_line(measurement)
    walls = room.walls.walls
    assert walls[0].frame == walls[1].frame != walls[2].frame == walls[3].frame
    assert room.filter.pose.theta_rad == pytest.approx(1.7 * DEGREE)
    room.walls.see_line(line(-math.pi / 2, 1.5))  # now for 0.6 m, but the first for 0.3 m
    assert room.filter.pose.theta_rad == pytest.approx(1.7 * DEGREE, abs=1e-6)
    walls[0].seen_m = 0.6
    room.walls.see_line(line(-math.pi / 2, 1.5))
    assert len({wall.frame for wall in walls}) == 1
    assert abs(room.filter.pose.theta_rad) < 0.2 * DEGREE
    for i in range(4):
        assert abs(math.remainder(room.walls.normal_rad(i), math.pi / 2)) < 0.2 * DEGREE


def test_the_headings_variance_is_that_against_the_orthogonal_walls() -> None:
    room = Room()
    assert room.walls.heading_sigma_rad == 0.0
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.inflate(0.0, 0.5 * DEGREE)
    assert room.walls.heading_sigma_rad == 0.0, "one wall squares with nothing"
    room.walls.see_line(line(0.0, 0.8))
    known = room.walls.heading_sigma_rad
    assert 0.0 < known < 0.25 * DEGREE
    # the rotation of the whole map does not count, the drift since then does
    room.inflate(0.0, 1.0 * DEGREE)
    assert room.walls.heading_sigma_rad == pytest.approx(math.hypot(known, DEGREE), rel=1e-3)
    room.walls.see_line(line(math.pi / 2, 0.5))
    assert room.walls.heading_sigma_rad < 0.25 * DEGREE
    room.filter.restart(ORIGIN)
    assert room.walls.heading_sigma_rad == 0.0, "and a restart knows no walls"


@pytest.mark.parametrize(("span_m", "hides"), [(0.2, False), (0.6, True)])
def test_the_wall_frame_that_was_seen_most_counts(span_m: float, *, hides: bool) -> None:
    """The oblique box was just passed. It does not give the uncertainty of the lanes' heading."""
    room = Room()
    for measurement in (line(math.pi / 2, 0.5), line(0.0, 0.8)):
        room.walls.see_line(measurement)
    room.inflate(0.0, 2.0 * DEGREE)
    inflate = room.walls.heading_sigma_rad
    oblique = 20.0 * DEGREE
    for measurement in (line(math.pi / 2 + oblique, 0.9, span_m), line(oblique, 0.9, span_m)):
        room.walls.see_line(measurement)
    walls = room.walls.walls
    assert walls[0].frame == walls[1].frame != walls[2].frame == walls[3].frame >= 0
    assert (room.walls.heading_sigma_rad < 0.25 * DEGREE < inflate) is hides


def test_a_wall_frame_counts_once_more_of_it_is_seen() -> None:
    room = Room()
    oblique = 20.0 * DEGREE
    box = (line(math.pi / 2 + oblique, 0.4, 0.4), line(oblique, 0.4, 0.4))
    for measurement in box:
        room.walls.see_line(measurement)
    room.inflate(0.0, 2.0 * DEGREE)  # uncertainty of the angle between box and room
    for measurement in (line(math.pi / 2, 0.9), line(0.0, 0.9)):
        room.walls.see_line(measurement)
    assert room.walls.heading_sigma_rad > DEGREE, "against the box, of which more was seen"
    for _ in range(2):
        room.walls.see_line(line(math.pi / 2, 0.9))
    assert room.walls.heading_sigma_rad < 0.25 * DEGREE, "against the room"


def test_a_marginalised_wall_is_associated_with_no_other() -> None:
    room = Room()
    oblique, between = line(0.3, 0.3, 0.15), line(0.9, 1.7)
    for measurement in (
        oblique,
        *[line(math.pi / 2, 0.5)] * 3,
        *[between] * 3,
        *[line(0.0, 0.8)] * 3,
    ):
        room.walls.see_line(measurement)
    assert [wall.frame for wall in room.walls.walls] == [-1, 0, -1, 0]
    room.inflate(0.0, DEGREE)
    inflate = room.walls.heading_sigma_rad
    assert inflate > DEGREE
    for i in range(MAX_WALLS - 3):  # the first one goes, and others of which little was seen come
        room.walls.see_line(line(0.5 + 0.02 * i, 1.0 + 0.11 * i, 0.15))
    assert len(room.walls.walls) == MAX_WALLS
    assert room.walls.heading_sigma_rad == pytest.approx(inflate, rel=1e-6)
