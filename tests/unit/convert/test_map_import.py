"""ROS maps and SVG floor plans become rooms with the correct size and position."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from bridge.convert.map_import import import_map
from bridge.convert.mask_outlines import outlines, simplified
from bridge.floor_plan.floor_plan import FloorPlanError, signed_area_m2
from bridge.motion.geometry import Pose2

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.floor_plan.floor_plan import FloorPlan

FREE, UNKNOWN, WALL = 254, 205, 0


def ros_map(
    tmp_path: Path, cells: np.ndarray, origin: str = "[-1.0, 2.0, 0.0]", **more: object
) -> Path:
    """Write a map with cells of 0.1 m; the first row of ``cells`` is the top row of the image."""
    Image.fromarray(cells.astype(np.uint8)).save(tmp_path / "flat.pgm")
    keys: dict[str, object] = {
        "image": "flat.pgm",
        "resolution": 0.1,
        "origin": origin,
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
        **more,
    }
    path = tmp_path / "flat.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in keys.items()))
    return path


def flat() -> np.ndarray:
    """Return a floor of 3 m × 2 m with walls, a table, unknown cells around, and a second room."""
    cells = np.full((30, 60), UNKNOWN)
    cells[4:26, 4:36] = WALL
    cells[5:25, 5:35] = FREE
    cells[10:14, 20:26] = WALL
    cells[5:10, 40:45] = FREE
    return cells


def read(path: Path, start: Pose2 | None = None, tolerance_m: float = 0.0) -> FloorPlan:
    return import_map(path, scale_m=None, tolerance_m=tolerance_m, start=start)


def test_a_ros_map_has_the_place_of_its_origin_and_the_size_of_its_cells(tmp_path: Path) -> None:
    plan = read(ros_map(tmp_path, flat()))
    assert plan.name == "flat"
    # Columns 5 to 35 are free: 0.1 m each, from x = −1 m. Rows 5 to 25 of 30 are free, counted from
    # the top or from the bottom.
    assert plan.bounds() == pytest.approx((-0.5, 2.5, 2.5, 4.5))
    assert signed_area_m2(plan.walls) == pytest.approx(6.0)
    (table,) = plan.obstacles
    assert abs(signed_area_m2(table)) == pytest.approx(0.24)
    assert min(y for _, y in table) == pytest.approx(2.0 + 1.6)
    assert len(plan.walls) == len(table) == 4


def test_the_start_is_the_widest_place_or_the_given_one(tmp_path: Path) -> None:
    path = ros_map(tmp_path, flat())
    plan = read(path)
    nearest = min(
        math.dist((plan.start.x_m, plan.start.y_m), corner)
        for polygon in (plan.walls, *plan.obstacles)
        for corner in polygon
    )
    assert nearest > 0.7
    other = read(path, start=Pose2(3.2, 4.3, 1.0))
    assert other.start == Pose2(3.2, 4.3, 1.0)
    assert signed_area_m2(other.walls) == pytest.approx(0.25), "the piece with the start"
    with pytest.raises(FloorPlanError, match="is not free"):
        read(path, start=Pose2(0.0, 0.0, 0.0))


def test_the_yaw_of_the_origin_turns_the_map(tmp_path: Path) -> None:
    plan = read(ros_map(tmp_path, flat(), origin=f"[0.0, 0.0, {math.pi / 2}]"))
    assert plan.bounds() == pytest.approx((-2.5, 0.5, -0.5, 3.5))


def test_negate_turns_black_and_white(tmp_path: Path) -> None:
    plan = read(ros_map(tmp_path, 255 - flat(), negate=1))
    assert signed_area_m2(plan.walls) == pytest.approx(6.0)


def test_unknown_floor_is_no_floor(tmp_path: Path) -> None:
    cells = flat()
    cells[5:25, 5:15] = UNKNOWN
    assert signed_area_m2(read(ros_map(tmp_path, cells)).walls) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("more", "printed"),
    [
        ({"mode": "scale"}, "mode: 'scale' is not trinary"),
        ({"resolution": -1}, "resolution: -1 is not from 0.001 to 1"),
        ({"image": "none.pgm"}, "cannot read"),
        ({"image": "flat.yaml"}, "is no image that can be read"),
        ({"origin": "3"}, "origin: must be"),
        ({"negate": 7}, "negate: 7 is not 0 or 1"),
        ({"negate": [0]}, r"negate: \[0\] is not 0 or 1"),
        ({"occupied_thresh": 0.1}, "occupied_thresh: 0.1 is below free_thresh, 0.196"),
        ({"image": '"m\\0.pgm"'}, "image: must be the name"),
        ({"x": "2020-13-45"}, "flat.yaml is not valid YAML: line 7: '2020-13-45' is no timestamp"),
        ({"resolution": "0x_"}, "line 2: '0x_' is no int"),
        ({"resolution": "0b_"}, "line 2: '0b_' is no int"),
        ({"x": "!!int foo"}, "'foo' is no int"),
        ({"x": "!!bool foo"}, "'foo' is no bool"),
        ({"x": "!!timestamp foo"}, "'foo' is no timestamp"),
        ({"x": "["}, "line 8: expected the node content, but found '<stream end>'"),
        ({"free_thresh": 0.0001, "origin": "[0, 0, 0]"}, "no cell of the map is free"),
    ],
)
def test_a_wrong_ros_map_is_named(tmp_path: Path, more: dict[str, object], printed: str) -> None:
    origin = str(more.pop("origin", "[0, 0, 0]"))
    path = ros_map(tmp_path, flat(), origin=origin, **more)
    with pytest.raises(FloorPlanError, match=printed) as caught:
        read(path)
    assert "\n" not in str(caught.value)


SVG = """<svg xmlns="http://www.w3.org/2000/svg" width="400" height="300">
  <rect id="walls" x="0" y="0" width="400" height="300"/>
  <g id="furniture" transform="translate(100 50)">
    <rect x="0" y="0" width="60" height="40"/>
    <circle cx="150" cy="150" r="20"/>
  </g>
  <path id="rug" d="M 20 220 h 80 v 60 h -80 z"/>
  <line class="threshold" x1="300" y1="0" x2="300" y2="80"/>
  <polygon id="stairs" points="340,220 400,220 400,300"/>
  <circle id="start" cx="60" cy="140" r="16"/>
