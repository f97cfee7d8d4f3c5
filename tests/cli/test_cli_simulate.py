"""``sweepctl simulate``: its JSON object, its exit status, its log's name, and Ctrl-C."""

from __future__ import annotations

import json
import signal
from typing import TYPE_CHECKING, Any

import pytest

from bridge.record.reader import LogReader
from support.cli import Recorded, attachments, case_1, decoded, end, start, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

KEYS = (
    *("room", "planner", "seed", "outcome", "duration_s", "path_m", "turns", "collisions"),
    *("contact_s", "energy_wh", "pose_error_m", "start_error", "coverage", "t90_s", "t99_s"),
    *("largest_hole_cm2", "hole_inradius_m", "repeat_ratio", "wire", "events", "log"),
)
INSIDE = {
    "pose_error_m": {"end", "max"},
    "coverage": {"mouth_sweepable", "mouth_free", "body_reachable", "body_free", "eq8"},
    "wire": {"frames", "lost", "crc_errors", "bytes"},
}


@pytest.fixture
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return case_1(tmp_path_factory)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def check_keys(summary: dict[str, Any]) -> None:
    # The summary has the documented keys and the reason of the end.
    assert set(summary) == {*KEYS, "reason", "stop_cause"}
    for key, inner in INSIDE.items():
        assert set(summary[key]) >= inner
    assert set(summary["wire"]["frames"]) == set(summary["wire"]["bytes"]) == {"rx", "tx"}


# ---- what is printed -------------------------------------------------------------------


def test_the_object_of_a_whole_run(recorded: Recorded) -> None:
    status, _, err = recorded.done
    assert (status, err) == (0, "")
    summary = recorded.done.json
    check_keys(summary)
    assert summary["room"] == "case-1"
    assert (summary["planner"], summary["seed"], summary["outcome"]) == ("paper", 1, "complete")
    assert summary["stop_cause"] == "session_end"
    assert summary["log"] == str(recorded.log)
    assert summary["wire"]["lost"] == summary["wire"]["crc_errors"] == 0
    assert 0.0 <= summary["pose_error_m"]["end"] <= summary["pose_error_m"]["max"] < 0.1
    swept = summary["coverage"]["mouth_sweepable"]
    assert (summary["t90_s"] is None) is (swept < 0.90)
    assert (summary["t99_s"] is None) is (swept < 0.99)
    for share in ("mouth_sweepable", "mouth_free", "body_reachable", "body_free"):
        assert 0.5 < summary["coverage"][share] < 1.0


def test_the_log_ends_with_the_same_object(recorded: Recorded) -> None:
    assert json.loads(attachments(recorded.log)["summary.json"]) == recorded.done.json


def test_people_get_a_table(folder: Path) -> None:
    done = sweepctl("simulate", "empty", "--max-time", "1", "--out", "a.mcap")
    assert done.status == 1
    assert "timeout" in done.out
    assert "not finished after 1 s" in done.out
    assert "a.mcap" in done.out
    assert (folder / "a.mcap").exists()


def test_out_of_time(folder: Path) -> None:
    done = sweepctl("simulate", "empty", "--max-time", "1", "--json", "--out", folder / "a.mcap")
    assert done.status == 1
    assert done.err == ""
    check_keys(done.json)
    assert done.json["outcome"] == "timeout"
    assert done.json["t90_s"] is None
    assert done.json["t99_s"] is None
    assert 1.0 <= done.json["duration_s"] < 1.1
    assert LogReader(folder / "a.mcap").summary == done.json


# ---- the log's name --------------------------------------------------------------------


def test_default_logs_have_names_of_their_own(folder: Path) -> None:
    logs = [
        sweepctl("simulate", "empty", "--max-time", "1", "--json").json["log"] for _ in range(3)
    ]
    names = sorted((folder / "runs").iterdir())
    assert sorted(folder / log for log in logs) == names
    assert len(set(names)) == 3
    for name in names:
        assert name.match("runs/20*T*Z-empty*.mcap")
        assert not LogReader(name).truncated


