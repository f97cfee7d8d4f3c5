"""The file that a new log replaces is kept until a device is connected."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.cli.replaced_log import ReplacedLog


@pytest.fixture(name="log")
def _log(tmp_path: Path) -> Path:
    log = tmp_path / "run.mcap"
    log.write_text("old")
    return log


def test_the_old_log_is_restored_if_there_is_no_new_one(log: Path) -> None:
    replaced = ReplacedLog(log, force=True)
    assert not log.exists(), "the path is free for the new log"
    replaced.put_back()
    assert log.read_text() == "old"
    assert list(log.parent.iterdir()) == [log]


def test_the_old_log_is_gone_once_the_new_one_has_a_device(log: Path) -> None:
    replaced = ReplacedLog(log, force=True)
    log.write_text("new")
    replaced.drop()
    replaced.put_back()
    assert log.read_text() == "new"
    assert list(log.parent.iterdir()) == [log]


def test_nothing_is_moved_without_leave_to_replace_it(log: Path) -> None:
    ReplacedLog(log, force=False).put_back()
    assert log.read_text() == "old"


def test_a_link_and_a_device_file_stay_where_they_are(log: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.mcap"
    link.symlink_to(log)
    ReplacedLog(link, force=True)
    assert link.is_symlink()
    ReplacedLog(Path("/dev/null"), force=True)
    assert Path("/dev/null").exists()
