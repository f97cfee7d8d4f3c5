"""Recordings of a virtual sweeper, in virtual time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.errors import OutputExistsError
from bridge.record.reader import LogReader
from tools.virtual.settings import SweeperSettings
from tools.virtual.simulated_sweeper import SimulatedSweeper

if TYPE_CHECKING:
    from pathlib import Path


def test_a_block_is_recorded_with_its_truth_and_its_end(tmp_path: Path) -> None:
    sweeper = SimulatedSweeper(SweeperSettings(room="empty", seed=2))
    log = tmp_path / "drive.mcap"
    with sweeper.record(log) as recording:
        sweeper.enable()
        sweeper.drive(0.1, 0.0, for_s=2.0)
        recorded = list(sweeper.path)
    assert (recording.closed, recording.dropped, recording.error) == (True, 0, None)
    sweeper.drive(0.1, 0.0, for_s=1.0)
    reader = LogReader(log)
    assert (reader.truncated, reader.run["port"], reader.run["seed"]) == (False, "virtual", "2")
    truth = [m.decoded.pose.position.x for m in reader.messages({"/truth/pose"})]
    assert truth == pytest.approx([pose.x_m for _, pose in recorded[-len(truth) :]])
    assert len(truth) > 200
    assert reader.summary is not None
    assert (reader.summary["log"], reader.summary["room"]) == (str(log), "empty")
    with pytest.raises(OutputExistsError):
        sweeper.record(log)


def test_close_completes_every_recording_and_a_planner_is_named(tmp_path: Path) -> None:
    sweeper = SimulatedSweeper(SweeperSettings(room="empty"))
    logs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for log in logs:
        sweeper.record(log)
    summary = sweeper.clean("u-shape", max_time_s=20.0)
    sweeper.close()
    for log in logs:
        recorded = LogReader(log).summary
        assert recorded is not None
        assert (recorded["planner"], recorded["outcome"]) == ("u-shape", "timeout")
        assert recorded["path_m"] == pytest.approx(summary["path_m"], abs=0.01)


def test_equal_settings_give_equal_logs(tmp_path: Path) -> None:
    contents = []
    for name in ("a", "b"):
        sweeper = SimulatedSweeper(SweeperSettings(room="empty", seed=7))
        with sweeper.record(tmp_path / f"{name}.mcap"):
            sweeper.enable()
            sweeper.drive(0.1, 0.2, for_s=1.0)
        reader = LogReader(tmp_path / f"{name}.mcap")
        contents.append([(m.topic, m.log_ns, m.data) for m in reader.messages()])
    assert contents[0] == contents[1]
    assert len(contents[0]) > 100
