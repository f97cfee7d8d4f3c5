"""The dashboard of a fleet in windows of several sizes; docs/fleet.md shows an example."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from support.root import ROOT
from tools.fleet.dashboard import FleetDashboard
from tools.fleet.member import Ended, Stopped, Target

PAGE = ROOT / "docs" / "fleet.md"


@dataclass
class Robot:
    target: Target
    status: dict[str, Any] | None = None
    ended: Ended | None = None
    stopped: Stopped | None = None


@dataclass
class Robots:
    members: list[Robot]
    message: str = ""
    unconfirmed: list[str] = field(default_factory=list)


def target(name: str) -> Target:
    return Target(name, name, f"/dev/{name}", None, {}, Path(f"runs/{name}.mcap"))


def status(
    session: str = "ready", run: str = "driving", stop: str = "none", *faults: str
) -> dict[str, Any]:
    return {
        "session": session,
        "run": run,
        "stop": stop,
        "faults": [*faults],
        "pose": {"x_m": 1.47, "y_m": -0.32, "theta_rad": 1.5708},
        "v_m_s": 0.2,
        "path_m": 31.4,
        "planner": "drive",
        "power": {"battery_v": 15.2},
    }


FLEET = Robots(
    [
        Robot(
            target("kitchen"),
            status(),
            stopped=Stopped(confirmed=True, text="confirmed by the device"),
        ),
        Robot(
            target("hall"),
            status("lost", "holding"),
            stopped=Stopped(confirmed=False, text="no answer"),
        ),
        Robot(target("bath"), ended=Ended(0, "all lanes are done", {"outcome": "complete"})),
        Robot(target("office")),
    ],
    "NOT CONFIRMED by hall: switch these robots off",
    ["hall"],
)


def drawn(fleet: Robots, width: int, height: int) -> list[str]:
    board = FleetDashboard(has_keys=True)
    board.fleet = fleet
    board.line("hall", "  612.48  session: its port is gone")
    board.line("bath", "  701.02  planner: all lanes are done")
    out = io.StringIO()
    console = Console(file=out, width=width, height=height, color_system=None)
    console.print(board.page(width, height, board.began_ns + 754_000_000_000), height=height)
    return [line.rstrip() for line in out.getvalue().rstrip().splitlines()]


def test_the_page_shows_the_dashboard() -> None:
    text = PAGE.read_text("utf-8").partition("<!-- dashboard -->\n```\n")[2]
    assert text.partition("```")[0].splitlines() == drawn(FLEET, 100, 16)


@pytest.mark.parametrize(("width", "height"), [(40, 12), (80, 24), (120, 40), (200, 60)])
def test_every_window_has_each_robot_its_stop_and_the_keys(width: int, height: int) -> None:
    lines = drawn(FLEET, width, height)
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    for name in ("kitchen", "hall", "bath", "office"):
        assert any(line.startswith(f"│ {name[:4]}") for line in lines), name
    assert any("STOP ALL" in line for line in lines)
    assert any("NOT CONFIRMED by hall" in line for line in lines)


def test_a_wide_window_has_the_pose_and_the_log() -> None:
    wide, narrow = ("\n".join(drawn(FLEET, width, 20)) for width in (140, 70))
    for text in ("kitchen.mcap", "+1.47 -0.32 m +90°", "31.4 m"):
        assert text in wide
        assert text not in narrow


def test_a_robot_that_is_not_heard_has_no_speed() -> None:
    lines = drawn(FLEET, 100, 16)
    (kitchen,) = [line for line in lines if line.startswith("│ kitchen")]
    (hall,) = [line for line in lines if line.startswith("│ hall ") and "lost" in line]
    assert "0.20 m/s" in kitchen
    assert "m/s" not in hall


def test_names_from_outside_are_shown_on_one_line() -> None:
    robots = Robots([Robot(target("a\x1b[31mb\nc"), status("ready", "driving", "none", "x\ny"))])
    lines = drawn(robots, 120, 20)
    assert any("a\\x1b[31mb\\nc" in line for line in lines)
