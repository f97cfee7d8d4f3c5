"""Port, time, coverage, log and viewer on the dashboard, and the display of a lost robot."""

from __future__ import annotations

import io
import random
from array import array

import pytest
from rich.console import Console

from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from tools.live.heading import LiveCoverage, RunFacts
from tools.live.live import Dashboard, EventLines
from tools.live.map import legend, swept_picture
from tools.live.tables import planner_table, status_line
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.settings import SweeperSettings
from tools.virtual.simulated_sweeper import SimulatedSweeper

MODEL = RobotModel()
PAGE = "http://127.0.0.1:9090/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A9876%2Fproxy"
LOG = "runs/20260101T000000Z-case-1.mcap"
ROOM = parse_floorplan(
    """{"walls": [[0,0],[4,0],[4,3],[0,3]], "start": [0.4,0.4,0],
    "obstacles": [[[2.6,1.8],[3.2,1.8],[3.2,2.4],[2.6,2.4]]],
    "carpets": [{"polygon": [[0.8,0.8],[2.2,0.8],[2.2,2.2],[0.8,2.2]]}],
    "thresholds": [{"line": [[2.5,0],[2.5,1.2]], "height_m": 0.004}],
    "cliffs": [[[3.4,0.2],[3.9,0.2],[3.9,0.8],[3.4,0.8]]]}"""
)
SIZES = [(80, 24), (120, 40), (200, 60)]


def now_ns(sweeper: SimulatedSweeper) -> int:
    return round(sweeper.time_s * 1e9) + HOST_BOOT_NS


def drawn(picture: Dashboard, width: int, height: int, at_ns: int) -> str:
    out = io.StringIO()
    console = Console(file=out, width=width, height=height, force_terminal=True, color_system=None)
    console.print(picture.layout(width, height, at_ns), height=height)
    lines = out.getvalue().splitlines()
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    return "\n".join(lines)


@pytest.fixture(name="lost", scope="module")
def _lost() -> SimulatedSweeper:
    """Return a sweeper that lost its port 5 s ago, in a lane at cruise speed."""
    sweeper = SimulatedSweeper(SweeperSettings(noise="none"))
    planner = make_planner("paper", MODEL, random.Random(0))
    sweeper.host.mission.start(PlanRunner(planner, MODEL))
    sweeper.run(8.0)
    assert sweeper.host.estimator.v_m_s > 0.15
    sweeper.fault("unplug")
    sweeper.run(5.0)
    return sweeper


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_port_time_coverage_log_and_viewer_are_shown_whole(width: int, height: int) -> None:
    sweeper = SimulatedSweeper(SweeperSettings(noise="none"))
    poses = array("d")
    for k in range(200):
        poses.extend((0.02 * k, 0.5 + 0.01 * k, 0.5, 0.0))
    coverage = LiveCoverage(sweeper.plan, MODEL, poses)
    began_ns = now_ns(sweeper) - 3_723 * 10**9
    facts = RunFacts("/dev/ttyUSB0", LOG, PAGE, "paper", sweeper.plan, coverage, began_ns)
    picture = Dashboard(sweeper.host.snapshot, EventLines(NullSink(), plain=False), facts=facts)
    text = drawn(picture, width, height, now_ns(sweeper))
    share = 100.0 * coverage.share(now_ns(sweeper) / 1e9)
    assert share > 1.0
    for part in ("port /dev/ttyUSB0", "elapsed 1:02:03", f"coverage {share:.1f} %", LOG, PAGE):
        assert part in text, part


def test_live_coverage_is_the_runs_figure() -> None:
    poses = array("d")
    coverage = LiveCoverage(ROOM, MODEL, poses)
    assert coverage.share(0.0) == 0.0
    for k in range(300):
        poses.extend((0.02 * k, 0.4 + 0.01 * k, 0.4, 0.0))
    shown = coverage.share(10.0)
    # the lane is 3 m by 0.16 m; the sweepable area is between 9 m² and 12 m²
    assert 0.48 / 12.0 < shown < 0.48 / 9.0


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_a_lost_robot_shows_a_countdown_and_no_speed(
    lost: SimulatedSweeper, width: int, height: int
) -> None:
    picture = Dashboard(lost.host.snapshot, EventLines(NullSink(), plain=False))
    text = drawn(picture, width, height, now_ns(lost))
    assert "lost, run ends in 26 s" in text
    assert "m/s" not in text, "without encoder samples the speed is unknown"
    assert "velocity" not in text, "the mode is unknown"
    later = drawn(picture, width, height, now_ns(lost) + 10 * 10**9)
    assert "run ends in 16 s" in later


def test_the_plain_line_of_a_lost_robot_has_no_speed_either(lost: SimulatedSweeper) -> None:
    line = status_line(lost.host.snapshot(), now_ns(lost) / 1e9)
    assert "run ends in 26 s" in line
    assert "m/s" not in line


def test_a_silent_encoder_leaves_no_frozen_speed() -> None:
    sweeper = SimulatedSweeper(SweeperSettings(noise="none"))
    sweeper.run(0.05)  # until the first encoder sample, after the handshake
    assert "speed +0.00 m/s" in status_line(sweeper.host.snapshot(), now_ns(sweeper) / 1e9)
    assert "speed -" in status_line(sweeper.host.snapshot(), now_ns(sweeper) / 1e9 + 0.7)


@pytest.mark.parametrize(
    ("planner", "shown", "hidden"),
    [("paper", "Prev-D", "lanes"), ("recovery", "lanes", "Prev-D"), ("random", "turns", "Length")],
)
def test_the_papers_variables_are_for_its_planner_alone(
    planner: str, shown: str, hidden: str
) -> None:
    sweeper = SimulatedSweeper(SweeperSettings(noise="none"))
    made = make_planner(planner, MODEL, random.Random(0))
    sweeper.host.mission.start(PlanRunner(made, MODEL))
    table = planner_table(sweeper.host.snapshot(), planner)
    text = " ".join(str(cell) for column in table.columns for cell in column.cells)
    assert planner in text
    assert shown in text
    assert hidden not in text


def test_the_map_has_the_perimeter_of_the_room() -> None:
    sweeper = SimulatedSweeper(SweeperSettings(noise="none"))
    picture = swept_picture(sweeper.host.snapshot(), 60, 60, (), ROOM)
    styles = {str(span.style) for span in picture.spans}
    for colour in ("white", "red", "magenta", "yellow"):
        assert any(colour in style for style in styles), colour
    bare = swept_picture(sweeper.host.snapshot(), 60, 60)
    assert not any("white" in str(span.style) for span in bare.spans)


@pytest.mark.parametrize("width", [18, 30, 80])
def test_the_legend_names_the_rooms_objects_and_fits(width: int) -> None:
    lines = legend(ROOM, width)
    assert all(len(line) <= width for line in lines)
    words = " ".join(line.plain for line in lines).replace("█", "").split()
    assert words == ["swept", "path", "walls", "cliff", "carpet", "threshold"]
    assert [line.plain for line in legend(None, 80)] == ["█ swept  █ path"]
