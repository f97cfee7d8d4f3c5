"""Start of a command in a deleted or inaccessible folder, and Ctrl-C during the start."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from bridge.record.reader import LogReader
from support.processes import COMMAND
from support.root import ROOT
from tools.cli.options import log_path
from tools.cli.outputs import check_outputs
from tools.cli.paths import is_file, is_folder, is_there
from tools.cli.rooms import load_room

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

pytestmark = pytest.mark.slow

INTERRUPT = """
import os, signal, sys
class At:
    def find_spec(self, name, path=None, target=None):
        if name == os.environ["INTERRUPT_AT"]:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, At())
"""
"""Module that Python loads at its start. It sends Ctrl-C when a given import begins."""


def sweepctl(
    *arguments: str | Path, cwd: Path, env: dict[str, str] | None = None, script: str = 'exec "$@"'
) -> subprocess.CompletedProcess[str]:
    words = [*COMMAND, *map(str, arguments)]
    return subprocess.run(
        ["/bin/sh", "-c", script, "sh", *words],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONSAFEPATH": "1", **(env or {})},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )


START = ["click", "tools.cli.console", "bridge", "tools.commands.simulate", "numpy"]
LATER = [
    "numpy.linalg",
    "bridge.config",
    "bridge.run.host",
    "sim_device.sweeper",
    "sim_device.body.drive_kernel",
]


@pytest.mark.parametrize("module", [*START, *LATER])
def test_ctrl_c_while_it_starts_ends_it_quietly(module: str, tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(INTERRUPT)
    path = os.pathsep.join((str(tmp_path), str(ROOT)))
    done = sweepctl(
        *("simulate", "case-1", "--max-time", "3", "--json", "--out", tmp_path / "run.mcap"),
        cwd=tmp_path,
        env={"PYTHONPATH": path, "INTERRUPT_AT": module},
    )
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert done.returncode == 0, done.stderr
    # Either no run had begun, or the run reports the interrupt.
    result = json.loads(done.stdout)
    assert result["outcome"] == "stopped"
    log = tmp_path / "run.mcap"
    if result["reason"] == "ended by Ctrl-C":
        assert LogReader(log).problems == []
        assert not LogReader(log).truncated
    else:
        assert result["reason"] == "interrupted before the run began"
        assert done.stderr.strip() == "sweepctl: interrupted"
        assert not log.exists()


@pytest.mark.parametrize(
    "arguments",
    [("info", "run.mcap"), ("simulate", "case-1"), ("report", "run.mcap"), ("doctor", "x.mcap")],
    ids=" ".join,
)
def test_a_working_directory_that_is_gone_is_reported_in_one_line(
    arguments: Sequence[str], tmp_path: Path
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    done = sweepctl(*arguments, cwd=gone, script='rmdir "$PWD" && exec "$@"')
    assert done.returncode in {1, 3}
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("sweepctl: ")
    assert done.stdout == ""


def test_a_shipped_room_needs_no_working_directory(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    log = tmp_path / "run.mcap"
    done = sweepctl(
        *("simulate", "case-1", "--max-time", "1", "--json", "--out", log),
        cwd=gone,
        script='rmdir "$PWD" && exec "$@"',
    )
    assert (done.returncode, done.stderr) == (1, ""), "not ended by the time limit"
    assert log.is_file()


CLOSED = """
import json, os, sys
sys.path[:0] = json.loads(sys.argv[1])
import click, tools.cli.options, tools.cli.outputs, tools.cli.rooms, tools.cli.main
import bridge.record.errors
from pathlib import Path
tools.cli.rooms.load_room("case-1")  # what is imported late, while it still may be read
tools.cli.options.log_path(None, "x")
tools.cli.main.run(["generate", "c", "--out", "before"])
os.chdir("closed")
os.chmod(".", 0)
if os.geteuid() == 0:  # no folder is closed to root, unless it has no capabilities
    import ctypes
    nothing, version_3 = (ctypes.c_uint32 * 6)(), 0x20080522
    assert ctypes.CDLL(None).capset((ctypes.c_uint32 * 2)(version_3, 0), nothing) == 0
print(tools.cli.rooms.load_room("case-1").name)
try:
    tools.cli.outputs.check_outputs([Path("run.html"), Path("../closed/out.png")], [])
except bridge.record.errors.LogWriteError as error:
    print(error)
try:
    print(tools.cli.options.log_path(None, "x"))
except bridge.record.errors.LogWriteError as error:
    print(error)
sys.exit(tools.cli.main.run(["generate", "c", "--out", "wire"]))
"""


def test_a_folder_that_may_not_be_entered_is_reported(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir()
    try:
        done = subprocess.run(
            [sys.executable, "-c", CLOSED, json.dumps([str(ROOT)])],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            timeout=100,
        )
    finally:
        closed.chmod(0o700)
    assert "Traceback" not in done.stderr, done.stderr
    room, outputs, log = done.stdout.splitlines()[-3:]
    assert room == "case-1"
    assert outputs == "cannot write run.html: Permission denied"
    assert log.startswith("cannot write runs/")
    assert done.returncode == 1
    assert done.stderr == "sweepctl: cannot write wire/sweepctl_protocol.h: Permission denied\n"


def test_an_impossible_path_causes_no_exception(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "circle").symlink_to("circle")
    for name in ("n" * 300, "file/below", "circle", "circle/below", "nothing", "a\0b"):
        path = tmp_path / name
        assert not is_there(path)
        assert not is_file(path)
        assert not is_folder(path)
    assert is_file(tmp_path / "file")
    assert is_folder(tmp_path)


def test_outputs_in_a_circle_of_links_are_checked(tmp_path: Path) -> None:
    (tmp_path / "circle").symlink_to("circle")
    from bridge.record.errors import LogWriteError  # noqa: PLC0415 - for this test only

    with pytest.raises(LogWriteError, match="symbolic links"):
        check_outputs([tmp_path / "circle" / "out.png"], [tmp_path / "run.mcap"])


def test_a_log_is_named_after_a_room_of_any_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("r" * 100_000, "台" * 5000, "\udcff" * 300, "a/b" * 100):
        path = log_path(None, name)
        path.write_bytes(b"")
        assert log_path(None, name) != path


def test_a_shipped_room_is_read_with_any_files_in_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "case-1").symlink_to("case-1")
    monkeypatch.chdir(tmp_path)
    assert load_room("case-1").name == "case-1"
