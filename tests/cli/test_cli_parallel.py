"""``runs index`` and ``export`` of several logs at once."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from support.cli import short_runs, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


@pytest.fixture(name="logs")
def folder_of_logs(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path / "logs"
    (folder / "inner").mkdir(parents=True)
    for recorded, name in zip(
        short_runs(tmp_path_factory), ("a.mcap", "b.mcap", "inner/a.mcap"), strict=True
    ):
        shutil.copy(recorded.log, folder / name)
    (folder / "broken.mcap").write_bytes(b"no log")
    return folder


def test_the_index_in_parallel_is_the_index(logs: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    shutil.copytree(logs, plain)
    done = sweepctl("runs", "index", logs, "--jobs", "2", "--json")
    assert done.status == 0
    assert done.json == {"read": 4, "runs": 3, "unreadable": 1}
    assert f"{logs / 'broken.mcap'}: " in done.err
    assert sweepctl("runs", "index", logs, "--json").json["read"] == 0
    listed, expected = (sweepctl("runs", where, "--json").json["runs"] for where in (logs, plain))
    different = {"log", "folder", "date"}
    assert [{k: v for k, v in run.items() if k not in different} for run in listed] == [
        {k: v for k, v in run.items() if k not in different} for run in expected
    ]


def test_several_logs_are_exported_to_a_folder_each(logs: Path, tmp_path: Path) -> None:
    out, alone = tmp_path / "tables", tmp_path / "alone"
    files = [logs / name for name in ("a.mcap", "b.mcap", "inner/a.mcap")]
    words = ("--topic", "/pose*", "--topic", "/cmd")
    done = sweepctl("export", *files, "--out", out, *words, "--jobs", "2", "--json")
    assert (done.status, done.json["failed"], done.json["problems"]) == (0, [], [])
    assert sorted(path.name for path in out.iterdir()) == ["a", "a-2", "b"]
    assert len(done.json["files"]) == 9
    one = sweepctl("export", files[2], "--out", alone, *words, "--json").json
    assert done.json["files"]["a-2/pose"]["rows"] == one["files"]["/pose"]["rows"]
    for path in alone.iterdir():
        assert (out / "a-2" / path.name).read_bytes() == path.read_bytes()


def test_a_log_that_cannot_be_exported_is_named_and_the_others_are_written(
    logs: Path, tmp_path: Path
) -> None:
    files = [logs / "broken.mcap", logs / "a.mcap"]
    done = sweepctl("export", *files, "--out", tmp_path / "out", "--topic", "/pose", "--json")
    assert done.status == 1
    assert done.json["failed"] == [str(logs / "broken.mcap")]
    assert list(done.json["files"]) == ["a/pose"]
    again = sweepctl("export", *files, "--out", tmp_path / "out", "--topic", "/pose")
    assert again.status == 1
    assert "exists" in again.err


@pytest.mark.parametrize("words", [("--jobs", "2"), ("--scheduler", "tcp://127.0.0.1:1")])
def test_one_log_has_no_use_for_processes(
    logs: Path, tmp_path: Path, words: tuple[str, ...]
) -> None:
    done = sweepctl("export", logs / "a.mcap", "--out", tmp_path / "out", *words)
    assert (done.status, "need several files" in done.line) == (2, True)


def test_local_processes_or_a_cluster(logs: Path) -> None:
    words = ("--jobs", "2", "--scheduler", "tcp://127.0.0.1:1")
    done = sweepctl("runs", "index", logs, *words)
    assert (done.status, "--jobs is for local processes" in done.line) == (2, True)


@pytest.mark.parametrize("address", ["nonsense", "tcp://127.0.0.1", "http://127.0.0.1:1", ""])
def test_a_wrong_scheduler_address_is_a_usage_error(logs: Path, address: str) -> None:
    done = sweepctl("runs", "index", logs, "--scheduler", address)
    assert (done.status, done.line.endswith("use tcp://HOST:PORT")) == (2, True)
    assert repr(address) in done.line
