"""Random rooms are valid and repeatable, and the robot fits at the start."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.floor_plan.floor_plan import parse_floorplan
from tools.rooms.generator import KINDS, distance_m, generate_room, rectangle


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_every_room_can_be_read_back_and_holds_the_robot(kind: str, seed: int) -> None:
    plan = generate_room(seed, np.random.default_rng(seed), kind)
    assert parse_floorplan(plan.to_json()) == plan
    for polygon in (plan.walls, *plan.obstacles):
        assert distance_m(polygon, plan.start.x_m, plan.start.y_m) > 0.16


def test_equal_generators_give_equal_rooms() -> None:
    plans = [generate_room(3, np.random.default_rng(3)) for _ in range(2)]
    assert plans[0] == plans[1]
    assert generate_room(4, np.random.default_rng(4)) != plans[0]


def test_distance_to_a_perimeter() -> None:
    square = rectangle(0.0, 0.0, 1.0, 1.0)
    assert distance_m(square, 0.5, 0.25) == pytest.approx(0.25)
    assert distance_m(square, 2.0, 2.0) == pytest.approx(2.0**0.5)


def test_an_unknown_kind_is_rejected() -> None:
    with pytest.raises(KeyError):
        generate_room(0, np.random.default_rng(0), "castle")