</svg>
"""


def test_an_svg_floor_plan_has_metres_and_y_upward(tmp_path: Path) -> None:
    path = tmp_path / "plan.svg"
    path.write_text(SVG)
    plan = import_map(path, scale_m=0.01, tolerance_m=0.002, start=None)
    assert plan.bounds() == pytest.approx((0.0, 0.0, 4.0, 3.0))
    table, pillar = plan.obstacles
    assert sorted(table) == [(1.0, 2.1), (1.0, 2.5), (1.6, 2.1), (1.6, 2.5)]
    assert abs(signed_area_m2(pillar)) == pytest.approx(math.pi * 0.2**2, rel=0.02)
    assert len(pillar) < 64
    assert abs(signed_area_m2(plan.carpets[0].polygon)) == pytest.approx(0.48)
    assert {plan.thresholds[0].begin, plan.thresholds[0].end} == {(3.0, 3.0), (3.0, 2.2)}
    assert abs(signed_area_m2(plan.cliffs[0])) == pytest.approx(0.24)
    assert plan.start == pytest.approx((0.6, 1.6, 0.0), abs=0.01)


def test_without_names_the_largest_shape_is_the_walls(tmp_path: Path) -> None:
    path = tmp_path / "plain.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><rect width="30" height="10" x="50" y="50"/>'
        '<rect width="200" height="100"/></svg>'
    )
    plan = import_map(path, scale_m=0.02, tolerance_m=0.0, start=None)
    assert signed_area_m2(plan.walls) == pytest.approx(8.0)
    assert len(plan.obstacles) == 1


def named(tmp_path: Path, *, shape: str = "", group: str = "") -> FloorPlan:
    """Import the walls, and one square with these attributes in a group."""
    path = tmp_path / "named.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><rect id="walls" width="300" height="200"/>'
        f'<g {group}><rect {shape} x="50" y="50" width="20" height="20"/></g></svg>'
    )
    return import_map(path, scale_m=0.01, tolerance_m=0.0, start=None)


@pytest.mark.parametrize(
    "name",
    [
        "bathroom-rug",
        "bathroomRug",
        "living room rug",
        "LIVING_ROOM_RUG",
        "rug2",
        "wall rug",
        "SVGCarpet",
        "carpets",
    ],
)
def test_a_rug_in_a_room_is_a_carpet(tmp_path: Path, name: str) -> None:
    assert len(named(tmp_path, shape=f'id="{name}"').carpets) == 1
    assert len(named(tmp_path, group=f'id="{name}"').carpets) == 1


@pytest.mark.parametrize("name", ["drywall", "wallpaper", "bathroom", "restart", "rugby", "Würfel"])
def test_a_part_of_a_word_means_nothing(tmp_path: Path, name: str) -> None:
    assert len(named(tmp_path, shape=f'id="{name}"').obstacles) == 1


def test_a_group_named_after_a_room_contains_its_furniture(tmp_path: Path) -> None:
    group = 'xmlns:k="http://www.inkscape.org/namespaces/inkscape" k:label="Living room"'
    assert len(named(tmp_path, group=group).obstacles) == 1
    assert len(named(tmp_path, shape='class="rug"', group=group).carpets) == 1


def test_the_own_name_of_a_shape_prevails_over_its_group(tmp_path: Path) -> None:
    assert len(named(tmp_path, shape='id="stairs"', group='id="furniture"').cliffs) == 1


def test_a_shape_named_room_is_the_walls(tmp_path: Path) -> None:
    path = tmp_path / "room.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><rect id="garden" width="900" height="900"/>'
        '<rect id="living-room" width="300" height="200"/></svg>'
    )
    plan = import_map(path, scale_m=0.01, tolerance_m=0.0, start=Pose2(1.0, 8.0, 0.0))
    assert signed_area_m2(plan.walls) == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("<svg", "is not valid SVG"),
        (
            SVG.replace("translate(100 50)", "rotate(foo)"),
            r"transform of g: 'rotate\(foo\)' is wrong",
        ),
        ('<svg xmlns="http://www.w3.org/2000/svg"/>', "has no shape"),
        (SVG.replace('"furniture"', '"walls2"'), "3 shapes are named walls"),
    ],
)
def test_a_wrong_svg_is_named(tmp_path: Path, text: str, printed: str) -> None:
    path = tmp_path / "plan.svg"
    path.write_text(text)
    with pytest.raises(FloorPlanError, match=printed):
        import_map(path, scale_m=0.01, tolerance_m=0.0, start=None)


def test_outlines_of_cells_that_touch_at_a_corner_stay_apart() -> None:
    mask = np.array([[1, 0], [0, 1]], dtype=bool)
    assert sorted(len(loop) for loop in outlines(mask)) == [4, 4]


def test_outlines_enclose_the_area_of_any_mask() -> None:
    mask = np.random.default_rng(3).random((30, 40)) < 0.6
    area = sum(
        signed_area_m2(tuple((float(x), float(y)) for x, y in loop)) for loop in outlines(mask)
    )
    assert area == pytest.approx(np.count_nonzero(mask))


def test_slanted_walls_lose_their_steps_and_single_cells_stay(tmp_path: Path) -> None:
    rows, columns = np.mgrid[:60, :60]
    cells = np.where(abs(rows - 30) + abs(columns - 30) < 25, FREE, WALL)
    cells[30, 36] = WALL
    path = ros_map(tmp_path, cells)
    plan = import_map(path, scale_m=None, tolerance_m=None, start=None)
    assert len(plan.walls) <= 8
    assert len(read(path).walls) > 50
    (cell,) = plan.obstacles
    assert abs(signed_area_m2(cell)) == pytest.approx(0.01)


def test_simplification_keeps_within_its_tolerance() -> None:
    circle = [(math.cos(t), math.sin(t)) for t in np.linspace(0.0, 2.0 * math.pi, 400)[:-1]]
    fewer = simplified(circle, 0.01)
    assert len(fewer) < 40
    assert signed_area_m2(fewer) == pytest.approx(math.pi, rel=0.02)
