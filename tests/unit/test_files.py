"""Paths that are no regular file: one clear error, and no wait."""

from __future__ import annotations

import os
import re
import socket
from pathlib import Path

import pytest

from bridge.config import load_robot
from bridge.convert.file_kinds import kind_of
from bridge.convert.recover import recover
from bridge.errors import BridgeError
from bridge.files import check_target, open_to_read, write_whole
from bridge.floor_plan.floor_plan import FloorPlanError
from bridge.record.errors import LogReadError, LogWriteError
from bridge.record.log_writer import RunWriter
from bridge.record.reader import LogReader
from support.cli import sweepctl
from support.synthetic_run import run_info
from tools.cli.keyfile import read_key
from tools.cli.rooms import load_room


@pytest.fixture(name="odd", params=["pipe", "socket", "/dev/zero", "/dev/ptmx"])
def _odd(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, str]:
    """Return a path that is no regular file, and its kind."""
    if request.param.startswith("/"):
        return Path(request.param), "a device"
    path = tmp_path / "odd"
    if request.param == "pipe":
        os.mkfifo(path)
    else:
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(path))
    return path, f"a {request.param}"


@pytest.mark.parametrize(
    "read", [load_robot, load_room, read_key, LogReader, kind_of, lambda p: recover(p, p)]
)
def test_it_is_not_read(odd: tuple[Path, str], read: object) -> None:
    path, name = odd
    given = str(path) if read is load_room else path
    with pytest.raises(
        (BridgeError, FloorPlanError), match=f"{re.escape(str(path))}.*it is {name}, not a file"
    ):
        read(given)  # type: ignore[operator]  # a function
    with pytest.raises(OSError, match=f"it is {name}, not a file"):
        open_to_read(path)


def test_it_is_not_written(odd: tuple[Path, str]) -> None:
    path, name = odd
    if str(path) == "/dev/zero":  # it drops all bytes, as /dev/null does
        check_target(path)
        return
    with pytest.raises(LogWriteError, match=f"it is {name}, not a file"):
        RunWriter(path, run_info(), force=True)
    with pytest.raises(OSError, match=f"it is {name}, not a file"):
        check_target(path)


def test_a_command_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    for arguments in (
        ("info", "pipe"),
        ("simulate", "pipe"),
        ("simulate", "empty", "--robot", "pipe"),
        ("simulate", "empty", "--force", "--out", "pipe"),
        ("recover", "pipe", "--out", "b.mcap"),
    ):
        done = sweepctl(*arguments)
        assert "pipe: it is a pipe, not a file" in done.line, arguments


def test_a_device_that_keeps_nothing_needs_no_force(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    simulated = ("simulate", "empty", "--max-time", "2", "--out")
    assert sweepctl(*simulated, log).status == 1, "the time limit"
    done = sweepctl(*simulated, os.devnull)
    assert (done.status, "exists" in done.err) == (1, False)
    for arguments in (("recover", log), ("report", log), ("diff", log, log)):
        done = sweepctl(*arguments, "--out", os.devnull)
        assert (done.status, "exists" in done.err) == (0, False), arguments
    if Path("/dev/full").exists():
        done = sweepctl(*simulated, "/dev/full")
        assert "cannot write /dev/full: No space left on device" in done.err
        assert Path("/dev/full").is_char_device(), "it is not removed"


def test_the_pipe_of_a_shell_may_hold_a_small_file() -> None:
    """As in ``--robot <(command)``."""
    reading, writing = os.pipe()
    try:
        os.write(writing, b'name = "piped"\n')
        os.close(writing)
        model, _ = load_robot(Path(f"/dev/fd/{reading}"))
        assert model.name == "piped"
        with pytest.raises(LogReadError, match="it is a pipe"):
            LogReader(Path(f"/dev/fd/{reading}"))
    finally:
        os.close(reading)


def test_the_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "none"
    with pytest.raises(LogWriteError, match=rf"there is no folder {folder}; make it first"):
        RunWriter(folder / "a.mcap", run_info(), force=False)
    done = sweepctl("simulate", "empty", "--max-time", "1", "--out", folder / "a.mcap")
    assert f"there is no folder {folder}; make it first" in done.line


def test_a_file_that_cannot_be_written_is_left_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, data: bytes) -> int:
        with path.open("wb") as file:
            file.write(data[:1])
        raise OSError(28, "No space left on device")

    old, new = tmp_path / "old", tmp_path / "new"
    old.write_text("old")
    monkeypatch.setattr(Path, "write_bytes", full)
    for path in (old, new):
        with pytest.raises(OSError, match="No space left"):
            write_whole(path, b"text")
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


def test_a_link_stays_a_link_and_a_mode_stays_a_mode(tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    write_whole(link, b"new")
    assert link.is_symlink()
    assert (real.read_text(), real.stat().st_mode & 0o777) == ("new", 0o640)
    write_whole(Path(os.devnull), b"nothing is kept")


def test_a_file_without_write_permission_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "old"
    path.write_text("old")
    monkeypatch.setattr(os, "access", lambda _path, mode: mode != os.W_OK)
    with pytest.raises(PermissionError):
        write_whole(path, b"new")
    assert path.read_text() == "old"
