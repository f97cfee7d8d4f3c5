"""``sweepctl info`` and ``view`` on complete, truncated and invalid logs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.cli import case_1, plain_messages, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


@pytest.fixture
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return case_1(tmp_path_factory).log


@pytest.fixture
def truncated(log: Path, tmp_path: Path) -> Path:
    """Return a log that ends early, as after a kill during the run."""
    path = tmp_path / "truncated.mcap"
    whole = log.read_bytes()
    path.write_bytes(whole[: len(whole) // 3])
    return path


def test_info_counts_the_messages(log: Path) -> None:
    done = sweepctl("info", log, "--json")
    assert (done.status, done.err) == (0, "")
    reported = {topic["topic"]: topic["count"] for topic in done.json["topics"]}
    counted: dict[str, int] = {}
    for message in plain_messages(log):
        counted[message.topic] = counted.get(message.topic, 0) + 1
    assert reported == counted
    assert done.json["whole"] is True
    assert done.json["outcome"] == "complete"
    assert done.json["metadata"]["seed"] == "1"
    assert done.json["file_bytes"] == log.stat().st_size
    rates = {topic["topic"]: topic["rate_hz"] for topic in done.json["topics"]}
    assert rates["/device/imu"] == pytest.approx(100.0, rel=0.01)
    assert rates["/device/encoders"] == pytest.approx(50.0, rel=0.01)


def test_info_for_people(log: Path) -> None:
    done = sweepctl("info", log)
    assert (done.status, done.err) == (0, "")
    for text in ("complete", "case-1, paper, seed 1", "/truth/pose", "foxglove.PoseInFrame"):
        assert text in done.out


def test_info_of_a_log_without_its_end(truncated: Path) -> None:
    done = sweepctl("info", truncated, "--json")
    assert done.status == 0
    assert done.json["whole"] is False
    assert done.json["summary"] is None
    assert done.json["outcome"] is None
    assert 30.0 < done.json["duration_s"] < 120.0
    people = sweepctl("info", truncated)
    assert people.status == 0
    assert "incomplete: still being written, or its writer was killed" in people.out


@pytest.mark.parametrize("command", [("info",), ("view",), ("view", "--png", "a.png")])
@pytest.mark.parametrize("kind", ["missing", "empty", "text", "folder", "nearly"])
def test_files_that_are_no_logs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...], kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "log.mcap"
    if kind == "folder":
        path.mkdir()
    elif kind != "missing":
        path.write_bytes({"empty": b"", "text": b"hello\n" * 99, "nearly": b"\x89MCAP1\r\n"}[kind])
    done = sweepctl(*command, path)
    assert done.status == 1
    assert str(path) in done.line
    assert not (tmp_path / "a.png").exists()


def test_a_header_alone_is_a_log_with_nothing_in_it(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "short.mcap"
    path.write_bytes(log.read_bytes()[:20])
    done = sweepctl("info", path, "--json")
    assert done.status == 0
    assert done.json["messages"] == 0
    assert done.json["whole"] is False
    assert sweepctl("info", path).status == 0


def test_no_display(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    done = sweepctl("view", log)
    assert done.status == 1
    assert "display" in done.line


def test_a_picture_by_any_name(truncated: Path, tmp_path: Path) -> None:
    png = tmp_path / "new" / "folder" / "run.picture"
    done = sweepctl("view", truncated, "--png", png)
    assert done.status == 0
    assert str(png) in done.line
    assert png.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("option", "suffix"), [("--png", "png"), ("--save", "rrd")])
def test_a_picture_that_cannot_be_written(truncated: Path, option: str, suffix: str) -> None:
    done = sweepctl("view", truncated, option, f"/proc/none/run.{suffix}")
    assert done.status == 1
    assert f"cannot write /proc/none/run.{suffix}" in done.line
