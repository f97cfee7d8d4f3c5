"""The generated reference pages of robot and room files are fresh, complete and correct."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import TYPE_CHECKING

import pytest

from bridge.floor_plan.floor_plan import FloorPlanError, parse_floorplan
from bridge.floor_plan.keys import CARPET_KEYS, ROOM_KEYS, THRESHOLD_KEYS
from bridge.motion.robot_model import RangerMount, RobotModel
from bridge.supervise.settings import SuperviseSettings
from tools.dev.file_reference import ROBOT_PAGE, ROOM_PAGE, robot_page, room_page

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from bridge.floor_plan.keys import RoomKey

RENEW = "run `python -m tools.dev.file_reference`"


def test_the_pages_are_fresh() -> None:
    assert ROBOT_PAGE.read_text(encoding="utf-8") == robot_page(), RENEW
    page = ROOM_PAGE.read_text(encoding="utf-8")
    assert page == room_page(page), RENEW


def test_the_robot_page_has_every_key() -> None:
    page = robot_page()
    model, rules = RobotModel(), SuperviseSettings()
    tables: list[DataclassInstance] = [model, rules, *rules.rules.values()]
    keys = {f.name for table in tables for f in dataclasses.fields(table)}
    keys |= {field.name for field in dataclasses.fields(RangerMount)}
    keys -= {*model.rangers, *rules.rules}
    for key in keys:
        assert f"`{key}" in page, key
    for name in rules.rules:
        assert f"### supervise.{name}\n" in page
    for name in model.rangers:
        assert f"`[{name}]`" in page


def test_every_number_of_a_robot_file_has_a_unit_and_a_meaning() -> None:
    rules = SuperviseSettings()
    tables: list[DataclassInstance] = [RobotModel(), RobotModel().ultrasonic, rules]
    for table in [*tables, *rules.rules.values()]:
        for field in dataclasses.fields(table):
            if "range" in field.metadata:
                assert field.metadata["unit"], field.name
                assert field.metadata["meaning"], field.name


def test_the_rooms_page_has_every_key() -> None:
    page = ROOM_PAGE.read_text(encoding="utf-8")
    for key in (*ROOM_KEYS, *CARPET_KEYS, *THRESHOLD_KEYS):
        assert f"| `{key.name}` | " in page


CARPET: dict[str, object] = {"polygon": [[1, 1], [2, 1], [2, 2]]}
THRESHOLD: dict[str, object] = {"line": [[1, 1], [2, 1]], "height_m": 0.01}
NUMBERS = [("carpets", CARPET, key) for key in CARPET_KEYS if key.is_number]
NUMBERS += [("thresholds", THRESHOLD, key) for key in THRESHOLD_KEYS if key.is_number]


@pytest.mark.parametrize(("group", "item", "key"), NUMBERS, ids=[n[2].name for n in NUMBERS])
def test_a_number_of_a_room_has_the_range_that_the_page_states(
    group: str, item: dict[str, object], key: RoomKey
) -> None:
    def read(value: float) -> None:
        changed = {**item, key.name: value}
        walls = [[0, 0], [3, 0], [3, 3], [0, 3]]
        text = json.dumps({"walls": walls, "start": [1.0, 0.5, 0], group: [changed]})
        parse_floorplan(text)

    read(key.high)
    read(math.nextafter(key.low, key.high) if key.above_low else key.low)
    for beyond in (key.high * 1.001, key.low if key.above_low else key.low - 0.001):
        with pytest.raises(FloorPlanError, match=key.name):
            read(beyond)


def test_the_pictures_of_the_pages_are_there() -> None:
    for page, name in ((ROBOT_PAGE, "robot-show.png"), (ROOM_PAGE, "room-show.png")):
        assert f"({name})" in page.read_text(encoding="utf-8")
        assert (page.parent / name).is_file()
