"""Probable mistakes in a room or a robot file are reported at the start of a run, and logged."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from support.cli import decoded, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

_IR = "[infrared_left]\ny_m = 0.14\n"


def _room(path: Path, **keys: object) -> Path:
    walls = [[0, 0], [3, 0], [3, 2], [0, 2]]
    path.write_text(json.dumps({"walls": walls, "start": [0.5, 0.5, 0.0], **keys}))
    return path


def test_a_simulation_warns_and_logs_the_warning(tmp_path: Path) -> None:
    room = _room(tmp_path / "room.json", obstacle=[])
    robot = tmp_path / "robot.toml"
    robot.write_text(_IR)
    log = tmp_path / "run.mcap"
    asked = ("--robot", robot, "--max-time", "1", "--out", log, "--json")
    done = sweepctl("simulate", room, *asked)
    assert done.json["outcome"] == "timeout"
    lines = done.err.splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("warning: robot: infrared_left: a wall that touches the robot is 20")
    assert lines[1].startswith('warning: room: "obstacle"')
    reported = [v.text for _, v in decoded(log, "/events") if v.kind == "caution"]
    assert [f"warning: robot: {reported[0]}", f"warning: room: {reported[1]}"] == lines


def test_a_start_against_a_wall_is_rejected_before_a_port_is_opened(tmp_path: Path) -> None:
    room = _room(tmp_path / "room.json", start=[0.1, 0.5, 0.0])
    for command in (
        ("simulate", room),
        ("emulate", room),
        ("connect", tmp_path / "no-port", "--room", room),
    ):
        done = sweepctl(*command)
        assert done.status == 2
        assert "overlaps a wall or an obstacle by 60.0 mm" in done.line
    assert not (tmp_path / "runs").exists()
