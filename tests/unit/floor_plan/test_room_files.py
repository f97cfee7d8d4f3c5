"""Room files: every error is reported, and probable mistakes cause warnings."""

from __future__ import annotations

import json
import math

import pytest

from bridge.floor_plan.floor_plan import FloorPlanError, parse_floorplan

RADIUS_M = 0.16
WALLS = [[0, 0], [3, 0], [3, 2], [0, 2]]
TABLE = [[1, 1], [2, 1], [2, 1.5], [1, 1.5]]


def room(**keys: object) -> str:
    return json.dumps({"walls": WALLS, "start": [0.3, 0.3, 0.0], **keys})


@pytest.mark.parametrize(
    ("keys", "written", "meant"),
    [
        ({"obstacle": [TABLE]}, "obstacle", "obstacles"),
        ({"Obstacles": [TABLE]}, "Obstacles", "obstacles"),
        ({"carpet": []}, "carpet", "carpets"),
        ({"treshholds": []}, "treshholds", "thresholds"),
        ({"carpets": [{"polygon": TABLE, "drag": 3}]}, "carpets[0].drag", "carpets[0].drag_n"),
        (
            {"thresholds": [{"line": [[1, 0], [1, 1]], "height_m": 0.005, "lines": 1}]},
            "thresholds[0].lines",
            "thresholds[0].line",
        ),
    ],
)
def test_a_key_that_resembles_a_known_one_is_a_caution(
    keys: dict[str, object], written: str, meant: str
) -> None:
    (caution,) = parse_floorplan(room(**keys)).cautions
    assert f'"{written}"' in caution
    assert f'did you mean "{meant}"?' in caution


def test_a_misspelt_key_beside_the_right_one_is_a_caution() -> None:
    (caution,) = parse_floorplan(room(obstacles=[], obstacle=[])).cautions
    assert 'did you mean "obstacles"?' in caution


def test_other_keys_are_allowed_in_silence() -> None:
    keys = {"units": "m", "author": "me", "comment": "?", "version": 2, "doors": [], "floor": 1}
    assert parse_floorplan(room(**keys)).cautions == ()


def test_cautions_are_no_part_of_the_room() -> None:
    spelt, misspelt = parse_floorplan(room()), parse_floorplan(room(obstacle=[TABLE]))
    assert spelt == misspelt
    assert spelt.to_json() == misspelt.to_json()


def test_a_repeated_key_is_a_caution() -> None:
    text = room(obstacles=[TABLE])[:-1] + ', "obstacles": []}'
    assert parse_floorplan(text).cautions == (
        '"obstacles" stands twice in the room file; the last one counts',
    )


@pytest.mark.parametrize("heading", [90, -90.0, 180, 270, 360, 6.5])
def test_a_heading_in_degrees_is_rejected_with_its_radians(heading: float) -> None:
    with pytest.raises(FloorPlanError, match="start: a heading of") as caught:
        parse_floorplan(room(start=[0.3, 0.3, heading]))
    assert f"{math.radians(heading):.5g} rad" in str(caught.value)


@pytest.mark.parametrize("heading", [0, -3.2, math.pi, 2 * math.pi, 6.2832, -6.2831853])
def test_a_heading_up_to_a_full_turn_is_accepted(heading: float) -> None:
    assert parse_floorplan(room(start=[0.3, 0.3, heading])).start.theta_rad == heading


@pytest.mark.parametrize(
    ("start", "printed"),
    [
        ([4.0, 1.0, 0.0], "outside the walls"),
        ([1.5, 1.2, 0.0], "in obstacles[0]"),
        ([0.1, 1.0, 0.0], "overlaps a wall or an obstacle by 60.0 mm"),
        ([0.9, 1.2, 0.0], "overlaps a wall or an obstacle by 60.0 mm"),
    ],
)
def test_a_start_that_contradicts_the_walls_is_rejected(start: list[float], printed: str) -> None:
    with pytest.raises(FloorPlanError) as caught:
        parse_floorplan(room(obstacles=[TABLE], start=start), radius_m=RADIUS_M)
    assert printed in str(caught.value)
    assert len(caught.value.problems) == 1


def test_a_room_names_everything_that_is_wrong_in_one_line() -> None:
    text = room(
        obstacle=[TABLE],
        obstacles=[[[1, 1], [2, 1]], TABLE],
        carpets=[{"polygn": TABLE, "slip": 3}],
        start=[0.1, 0.3, 90],
    )
    with pytest.raises(FloorPlanError) as caught:
        parse_floorplan(text, radius_m=RADIUS_M)
    line = str(caught.value)
    assert "\n" not in line
    for printed in (
        "obstacles[0]: must be a list",
        "carpets[0].slip: 3 must be from 0 to 0.5",
        'did you mean "carpets[0].polygon"?',
        "heading of 90 rad",
        "overlaps a wall or an obstacle by 60.0 mm",
    ):
        assert printed in line


def test_a_missing_key_names_the_one_that_was_written_for_it() -> None:
    text = json.dumps({"wall": WALLS, "start_pose": [0.3, 0.3, 0.0]})
    with pytest.raises(FloorPlanError) as caught:
        parse_floorplan(text)
    assert 'walls: is missing; is "wall" meant to be it?' in str(caught.value)
    assert 'start: is missing; is "start_pose" meant to be it?' in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"thresholds": [{"line": [[1, 0], [1, 1]]}]}, "thresholds[0].height_m: is missing"),
        ({"thresholds": [{"height_m": 0.004}]}, "thresholds[0].line: is missing"),
        ({"carpets": [{"slip": 0.03}]}, "carpets[0].polygon: is missing"),
    ],
)
def test_a_missing_inner_key_is_missing_and_not_a_wrong_value(
    keys: dict[str, object], line: str
) -> None:
    with pytest.raises(FloorPlanError) as caught:
        parse_floorplan(room(**keys))
    assert str(caught.value) == line


def test_thousands_of_problems_are_reported_in_a_short_line() -> None:
    with pytest.raises(FloorPlanError) as caught:
        parse_floorplan(room(obstacles=[[] for _ in range(5000)]))
    assert "and 4988 more" in str(caught.value)
    assert len(str(caught.value)) < 3000
