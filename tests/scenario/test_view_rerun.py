"""A run in Rerun: through Rerun's own importer, and through the project's converter."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from bridge.record.errors import LogReadError, LogWriteError
from bridge.record.reader import LogReader
from bridge.view.errors import NoDisplayError, ViewerFailedError, ViewerMissingError
from bridge.view.rerun.launch import open_viewer, viewer_command
from support.synthetic_run import write_synthetic_log

_CHUNK = re.compile(r"with (\d+) rows .* - (/\S*) - data columns: \[(.*)\]")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of a whole run."""
    return write_synthetic_log(tmp_path_factory.mktemp("view") / "run.mcap")


def rerun(*arguments: str) -> str:
    """Run the `rerun` command of this environment."""
    spec = importlib.util.find_spec("rerun_cli")
    assert spec is not None
    assert spec.origin is not None
    done = subprocess.run(
        [str(Path(spec.origin).parent / "rerun"), *arguments],
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
        env={"NO_COLOR": "1", "HOME": "/nonexistent", "CI": "1"},
    )
    return done.stdout + done.stderr


def rows(rrd: Path) -> dict[tuple[str, str], int]:
    """Return the rows of a Rerun file by entity and component."""
    counts: dict[tuple[str, str], int] = defaultdict(int)
    for line in rerun("rrd", "print", str(rrd)).splitlines():
        if found := _CHUNK.search(line):
            for component in found[3].split():
                counts[found[2], component] += int(found[1])
    return counts


def test_rerun_draws_the_log_without_our_code(log: Path, tmp_path: Path) -> None:
    rrd = tmp_path / "converted.rrd"
    rerun("mcap", "convert", str(log), "-o", str(rrd))
    counts: dict[str, int] = defaultdict(int)
    for message in LogReader(log).messages():
        counts[message.topic] += 1
    found = rows(rrd)
    assert found["/tf", "Transform3D:translation"] == counts["/tf"]
    assert found["/tf", "Transform3D:child_frame"] == counts["/tf"]
    assert found["/map/coverage", "GridMap:data"] == counts["/map/coverage"]
    assert found["/map/room", "GridMap:data"] == 1
    assert found["/pose", "InstancePoses3D:translations"] == counts["/pose"]
    assert found["/truth/pose", "InstancePoses3D:translations"] == counts["/truth/pose"]
    assert found["/log", "TextLog:text"] == counts["/log"]
    assert found["/device/imu", "sweepctl.Imu:message"] == counts["/device/imu"]
    assert found["/ros/imu", "Scalars:scalars"] == counts["/ros/imu"]
    assert found["/ros/joint_states/velocity", "Scalars:scalars"] == counts["/ros/joint_states"]


def test_a_saved_recording_holds_the_run_and_its_layout(log: Path, tmp_path: Path) -> None:
    rrd = tmp_path / "run.rrd"
    reader = open_viewer(log, save=rrd)
    assert not reader.truncated
    assert "verified without error" in rerun("rrd", "verify", str(rrd))
    found = rows(rrd)
    poses = sum(1 for _ in LogReader(log).messages(["/pose/estimate"]))
    maps = sum(1 for _ in LogReader(log).messages(["/map/coverage"]))
    assert found["/world/robot", "Transform3D:translation"] == poses
    assert found["/plots/velocity/estimated", "Scalars:scalars"] == poses
    assert found["/world/swept", "GridMap:data"] == maps
    assert found["/world/walls", "LineStrips3D:strips"] == 1
    assert found["/world/path", "LineStrips3D:strips"] > 100
    assert found["/plots/pose_error/position_mm", "Scalars:scalars"] > 0.99 * poses - 2
    assert found["/events", "TextLog:text"] > 10
    assert found["/states/planner", "StateChange:state"] > 10
    for plot in (
        *("wheels/left", "acceleration/accel_x", "range/front", "battery/battery_V"),
        *("current/left_A", "clock/bound_ms", "link/lost_per_s", "yaw_rate/gyro_z"),
    ):
        assert found[f"/plots/{plot}", "Scalars:scalars"] > 10, plot
    assert any(entity.startswith("/viewport") for entity, _ in found), "the blueprint"


def test_a_cut_log_is_shown_as_far_as_it_goes(log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    data = log.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    reader = open_viewer(cut, save=tmp_path / "cut.rrd")
    assert reader.truncated
    found = rows(tmp_path / "cut.rrd")
    whole = sum(1 for _ in LogReader(log).messages(["/pose/estimate"]))
    assert 0.3 * whole < found["/world/robot", "Transform3D:translation"] < 0.7 * whole


def test_a_file_that_cannot_be_shown_is_one_line(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(LogReadError, match="No such file"):
        open_viewer(tmp_path / "missing.mcap", save=tmp_path / "x.rrd")
    with pytest.raises(LogWriteError, match="there is no folder"):
        open_viewer(log, save=tmp_path / "no" / "folder" / "x.rrd")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(NoDisplayError, match=r"no display .*--serve .*--save .*--png"):
        open_viewer(log)


def test_the_viewer_listens_on_this_machine_only(tmp_path: Path) -> None:
    command = viewer_command(tmp_path / "run.rrd")
    assert command[command.index("--bind") + 1] == "127.0.0.1"


def test_a_viewer_that_fails_reports_why(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = [sys.executable, "-c", "import sys; sys.exit('Error: no graphics adapter')"]
    monkeypatch.setattr("bridge.view.rerun.launch.viewer_command", lambda *_, **__: program)
    monkeypatch.setattr("bridge.view.rerun.launch.has_display", lambda: True)
    with pytest.raises(ViewerFailedError, match="status 1: Error: no graphics adapter"):
        open_viewer(log)


def test_without_rerun_it_reports_the_install_command(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(ViewerMissingError, match=r"pip install 'sweepctl\[view\]'"):
        open_viewer(log)
