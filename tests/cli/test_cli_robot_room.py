"""``robot`` and ``room``: each error of a file on its own line, and pictures."""

from __future__ import annotations

import json
import math
import re
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from bridge.config import load_robot
from bridge.motion.robot_model import RobotModel
from support.cli import end, start, sweepctl
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

PNG = b"\x89PNG"
WRONG_ROBOT = """
whel_base_m = 0.2
wheel_diameter_m = 7
[infrared_lef]
x_m = 0.1
[supervise.stal]
reaction = "stop"
"""


def test_a_new_robot_file_is_the_default_robot_and_is_valid(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert sweepctl("robot", "new", str(path)).status == 0
    assert load_robot(path)[0] == RobotModel()
    done = sweepctl("robot", "check", str(path))
    assert (done.status, done.out) == (0, "")
    assert "valid, 0 warnings" in done.err


def test_every_comment_of_a_new_robot_file_can_be_made_a_key(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    sweepctl("robot", "new", str(path))
    text = re.sub(r"^# (?=\[|\w+ = )", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    path.write_text(text, encoding="utf-8")
    assert "[supervise.stall]\n" in text
    assert sweepctl("robot", "check", str(path)).status == 0


def test_a_generated_room_is_the_same_each_time_and_takes_another_start() -> None:
    shown = sweepctl("room", "show", "generated:legs:422", "--json")
    assert shown.status == 0
    assert json.loads(shown.out)["room"] == "legs-422"
    assert sweepctl("room", "show", "generated:legs:422", "--json").out == shown.out
    moved = sweepctl("room", "show", "generated:legs:422", "--start", "0.5,2.4,0", "--json")
    assert json.loads(moved.out)["start"] != json.loads(shown.out)["start"]


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("generated:foo:1", "one of the kinds box, ell, "),
        ("generated:box", "the name must be generated:KIND:N"),
        ("generated:box:²", "the name must be generated:KIND:N"),
        (f"generated:box:{'9' * 5000}", "a number N of up to 18 digits"),
        ("layout:nope", "no layout 'nope': give one of wall-obstacle, "),
        ("nowhere", "two-rooms, generated:KIND:N, layout:NAME"),
    ],
)
def test_the_error_of_a_wrong_name_lists_the_right_ones(name: str, problem: str) -> None:
    done = sweepctl("simulate", name)
    assert done.status == 2
    assert problem in done.line


def test_a_robot_file_is_not_replaced_unasked(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("name = 'kept'\n")
    assert sweepctl("robot", "new", str(path)).status == 1
    assert path.read_text() == "name = 'kept'\n"
    assert sweepctl("robot", "new", str(path), "--force").status == 0
    assert "robot_diameter_m" in path.read_text(encoding="utf-8")


def test_robot_check_prints_each_problem_on_a_line_with_the_nearest_key(tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(WRONG_ROBOT)
    done = sweepctl("robot", "check", str(path))
    assert (done.status, done.out) == (2, "")
    lines = done.err.splitlines()
    assert len(lines) == 4
    for printed in (
        "whel_base_m: no such key; did you mean wheel_base_m?",
        "wheel_diameter_m: 7 is out of range",
        "infrared_lef: no such key; did you mean infrared_left?",
        "supervise.stal: no such key; did you mean supervise.stall?",
    ):
        assert sum(printed in line for line in lines) == 1, printed
    found = json.loads(sweepctl("robot", "check", str(path), "--json").out)
    assert (found["valid"], found["exit_status"], len(found["problems"])) == (False, 2, 4)


def test_robot_check_warns_of_unsuitable_values(tmp_path: Path) -> None:
    path = tmp_path / "near.toml"
    path.write_text("[infrared_left]\ny_m = 0.14\n")
    done = sweepctl("robot", "check", str(path))
    assert done.status == 0
    assert "warning: infrared_left: a wall that touches the robot is 20 mm" in done.err
    assert "valid, 1 warning\n" in done.err


def test_robot_show_prints_and_draws(tmp_path: Path) -> None:
    path, png = tmp_path / "mine.toml", tmp_path / "mine.png"
    path.write_text("name = 'mine'\n")
    done = sweepctl("robot", "show", str(path), "--png", str(png))
    assert done.status == 0, done.err
    assert "footprint" in done.out
    assert png.read_bytes().startswith(PNG)
    facts = json.loads(sweepctl("robot", "show", str(path), "--json").out)
    assert facts["infrared_left"]["hull_m"] == pytest.approx(0.06, abs=1e-3)
    assert 0.9 < facts["hull_blind_share"] < 1.0


ROOM = {"walls": [[0, 0], [4, 0], [4, 3], [0, 3]], "start": [0.5, 0.5, 0.0]}
DIVIDER = [
    [[2.9, 0], [3, 0], [3, 1.4], [2.9, 1.4]],
    [[2.9, 1.65], [3, 1.65], [3, 3], [2.9, 3]],
]
"""A wall across the room with a gap of 25 cm, too narrow for the default robot."""


def written(path: Path, **keys: object) -> str:
    path.write_text(json.dumps({**ROOM, **keys}))
    return str(path)


def test_room_check_prints_each_problem_on_a_line(tmp_path: Path) -> None:
    room = written(tmp_path / "wrong.json", start=[0.5, 0.5, 90], obstacles=[[1]], carpet=[])
    done = sweepctl("room", "check", room)
    assert (done.status, done.out) == (2, "")
    assert len(done.err.splitlines()) == 3
    for printed in ("heading of 90 rad", "obstacles[0]: must be a list", 'did you mean "carpets"?'):
        assert printed in done.err


def test_room_check_warns_of_crossings_strays_and_floor_that_is_cut_off(tmp_path: Path) -> None:
    bow = [[1, 1], [1.5, 1.5], [1.5, 1], [1, 1.8]]
    far = [[8, 8], [9, 8], [9, 9]]
    room = written(tmp_path / "odd.json", obstacles=[*DIVIDER, bow], cliffs=[far], obstacle=[])
    done = sweepctl("room", "check", room, "--json")
    assert done.status == 0
    warnings = json.loads(done.out)["warnings"]
    assert len(warnings) == 4
    for printed in (
        'did you mean "obstacles"?',
        "obstacles[2]: its outline crosses itself near (1.31, 1.31)",
        "cliffs[0]: it lies outside the walls",
        "cannot get there from the start",
    ):
        assert any(printed in warning for warning in warnings), printed


def test_room_check_depends_on_the_robot(tmp_path: Path) -> None:
    room = written(tmp_path / "gap.json", obstacles=DIVIDER)
    small = tmp_path / "small.toml"
    small.write_text(
        "robot_diameter_m = 0.2\nwheel_base_m = 0.14\ncleaning_width_m = 0.1\n"
        "[ultrasonic]\nx_m = 0.06\n[infrared_left]\nx_m = 0.03\ny_m = 0.05\n"
        "[infrared_right]\nx_m = 0.03\ny_m = -0.05\n"
    )
    assert "cut off" in sweepctl("room", "check", room).err
    assert "cut off" not in sweepctl("room", "check", room, "--robot", str(small)).err


def test_room_check_takes_every_shipped_room() -> None:
    for path in (ROOT / "sim_device" / "rooms").glob("*.json"):
        done = sweepctl("room", "check", path.stem)
        assert (done.status, "valid, 0 warnings" in done.err) == (0, True), done.err


def test_room_show_draws_and_gives_the_areas(tmp_path: Path) -> None:
    png = tmp_path / "empty.png"
    done = sweepctl("room", "show", written(tmp_path / "r.json"), "--png", str(png), "--json")
    assert done.status == 0, done.err
    facts = json.loads(done.out)
    assert facts["free_m2"] == pytest.approx(12.0, abs=0.02)
    # The footprint, a disc of radius 16 cm, does not reach (4 − π) r² in the corners.
    assert facts["reachable_m2"] == pytest.approx(12.0 - 0.8584 * 0.16**2, abs=0.02)
    # the mouth stays 8 cm from the walls: 3.84 × 2.84 minus the rounded corners
    assert facts["sweepable_m2"] == pytest.approx(3.84 * 2.84 - 0.8584 * 0.08**2, abs=0.03)
    assert png.read_bytes().startswith(PNG)


@pytest.mark.parametrize("backend", ["foo", "tkagg"])
def test_a_picture_needs_no_display_and_no_backend_of_one(tmp_path: Path, backend: str) -> None:
    png = tmp_path / "room.png"
    words = ("room", "show", "empty", "--png", png)
    done = end(start(*words, cwd=tmp_path, env={"MPLBACKEND": backend}))
    assert (done.status, png.read_bytes()[:4]) == (0, b"\x89PNG"), done.err


def test_the_rooms_page_can_be_followed(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "rooms.md").read_text(encoding="utf-8")
    example = re.search(r"^```json\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert example is not None
    (tmp_path / "study.json").write_text(example[1])
    commands = re.findall(r"^sweepctl (room (?:check|show) .*)$", page, re.MULTILINE)
    assert len(commands) == 2
    for line in commands:
        words = [str(tmp_path / w) if w.startswith("study.") else w for w in line.split()]
        done = sweepctl(*words)
        assert done.status == 0, done.err
        assert "warning: " not in done.err
    assert (tmp_path / "study.png").read_bytes().startswith(PNG)


def test_room_import_writes_a_room_that_can_be_used(tmp_path: Path) -> None:
    cells = np.full((60, 80), 0, dtype=np.uint8)
    cells[5:55, 5:75] = 254
    Image.fromarray(cells).save(tmp_path / "map.pgm")
    keys = "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
    (tmp_path / "map.yaml").write_text(keys + "occupied_thresh: 0.65\nfree_thresh: 0.25\n")
    out = tmp_path / "flat.json"
    command = ("room", "import", tmp_path / "map.yaml", "--out", out, "--start", "1.5,0.6,90")
    done = sweepctl(*command)
    assert (done.status, done.out) == (0, ""), done.err
    facts = json.loads(sweepctl("room", "show", str(out), "--json").out)
    assert facts["free_m2"] == pytest.approx(3.5 * 2.5, abs=0.02)
    assert facts["start"] == pytest.approx([1.5, 0.6, math.pi / 2])
    assert sweepctl(*command).status == 1, "an existing room was replaced"
    near = sweepctl(*command[:-1], "0.3,0.3,0", "--force")
    assert (near.status, "overlaps a wall" in near.err) == (2, True)


def test_start_replaces_the_start_of_a_room() -> None:
    moved = json.loads(sweepctl("room", "show", "empty", "--start", "1,1.2,90", "--json").out)
    assert moved["start"] == pytest.approx([1.0, 1.2, math.pi / 2])
    for text, printed in (
        ("1,1", "is not X,Y,DEG"),
        ("1,x,2", "is not X,Y,DEG"),
        ("0,0,0", "start:"),
    ):
        done = sweepctl("simulate", "empty", "--start", text)
        assert (done.status, printed in done.err) == (2, True), done.err
    needs = sweepctl("connect", "/dev/none", "--start", "1,1,0")
    assert (needs.status, "--start needs --room" in needs.err) == (2, True)


def test_maps_without_their_libraries_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "map.yaml").write_text("image: x\n")
    (tmp_path / "plan.svg").write_text("<svg/>")
    monkeypatch.setitem(sys.modules, "yaml", None)
    monkeypatch.setitem(sys.modules, "svgelements", None)
    for words in (("map.yaml",), ("plan.svg", "--scale", "0.01")):
        file, *more = words
        done = sweepctl("room", "import", tmp_path / file, *more, "--out", tmp_path / "r.json")
        assert done.status == 1
        assert "pip install 'sweepctl[maps]'" in done.line


@pytest.mark.parametrize("command", ["robot", "room"])
def test_check_names_a_file_that_cannot_be_read_once(tmp_path: Path, command: str) -> None:
    path = tmp_path / "binary.json"
    path.write_bytes(b"\x00\xff\xfe")
    for name in (path, tmp_path / "none.json"):
        done = sweepctl(command, "check", str(name))
        assert (done.status, done.line.count(name.name)) == (2, 1)
