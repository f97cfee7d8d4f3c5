"""The summary object of a run: values that are not known are null."""

from __future__ import annotations

import json
from typing import Any

from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.run.ending import Ending
from bridge.run.host import Host
from bridge.run.mission import Mission
from bridge.run.options import HostOptions
from bridge.run.summary import run_summary
from bridge.session.link_stats import wire_summary
from protocol.link import LinkStatistics
from tools.cli.console import summary_table

MODEL = RobotModel()
PLAN = parse_floorplan('{"walls": [[0,0],[2,0],[2,2],[0,2]], "start": [0.3,0.3,0]}')


def host(mission: Mission | None = None) -> Host:
    return Host(MODEL, NullSink(), HostOptions(0), mission or Mission(None), lambda: 1)


def summed(host: Host, **known: Any) -> dict[str, Any]:  # noqa: ANN401 - parts of a summary
    parts: dict[str, Any] = {"room": None, "planner": None, "seed": None, "log": None, **known}
    value = json.loads(json.dumps(run_summary(host, **parts), allow_nan=False))
    assert isinstance(value, dict)
    return value


def shown(summary: dict[str, Any]) -> str:
    """Return the text of all cells of the summary table."""
    return " ".join(str(cell) for column in summary_table(summary).columns for cell in column.cells)


def test_a_run_that_never_began_has_no_figures() -> None:
    summary = summed(host())
    assert summary["outcome"] == "stopped"
    for key in (
        *("room", "planner", "seed", "reason", "duration_s", "path_m", "turns", "collisions"),
        *("contact_s", "energy_wh", "t90_s", "t99_s", "largest_hole_cm2", "hole_inradius_m"),
        *("repeat_ratio", "log"),
    ):
        assert summary[key] is None, key
    assert set(summary["pose_error_m"].values()) == {None}
    assert set(summary["coverage"].values()) == {None}
    assert summary["wire"]["frames"] == {"rx": 0, "tx": 0}
    assert "stopped" in shown(summary)


def test_a_room_of_any_name_takes_a_few_lines() -> None:
    text = shown(summed(host(), room="n" * 100_000 + "\n\x1b[2J", planner="paper"))
    assert len(text) < 1000
    assert "\\n\\x1b[2J, paper" in text


def test_figures_of_a_supervised_robot() -> None:
    inputs = host()
    inputs.drive_pose = Pose2(0.1, 0, 0)
    inputs.path_m = 0.1
    summary = summed(inputs, room="den", log="a.mcap")
    assert (summary["path_m"], summary["room"], summary["log"]) == (0.1, "den", "a.mcap")


def test_how_it_ended() -> None:
    mission = Mission(None)
    mission.ending = Ending("fault", "the device was lost for 30 s", 3)
    mission.drive_started_s, mission.drive_ended_s = 3.0, 10.25
    summary = summed(host(mission))
    assert summary["outcome"] == "fault"
    assert summary["reason"] == "the device was lost for 30 s"
    assert summary["duration_s"] == 7.25


def test_errors_and_the_plants_account() -> None:
    summary = summed(
        host(), error_m=(0.02, 0.05), collisions=3, contact_s=1.23456, energy_wh=0.123456
    )
    assert summary["pose_error_m"] == {"end": 0.02, "max": 0.05}
    assert (summary["collisions"], summary["contact_s"]) == (3, 1.235)
    assert summary["energy_wh"] == 0.1235
    assert summed(host(), collisions=0)["collisions"] == 0


def test_coverage_is_the_reports() -> None:
    track = [(0.02 * i, 0.3 + 0.004 * i, 0.3, 0.0) for i in range(300)]
    report = CoverageMeter(PLAN, MODEL).measure(track, 1.196)
    summary = summed(host(), report=report)
    assert set(summary["coverage"]) == {
        *("mouth_sweepable", "mouth_passing", "mouth_free", "body_reachable", "body_free", "eq8")
    }
    # The floor has 4 m². The mouth sweeps 1.196 m by 0.16 m. The footprint covers
    # 1.196 m by 0.32 m, plus a disc.
    assert abs(summary["coverage"]["mouth_free"] - 1.196 * 0.16 / 4) < 0.003
    assert abs(summary["coverage"]["body_free"] - (1.196 * 0.32 + 0.0804) / 4) < 0.003
    assert summary["coverage"]["eq8"] == round(1.196 * 0.16 / 4, 4)
    assert summary["path_m"] == 1.196
    assert summary["t90_s"] is None
    assert summary["largest_hole_cm2"] > 10_000
    text = shown(summary)
    assert "of the sweepable floor" in text
    assert "1.2 m" in text


def test_the_wire() -> None:
    statistics = LinkStatistics()
    statistics.frames_in, statistics.frames_out = 7, 5
    statistics.bytes_in, statistics.bytes_out = 70, 50
    statistics.lost, statistics.damaged = 2, 1
    statistics.reordered, statistics.rejected, statistics.superseded = 3, 4, 6
    assert wire_summary(statistics) == {
        "frames": {"rx": 7, "tx": 5},
        "lost": 2,
        "crc_errors": 1,
        "bytes": {"rx": 70, "tx": 50},
        "reordered": 3,
        "rejected": 4,
        "superseded": 6,
    }
