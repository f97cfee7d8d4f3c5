"""Shell completion of rooms, robots, parameters, faults, rules and runs."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import pytest

from support.cli import sweepctl
from support.processes import COMMAND, environment

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("completion")
    (where / "runs").mkdir()
    (where / "small.toml").touch()
    (where / "study.json").touch()
    (where / "sweepctl.toml").write_text('[robots.kitchen]\nport = "/dev/ttyUSB7"\n')
    run = ("simulate", "empty", "--planner", "u-shape", "--max-time", "2", "--out", "runs/one.mcap")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(where)
        assert sweepctl(*run).status == 1, "out of time"
        assert sweepctl("runs", "tag", "latest", "carpet").status == 0
    return where


def offered(folder: Path, *words: str) -> list[str]:
    """Return the completions that bash gets for the last word."""
    asked = " ".join(("sweepctl", *words))
    done = subprocess.run(
        COMMAND,
        cwd=folder,
        env=environment(
            _SWEEPCTL_COMPLETE="bash_complete",
            COMP_WORDS=asked,
            COMP_CWORD=str(len(words)),
            SWEEPCTL_CONFIG="sweepctl.toml",
        ),
        capture_output=True,
        text=True,
        check=True,
    )
    return [line.partition(",")[2] for line in done.stdout.splitlines() if line]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("simulate", "two"), ["two-rooms"]),
        (("simulate", "st"), ["studio-flat", "study.json"]),
        (("connect", "kit"), ["kitchen"]),
        (("simulate", "case-1", "--robot", "sm"), ["small.toml"]),
        (("param", "get", "kitchen", "max_s"), ["max_speed"]),
        (("simulate", "case-1", "--fault", "clock"), ["clock-drift", "clock-jump"]),
        (
            ("simulate", "case-1", "--supervise-rule", "tilt.a"),
            ["tilt.after_s=", "tilt.angle_deg="],
        ),
        (("experiment", "compare", "--rooms", "case-1,ca"), ["case-1,case-2"]),
        (("experiment", "compare", "--planners", "paper,re"), ["paper,recovery"]),
        (("info", "runs/"), ["runs/latest", "runs/one.mcap"]),
        (("info", "latest~1"), ["latest~1"]),
        (("diff", "latest", "la"), ["latest"]),
        (("runs", "--tag", "c"), ["carpet"]),
        (("runs", "compare", "--by", "plan"), ["planner"]),
    ],
    ids=" ".join,
)
def test_a_shell_is_offered(folder: Path, words: tuple[str, ...], expected: list[str]) -> None:
    assert offered(folder, *words) == expected


def test_nothing_is_offered_where_nothing_fits(folder: Path) -> None:
    for words in (("runs", "--tag", "x"), ("simulate", "case-1", "--fault", "zz")):
        assert offered(folder, *words) == []
