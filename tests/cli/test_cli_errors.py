"""Every error is one line with the documented exit status, never a traceback."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from support.cli import end, start, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

    from support.processes import Done

WALLS = [[0, 0], [3, 0], [3, 3], [0, 3]]
BOX = [[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5]]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def room_text(**changes: Any) -> str:  # noqa: ANN401 - any value in a file
    room = {"name": "r", "walls": WALLS, "obstacles": [], "start": [2, 2, 0], **changes}
    return json.dumps({key: value for key, value in room.items() if value is not ...})


BAD_ROOMS = {
    "nothing": ("", "JSON"),
    "not JSON": ('{"walls": [', "JSON"),
    "not an object": ("[1, 2]", "object"),
    "deep": ("[" * 100_000, "JSON"),
    "no walls": (room_text(walls=...), "walls"),
    "no start": (room_text(start=...), "start"),
    "two walls": (room_text(walls=WALLS[:2]), "walls"),
    "a corner of one number": (room_text(walls=[[0, 0], [3], [3, 3]]), "walls[1]"),
    "a corner of text": (room_text(walls=[[0, 0], [3, "0"], [3, 3]]), "walls[1]"),
    "true is no number": (room_text(walls=[[0, 0], [3, True], [3, 3]]), "walls[1]"),
    "NaN": (room_text(walls=[[0, 0], [3, float("nan")], [3, 3]]), "walls[1]"),
    "infinite": (room_text(start=[1, float("inf"), 0]), "start"),
    "as large as a town": (room_text(walls=[[0, 0], [3000, 0], [3, 3]]), "walls[1]"),
    "a number of 400 digits": (room_text(start=[1, 10**400, 0]), "room.json"),
    "a number of 5000 digits": (
        room_text(start=[1, "#", 0]).replace('"#"', "9" * 5000),
        "room.json",
    ),
    "walls in one line": (room_text(walls=[[0, 0], [1, 1], [2, 2]]), "walls"),
    "obstacles of the wrong form": (room_text(obstacles={"a": 1}), "obstacles"),
    "an obstacle of two corners": (room_text(obstacles=[BOX, BOX[:2]]), "obstacles[1]"),
    "a start of two numbers": (room_text(start=[1, 1]), "start"),
    "a start outside": (room_text(start=[5, 1, 0]), "start"),
    "a start in an obstacle": (room_text(obstacles=[BOX], start=[1, 1, 0]), "obstacles[0]"),
    "a start against a wall": (room_text(start=[0.1, 1, 0]), "start"),
    "a start against an obstacle": (room_text(obstacles=[BOX], start=[1.6, 1, 0]), "start"),
    "a name that is a number": (room_text(name=7), "name"),
}


@pytest.mark.parametrize("what", BAD_ROOMS)
@pytest.mark.parametrize("command", ["simulate", "emulate"])
def test_a_damaged_room(folder: Path, command: str, what: str) -> None:
    text, named = BAD_ROOMS[what]
    (folder / "room.json").write_text(text)
    done = sweepctl(command, "room.json")
    assert done.status == 2
    assert named in done.line
    assert "sys." not in done.line
    assert len(done.line) < 400
    assert done.out == ""
    assert [path.name for path in folder.iterdir()] == ["room.json"], "no log was begun"


def test_a_room_that_is_not_text(folder: Path) -> None:
    (folder / "room.json").write_bytes(b"\xff\xfe\x00{")
    done = sweepctl("simulate", "room.json")
    assert (done.status, "UTF-8" in done.line) == (2, True)


def test_a_room_that_is_not_there(folder: Path) -> None:
    done = sweepctl("simulate", "no-such-room")
    assert done.status == 2
    assert "'no-such-room'" in done.line
    assert "case-1" in done.line
    done = sweepctl("simulate", folder)
    assert done.status == 2
    assert str(folder) in done.line
    done = sweepctl("room", "show", "")
    assert (done.status, "no room ''" in done.line) == (2, True)


def test_a_room_larger_than_a_room(folder: Path) -> None:
    (folder / "room.json").write_text(" " * (4 * 1024 * 1024 + 1))
    done = sweepctl("simulate", "room.json")
    assert (done.status, "larger" in done.line) == (2, True)


BAD_ROBOTS = {
    "not TOML": ("wheel_base_m = ", "TOML"),
    "no such key": ("wheels = 3", "wheels"),
    "no such key in a table": ("[ultrasonic]\nq = 1", "ultrasonic.q"),
    "a number of 5000 digits": (f"wheel_base_m = {'9' * 5000}", "too many digits"),
    "text for a number": ('wheel_base_m = "a"', "wheel_base_m"),
    "NaN": ("wheel_base_m = nan", "wheel_base_m"),
    "nothing": ("cleaning_width_m = 0", "cleaning_width_m"),
    "a mouth wider than the body": ("cleaning_width_m = 0.5", "cleaning_width_m"),
    "a wrong range": ("[infrared_left]\nmin_range_m = 0.4", "infrared_left.min_range_m"),
}


@pytest.mark.parametrize("what", BAD_ROBOTS)
@pytest.mark.parametrize("command", [("simulate", "empty"), ("emulate",), ("connect", "/dev/null")])
def test_a_damaged_robot(folder: Path, command: tuple[str, ...], what: str) -> None:
    text, named = BAD_ROBOTS[what]
    (folder / "robot.toml").write_text(text)
    done = sweepctl(*command, "--robot", "robot.toml")
    assert done.status == 2
    assert named in done.line
    assert "robot.toml" in done.line
    assert [path.name for path in folder.iterdir()] == ["robot.toml"], "no log was begun"


def test_a_robot_that_does_not_fit_the_room(folder: Path) -> None:
    (folder / "robot.toml").write_text("robot_diameter_m = 0.75")
    done = sweepctl("simulate", "case-1", "--robot", "robot.toml")
    assert (done.status, "start" in done.line) == (2, True)
    assert sweepctl("simulate", "empty", "--robot", "none.toml").status == 2


USAGE = {
    "planner": (("simulate", "empty", "--planner", "lawn"), "'lawn'"),
    "plan": (("connect", "/dev/null", "--plan", "lawn"), "'lawn'"),
    "noise": (("simulate", "empty", "--noise", "loud"), "'loud'"),
    "noise of a device": (("emulate", "--noise", "loud"), "'loud'"),
    "link": (("emulate", "--link", "smoke"), "'smoke'"),
    "seed": (("simulate", "empty", "--seed", "-1"), "--seed"),
    "seed that is no number": (("simulate", "empty", "--seed", "x"), "'x'"),
    "time": (("simulate", "empty", "--max-time", "0"), "--max-time"),
    "time that is no number": (("simulate", "empty", "--max-time", "nan"), "--max-time"),
    "duration": (("connect", "/dev/null", "--duration", "nan"), "--duration"),
    "size that is no number": (
        ("connect", "/dev/null", "--rotate-mb", "nan"),
        "'nan' is not a number",
    ),
    "speed that is no number": (("simulate", "empty", "--speed", "nan"), "'nan' is not a number"),
    "playback that is no number": (("replay", "x", "--speed", "nan"), "'nan' is not a number"),
    "log without a name": (("simulate", "empty", "--out", ""), "'--out': the name is empty"),
    "folder without a name": (("generate", "md", "--out", ""), "'--out': the name is empty"),
    "tables without a name": (("export", "x", "--out", ""), "'--out': the name is empty"),
    "a folder that is a device": (("generate", "md", "--out", "/dev/full"), "not a folder"),
    "file without a name": (("info", ""), "'FILE': the name is empty"),
    "node": (("emulate", "--node", "16"), "--node"),
    "one delay of two": (("connect", "/dev/null", "--adapter-delay", "1"), "'1' is not OUT_MS"),
    "a delay below 0": (("connect", "/dev/null", "--adapter-delay", "1,-1"), "-1 ms"),
    "a delay that is no number": (("connect", "/dev/null", "--adapter-delay", "nan,0"), "nan ms"),
    "a plot without its step": (
        ("bringup", "/dev/null", "--step", "rest", "--plot", "x.png"),
        "--plot needs the step control",
    ),
    "a planner of the device without supervision": (
        ("connect", "/dev/null", "--onboard", "paper"),
        "--onboard needs --supervise",
    ),
    "a bit rate without CAN": (("emulate", "--bitrate", "500000"), "--bitrate needs --link"),
    "force without a file": (("emulate", "--force"), "--force needs --truth"),
    "an unknown option beside a number": (
        ("param", "set", "/dev/null", "gyro_bias", "-0.01", "--sav"),
        "No such option '--sav'",
    ),
    "a part of an IMU twice": (
        ("generate", "dbc", "--out", "x", "--imu", "accel=1,accel=2"),
        "accel is given twice",
    ),
    "clear": (("connect", "/dev/null", "--clear-stop"), "--plan"),
    "option": (("simulate", "empty", "--fast"), "--fast"),
    "room": (("simulate",), "ROOM"),
    "command": (("swep",), "'swep'"),
    "file": (("info",), "FILE"),
}


@pytest.mark.parametrize("what", USAGE)
def test_wrong_usage(folder: Path, what: str) -> None:
    arguments, named = USAGE[what]
    done = sweepctl(*arguments)
    assert done.status == 2
    assert named in done.line
    assert "--help" in done.line
    assert done.out == ""
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (("simulate", "no-such-room"), 2),
        (("simulate", "empty", "--planner", "lawn"), 2),
        (("connect", "/dev/no-such-port"), 3),
        (("info", "none.mcap"), 1),
    ],
)
def test_with_json_a_failure_is_one_object_too(
    folder: Path, arguments: tuple[str, ...], status: int
) -> None:
    del folder
    done = sweepctl(*arguments, "--json")
    assert done.status == status
    assert done.json["exit_status"] == status
    assert done.json["reason"] in done.line


def test_as_a_process(tmp_path: Path) -> None:
    def ended(*arguments: str) -> Done:
        return end(start(*arguments, cwd=tmp_path))

    done = ended("simulate", "no-such-room", "--json")
    assert (done.status, done.json["exit_status"]) == (2, 2)
    assert done.line.startswith("sweepctl: no room")


def test_a_reader_that_leaves(tmp_path: Path) -> None:
    process = start("info", "--help", cwd=tmp_path)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert "Traceback" not in process.stderr.read()
    process.stderr.close()
    process.wait()