def test_a_rooms_name_cannot_leave_the_folder(folder: Path) -> None:
    room = {"name": "../../x/y", "walls": [[0, 0], [2, 0], [2, 2], [0, 2]], "start": [1, 1, 0]}
    (folder / "room.json").write_text(json.dumps(room))
    done = sweepctl("simulate", "room.json", "--max-time", "1", "--json")
    assert [path.parent for path in folder.rglob("*.mcap")] == [folder / "runs"]
    assert done.json["room"] == "../../x/y"


def test_an_existing_log_is_not_replaced(folder: Path) -> None:
    log = folder / "a.mcap"
    log.write_bytes(b"precious")
    again = ("simulate", "empty", "--max-time", "1", "--out", log)
    for _ in range(2):
        done = sweepctl(*again)
        assert done.status == 1
        assert str(log) in done.line
        assert "--force" in done.line
        assert log.read_bytes() == b"precious"
    assert sweepctl(*again, "--force").status == 1  # because of the time limit; the log is made
    assert LogReader(log).summary is not None
    first = log.read_bytes()
    assert "--force" in sweepctl(*again).line
    assert log.read_bytes() == first


def test_the_same_out_option_twice_is_one_run(folder: Path) -> None:
    out = ("--out", folder / "a.mcap", "--out", folder / "a.mcap")
    done = sweepctl("simulate", "empty", "--max-time", "1", "--json", *out)
    assert done.json["outcome"] == "timeout"
    assert not LogReader(folder / "a.mcap").truncated


@pytest.mark.parametrize("out", ["none/such/a.mcap", "/proc/a.mcap", "/dev/full"])
def test_a_log_that_cannot_be_written(folder: Path, out: str) -> None:
    arguments = ("simulate", "empty", "--max-time", "1", "--json", "--force", "--out", out)
    done = sweepctl(*arguments)
    assert done.status == 1
    assert out in done.line
    assert done.json["exit_status"] == 1
    assert list(folder.iterdir()) == []


def test_a_folder_of_logs_that_cannot_be_made(folder: Path) -> None:
    (folder / "runs").touch()
    done = sweepctl("simulate", "empty", "--max-time", "1")
    assert done.status == 1
    assert "runs/" in done.line


# ---- Ctrl-C ----------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ended_in_the_middle(tmp_path: Path, number: signal.Signals) -> None:
    log = tmp_path / "run.mcap"
    process = start("simulate", "empty", "--json", "--out", log, cwd=tmp_path)
    while process.poll() is None and (not log.exists() or log.stat().st_size < 300_000):
        signal.sigtimedwait([], 0.01)  # sleep without the time module
    done = end(process, number)
    assert (done.status, done.err) == (0, "")
    check_keys(done.json)
    assert done.json["outcome"] == "stopped"
    name = "Ctrl-C" if number == signal.SIGINT else "SIGTERM"
    assert done.json["reason"] == f"ended by {name}"
    reader = LogReader(log)
    assert not reader.truncated
    assert reader.summary == done.json
    # The device had stopped before the log was closed.
    velocities = [value.v_m_s for _, value in decoded(log, "/pose/estimate")]
    latches = [value.text for _, value in decoded(log, "/events") if value.kind == "stop"]
    assert latches == [f"ended by {name}"]
    assert max(velocities) > 0.1


@pytest.mark.realtime
def test_a_second_signal_changes_nothing(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    process = start("simulate", "empty", "--json", "--out", log, cwd=tmp_path)
    while process.poll() is None and (not log.exists() or log.stat().st_size < 300_000):
        signal.sigtimedwait([], 0.01)
    for _ in range(5):  # during the stop and the summary
        process.send_signal(signal.SIGINT)
        signal.sigtimedwait([], 0.01)
    done = end(process)
    assert (done.status, done.err) == (0, "")
    assert LogReader(log).summary == done.json
