"""Commands whose output has no reader: a full pipe, a stopped terminal, a frozen window."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import pytest

from bridge.io.owner_client import ask
from support.cli import sweepctl
from support.processes import COMMAND
from support.root import ROOT
from support.served import Served
from support.terminal import OnTerminal
from support.two_processes import PATIENCE_S
from support.waiting import until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.realtime


@pytest.fixture
def served() -> Iterator[Served]:
    with Served() as served:
        yield served


@contextmanager
def full_pipe() -> Iterator[int]:
    """Yield a full pipe whose reader exists but does not read."""
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    with suppress(BlockingIOError):
        while True:
            os.write(write_end, b".")
    os.set_blocking(write_end, True)
    try:
        yield write_end
    finally:
        os.close(write_end)
        os.close(read_end)


@contextmanager
def unread(
    *arguments: str | Path, cwd: Path, stdout: int = subprocess.PIPE
) -> Iterator[subprocess.Popen[str]]:
    """Run the command with a full pipe for stderr (and ``stdout``, if given)."""
    with full_pipe() as pipe:
        process = subprocess.Popen(
            [*COMMAND, *map(str, arguments)],
            cwd=cwd,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdin=subprocess.DEVNULL,
            stdout=stdout,
            stderr=pipe,
            text=True,
        )
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()
            process.communicate()


def under_way(port: str, path_m: float) -> None:
    """Wait until the run on this port has driven a path of this length."""

    def has_driven() -> bool:
        with suppress(Exception):  # the owner's socket does not exist yet
            return bool(ask(port, {"do": "status"})["status"]["path_m"] > path_m)
        return False

    until(has_driven, what=f"the run has driven {path_m} m")


def whole(log: Path) -> dict[str, Any]:
    """Return the output of ``info``; the log must be complete."""
    found = sweepctl("info", log, "--json").json
    assert found["whole"]
    return found


def test_a_full_pipe_holds_up_neither_the_run_nor_a_stop(served: Served, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with unread(
        *("connect", served.port, "--plan", "paper", "--json", "--out", log), cwd=tmp_path
    ) as process:
        under_way(served.port, 0.1)
        under_way(served.port, 0.2)  # the robot still drives, so setpoints are sent
        stopped = sweepctl("stop", served.port)
        assert stopped.status == 0, stopped.err
        out, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 5
    assert json.loads(out)["outcome"] == "stopped"
    assert "another process" in json.loads(out)["reason"]
    whole(log)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_full_pipe_does_not_hold_up_a_signal(
    number: signal.Signals, served: Served, tmp_path: Path
) -> None:
    log = tmp_path / "run.mcap"
    with unread(
        *("connect", served.port, "--plan", "paper", "--json", "--out", log), cwd=tmp_path
    ) as process:
        under_way(served.port, 0.05)
        process.send_signal(number)
        out, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0
    assert json.loads(out)["outcome"] == "stopped"
    whole(log)


def test_other_commands_end_with_their_status(served: Served, tmp_path: Path) -> None:
    for arguments in (
        ("monitor", served.port, "--lines", "--duration", "1"),
        ("bringup", served.port, "--step", "supply"),
        ("doctor", served.port, "--listen", "--duration", "1"),
        ("param", "list", served.port),
        ("stop", served.port),
    ):
        with full_pipe() as out, unread(*arguments, cwd=tmp_path, stdout=out) as process:
            assert process.wait(PATIENCE_S) in {0, 1, 3}, arguments


def test_an_emulator_serves_on_and_ends(tmp_path: Path) -> None:
    # The port has its own name, because another emulator may get the pty's number during the
    # unplugging.
    link = tmp_path / "robot"
    fault = ("--fault", "unplug@1:0.5")
    with unread("emulate", "case-1", "--pty-link", link, *fault, cwd=tmp_path) as emulator:
        assert emulator.stdout is not None
        port = emulator.stdout.readline().split()[1]
        seen = sweepctl("connect", port, "--duration", "2", "--json", "--out", tmp_path / "c.mcap")
        assert seen.status == 0, seen.err
        emulator.send_signal(signal.SIGTERM)
        assert emulator.wait(PATIENCE_S) == 0


@pytest.mark.parametrize("how", ["held", "hung"])
@pytest.mark.parametrize("kitty", [False, True])
def test_a_terminal_that_takes_nothing_holds_up_nothing(
    how: str,
    kitty: bool,  # noqa: FBT001 - the interface of pytest
    served: Served,
    tmp_path: Path,
) -> None:
    log = tmp_path / "run.mcap"
    with OnTerminal(
        *("connect", served.port, "--plan", "paper", "--out", log), cwd=tmp_path, kitty=kitty
    ) as terminal:
        terminal.shows("run driving")
        if how == "held":
            terminal.hold()
        else:
            terminal.stand_still()
        driven = ask(served.port, {"do": "status"})["status"]["path_m"]
        under_way(served.port, driven + 0.3)  # for seconds: several pictures have no room
        terminal.process.send_signal(signal.SIGTERM)
        assert terminal.process.wait(PATIENCE_S) == 0
    assert whole(log)["summary"]["reason"] == "ended by SIGTERM"


def test_drawing_continues_when_the_reader_is_back(served: Served, tmp_path: Path) -> None:
    with OnTerminal("connect", served.port, "--out", tmp_path / "r.mcap", cwd=tmp_path) as terminal:
        terminal.shows("run waiting")
        terminal.stand_still()
        time.sleep(3.0)  # pictures fill the terminal's buffer
        terminal.resume()
        terminal.press(b"m")
        terminal.shows("mark 1 recorded")
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.end() == 0
        assert b"\x1b[?1049l" in terminal.drawn, "the screen is given back"


def test_a_dumb_terminal_gets_plain_lines(served: Served, tmp_path: Path) -> None:
    with OnTerminal(
        *("connect", served.port, "--out", tmp_path / "r.mcap"), cwd=tmp_path, term="dumb"
    ) as terminal:
        terminal.shows("space s: STOP")
        terminal.shows("ready, run waiting; mode")  # every few seconds
        terminal.press(b"m")
        terminal.shows("mark 1 recorded")
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.end() == 0
    text = terminal.drawn.decode()
    assert all(c.isprintable() or c in "\r\n" for c in text), "no control sequence"
    events = [line for line in text.splitlines() if "session: " in line or "run waiting" in line]
    assert events
    for line in events:
        assert float(line.split()[0]) >= 0.0
    assert any("operator: mark 1 at" in line for line in text.splitlines())
