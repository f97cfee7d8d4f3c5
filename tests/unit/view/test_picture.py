"""The picture of a run, for complete and incomplete logs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib import image
from matplotlib.figure import Figure

from bridge.config import parse_robot
from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.record.errors import LogReadError, LogWriteError
from bridge.record.log_writer import RunWriter
from bridge.session.records import PoseRecord, RunInfo, TruthRecord
from bridge.view.report.picture import draw_path, draw_run
from bridge.view.report.run_track import load_track

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

pytestmark = pytest.mark.slow

START_NS = 1_700_000_000_000_000_000
PLAN = parse_floorplan(
    '{"name": "den", "walls": [[0,0],[2,0],[2,2],[0,2]],'
    ' "obstacles": [[[1.2,1.2],[1.6,1.2],[1.6,1.6],[1.2,1.6]]], "start": [0.3,0.3,0]}'
)
NO_COVARIANCE = (0.0,) * 9
COLOURS = {
    "wall": (0x30, 0x34, 0x3B),
    "obstacle": (0x9A, 0xA2, 0xAD),
    "mouth": (0x8F, 0xD0, 0xB5),
    "body": (0xD9, 0xEF, 0xE5),
    "missed": (0xF0, 0xA3, 0x5E),
    "path": (0x1F, 0x4E, 0x79),
    "estimate": (0xB0, 0x3A, 0x48),
}

LINES = ("path", "estimate")


def write_log(
    path: Path,
    *,
    room: bool = True,
    truth: bool = True,
    poses: int = 300,
    robot_toml: str = "",
) -> Path:
    """Write a log of a drive along the lower wall, with an estimate 5 cm too far left."""
    info = RunInfo(
        "virtual",
        "paper",
        3,
        "0",
        START_NS,
        0,
        parse_robot(robot_toml),
        robot_toml,
        PLAN if room else None,
    )
    writer = RunWriter(path, info)
    for i in range(poses):
        at_ns = START_NS + i * 20_000_000
        x = 0.3 + 1.4 * i / 300
        if truth:
            writer.write(TruthRecord(at_ns, Pose2(x, 0.3, 0.1)))
        estimate = Pose2(x, 0.35, 0.1)
        writer.write(PoseRecord(at_ns, estimate, 0.2, 0.0, NO_COVARIANCE, 0.0, 1.0))
    summary = {
        "room": "den",
        "planner": "paper",
        "seed": 3,
        "outcome": "stopped",
        "duration_s": 6.0,
        "path_m": 1.4,
        "coverage": {"mouth_sweepable": 0.1},
    }
    writer.close(summary)
    return path


def pixels(png: Path) -> NDArray[np.int_]:
    """Return the pixels as an array (rows, columns, 3) with values from 0 to 255."""
    values: NDArray[np.int_] = np.rint(image.imread(png)[..., :3] * 255).astype(np.int_)
    assert values.shape == (1032, 960, 3)
    return values


def classes(png: Path) -> dict[str, int]:
    """Return the number of pixels of each colour, with a tolerance for thin lines."""
    values = pixels(png)
    return {
        name: int(np.count_nonzero((abs(values - colour) <= (3, 40)[name in LINES]).all(axis=2)))
        for name, colour in COLOURS.items()
    }


def test_every_class_is_drawn(tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.mcap")
    png = draw_run(log, tmp_path / "run.png")
    assert png == tmp_path / "run.png"
    assert png.read_bytes().startswith(b"\x89PNG\r\n")
    found = classes(png)
    for name, count in found.items():
        assert count > 100, name
    # 0.22 m² of 3.1 m² sweepable floor are swept; the lines cover a part of the swept floor
    assert 11 < found["missed"] / found["mouth"] < 16
    assert found["obstacle"] > 3000


def test_without_a_room_there_is_the_path_alone(tmp_path: Path) -> None:
    found = classes(draw_run(write_log(tmp_path / "a.mcap", room=False), tmp_path / "a.png"))
    assert found["path"] > 100
    assert found["estimate"] > 100
    assert found["mouth"] == found["body"] == found["missed"] == found["obstacle"] == 0


def test_without_the_truth_the_estimate_is_taken(tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.mcap", truth=False)
    found = classes(draw_run(log, tmp_path / "a.png"))
    assert found["mouth"] > 1000
    assert found["estimate"] > 100
    track = load_track(log)
    assert track.truth == []
    assert track.best == track.estimate
    assert track.best[0][1].y_m == pytest.approx(0.35)


def test_a_log_without_its_end(tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.mcap")
    whole = log.read_bytes()
    for share in (0.9, 0.3):
        log.write_bytes(whole[: int(len(whole) * share)])
        pixels(draw_run(log, tmp_path / "a.png"))
    assert load_track(log).summary == {}


def test_a_log_in_which_nothing_moved(tmp_path: Path) -> None:
    for poses in (0, 1):
        log = write_log(tmp_path / f"{poses}.mcap", poses=poses)
        found = classes(draw_run(log, tmp_path / "a.png"))
        assert found["missed"] > 1000


def test_neither_room_nor_poses(tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.mcap", room=False, truth=False, poses=0)
    pixels(draw_run(log, tmp_path / "a.png"))


def test_the_robot_file_counts(tmp_path: Path) -> None:
    wide = write_log(tmp_path / "wide.mcap", robot_toml="cleaning_width_m = 0.3")
    narrow = write_log(tmp_path / "narrow.mcap", robot_toml="cleaning_width_m = 0.05")
    assert load_track(wide).model.cleaning_width_m == 0.3
    mouths = [classes(draw_run(log, tmp_path / "a.png"))["mouth"] for log in (wide, narrow)]
    assert mouths[0] > 3 * mouths[1]


def test_errors(tmp_path: Path) -> None:
    with pytest.raises(LogReadError, match=r"none\.mcap"):
        draw_run(tmp_path / "none.mcap", tmp_path / "a.png")
    log = write_log(tmp_path / "a.mcap")
    with pytest.raises(LogWriteError, match="cannot write"):
        draw_run(log, log / "a.png")
    with pytest.raises(LogWriteError, match="cannot write"):
        draw_run(log, tmp_path)


# ---- data from the log -----------------------------------------------------------------


def test_the_track(tmp_path: Path) -> None:
    track = load_track(write_log(tmp_path / "run.mcap"))
    assert track.name == "run"
    assert track.plan is not None
    assert track.plan.obstacles == PLAN.obstacles
    assert len(track.truth) == len(track.estimate) == 300
    assert track.truth[0] == (0.0, Pose2(0.3, 0.3, pytest.approx(0.1)))  # type: ignore[arg-type]  # approximate
    assert track.truth[-1][0] == pytest.approx(299 * 0.02)
    assert track.summary["outcome"] == "stopped"
    assert track.best == track.truth


@pytest.mark.parametrize("degrees", [-179, -90, 0, 45, 179])
def test_headings(tmp_path: Path, degrees: int) -> None:
    path = tmp_path / "a.mcap"
    writer = RunWriter(path, RunInfo("p", "", None, "0", START_NS, 0, RobotModel(), ""))
    writer.write(TruthRecord(START_NS, Pose2(1.0, -2.0, math.radians(degrees))))
    writer.close()
    ((time_s, pose),) = load_track(path).truth
    assert time_s == 0.0
    assert (pose.x_m, pose.y_m) == (1.0, -2.0)
    assert math.degrees(pose.theta_rad) == pytest.approx(degrees)


def test_both_tracks_share_a_clock(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = RunWriter(path, RunInfo("p", "", None, "0", START_NS, 0, RobotModel(), ""))
    pose = Pose2(0, 0, 0)
    writer.write(TruthRecord(START_NS + 5_000_000_000, pose))
    writer.write(PoseRecord(START_NS + 7_000_000_000, pose, 0.0, 0.0, NO_COVARIANCE, 0.0, 1.0))
    writer.close()
    track = load_track(path)
    assert [t for t, _ in track.truth] == [0.0]
    assert [t for t, _ in track.estimate] == [2.0]


def test_a_straight_path_without_a_room_has_floor_on_both_sides(tmp_path: Path) -> None:
    axes = Figure().add_subplot()
    draw_path(axes, load_track(write_log(tmp_path / "log.mcap", room=False, truth=False)))
    bottom, top = axes.get_ylim()
    assert (bottom + top) / 2 == pytest.approx(0.35, abs=0.01)
    assert top - bottom == pytest.approx(1.0, abs=0.01)
    left, right = axes.get_xlim()
    assert right - left == pytest.approx(1.4, rel=0.15), "the width is the path with margins"
