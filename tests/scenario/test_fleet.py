"""Four robots at once: one is killed, one is unplugged, and one STOP stops all."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyte
import pytest

from bridge.record.reader import LogReader
from support.cli import sweepctl
from support.json_schema import check_output
from support.terminal import OnTerminal
from support.two_processes import PATIENCE_S, Command, Emulator, connect
from support.waiting import until

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = [pytest.mark.realtime, pytest.mark.slow]

COLUMNS, LINES = 120, 40


def screen(terminal: OnTerminal) -> list[str]:
    """Return the lines on the screen."""
    shown = pyte.Screen(COLUMNS, LINES)
    pyte.ByteStream(shown).feed(terminal.drawn)
    return list(shown.display)


def wait_for(terminal: OnTerminal, condition: Callable[[list[str]], bool]) -> list[str]:
    until_s = time.monotonic() + PATIENCE_S
    while not condition(lines := screen(terminal)):
        assert time.monotonic() < until_s, "\n".join(lines)
        time.sleep(0.1)
    return lines


def row(lines: list[str], name: str) -> str:
    """Return the row of a robot in the table."""
    found = [line for line in lines if line.startswith(f"│ {name} ")]
    return found[0] if found else ""


def test_one_stop_for_four_robots_of_which_two_are_gone(tmp_path: Path) -> None:
    with ExitStack() as stack:
        names = ("kitchen", "hall", "bath", "office")
        devices: dict[str, Emulator] = {}
        for number, name in enumerate(names):
            words: tuple[str, ...] = ("--seed", str(number))
            if name == "bath":
                words += ("--control", str(tmp_path / "bath.ctl"))
            devices[name] = stack.enter_context(Emulator(tmp_path, *words))
        ports = [f'[robots.{name}]\nport = "{devices[name].port}"\n' for name in names]
        (tmp_path / "sweepctl.toml").write_text("".join(ports))
        fleet = stack.enter_context(
            OnTerminal(
                *("fleet", *names, "--plan", "paper", "--out", "logs"),
                cwd=tmp_path,
                SWEEPCTL_CONFIG=str(tmp_path / "sweepctl.toml"),
            )
        )
        lines = wait_for(
            fleet, lambda seen: all("ready, driving" in row(seen, name) for name in names)
        )
        assert "4 robots, 4 running" in lines[0]
        assert "space s: STOP ALL" in lines[-1]
        os.kill(devices["hall"].process.pid, signal.SIGKILL)
        assert sweepctl("fault", tmp_path / "bath.ctl", "unplug:1000").status == 0
        gone = ("hall", "bath")
        lines = wait_for(fleet, lambda seen: all("lost" in row(seen, name) for name in gone))
        for name in ("kitchen", "office"):
            assert "ready, driving" in row(lines, name)
        fleet.press(b" ")
        assert fleet.end() == 3
        for name in gone:
            fleet.shows(f"{name}: the stop is NOT CONFIRMED; switch the robot off")
        again = connect(
            tmp_path, devices["kitchen"].port, "--plan", "paper", "--out", tmp_path / "again.mcap"
        )
        assert again.status != 0
        assert "operator" in again.err, "the stop is latched on the device"
    for name in ("kitchen", "office"):
        reader = LogReader(tmp_path / "logs" / f"{name}.mcap")
        assert not reader.truncated
        assert reader.summary is not None
        assert reader.summary["outcome"] == "stopped"
    for name in gone:
        assert not LogReader(tmp_path / "logs" / f"{name}.mcap").truncated


def test_a_stop_that_every_robot_confirms_is_reported(tmp_path: Path) -> None:
    with Emulator(tmp_path) as first, Emulator(tmp_path, "--seed", "1") as second:
        ports = (first.port, second.port)
        with OnTerminal("fleet", *ports, "--plan", "paper", "--out", "logs", cwd=tmp_path) as fleet:
            wait_for(fleet, lambda seen: sum("ready, driving" in line for line in seen) == 2)
            fleet.press(b"s")
            assert fleet.end() == 5
            fleet.shows("every robot has confirmed the stop")


def wait_for_plan(fleet: Command, port: str) -> None:
    """Wait until the planner of a robot has made its first decision."""
    line = re.compile(rf"^{re.escape(port)}: +[\d.]+  planner: ", re.MULTILINE)
    until(lambda: line.search(fleet.printed), what=f"a decision of the planner on {port}")


def fleet_result(command: Command, words: list[str]) -> dict[str, Any]:
    done = command.end()
    check_output(words, done.out)
    result = json.loads(done.out)
    assert isinstance(result, dict)
    assert result["exit_status"] == done.status
    return result


def test_ctrl_c_ends_every_run_cleanly(tmp_path: Path) -> None:
    with Emulator(tmp_path) as first, Emulator(tmp_path, "--seed", "1") as second:
        words = ["fleet", first.port, second.port, "--plan", "paper", "--out", "logs", "--json"]
        with Command(*words, cwd=tmp_path) as fleet:
            wait_for_plan(fleet, first.port)
            wait_for_plan(fleet, second.port)
            fleet.send(signal.SIGINT)
            result = fleet_result(fleet, words)
    assert result["exit_status"] == 0
    assert (result["stop_requested"], result["unconfirmed"]) == (False, [])
    for robot in result["robots"]:
        assert (robot["outcome"], robot["exit_status"]) == ("stopped", 0)
        assert robot["summary"]["planner"] == "paper"
        assert not LogReader(tmp_path / robot["log"]).truncated


def test_a_robot_whose_process_is_killed_is_stopped_and_the_other_goes_on(tmp_path: Path) -> None:
    with Emulator(tmp_path) as first, Emulator(tmp_path, "--seed", "1") as second:
        words = ["fleet", first.port, second.port, "--plan", "paper", "--duration", "9", "--json"]
        with Command(*words, cwd=tmp_path) as fleet:
            wait_for_plan(fleet, first.port)
            os.kill(child_of(fleet.process.pid, first.port), signal.SIGKILL)
            fleet.prints("its process was killed by signal 9; stopping the robot")
            result = fleet_result(fleet, words)
    killed, other = result["robots"]
    assert killed["stop_confirmed"]
    assert (killed["outcome"], killed["exit_status"]) == ("fault", 1)
    assert (other["outcome"], other["exit_status"]) == ("stopped", 0)
    assert other["summary"]["path_m"] > 0.1
    assert result["exit_status"] == 1


def child_of(pid: int, port: str) -> int:
    """Return the process of a robot, found by its command line."""
    for task in Path("/proc").iterdir():
        try:
            parent = int((task / "stat").read_text("utf-8").rpartition(")")[2].split()[1])
            words = (task / "cmdline").read_text("utf-8").split("\0")
        except (OSError, IndexError, UnicodeDecodeError):
            continue
        if parent == pid and "connect" in words and port in words:
            return int(task.name)
    raise AssertionError(f"no process for {port}")


def test_a_port_that_does_not_exist_is_named_and_the_other_robot_runs(tmp_path: Path) -> None:
    with Emulator(tmp_path) as device:
        missing = str(tmp_path / "none")
        words = ["fleet", device.port, missing, "--duration", "2", "--out", "logs", "--json"]
        with Command(*words, cwd=tmp_path) as fleet:
            result = fleet_result(fleet, words)
    there, gone = result["robots"]
    assert (there["outcome"], there["exit_status"]) == ("stopped", 0)
    assert (gone["outcome"], gone["exit_status"], gone["log"]) == ("fault", 3, None)
    assert missing in gone["reason"]
    assert result["exit_status"] == 3


@pytest.mark.parametrize(
    ("words", "wrong"),
    [
        ((), "Missing argument"),
        (("/dev/a", "/dev/a"), "given twice"),
        (("/dev/a", "--plan", "paper", "--supervise"), "not both"),
        (("/dev/a", "--onboard", "paper"), "--onboard needs --supervise"),
    ],
)
def test_wrong_usage_starts_nothing(words: tuple[str, ...], wrong: str) -> None:
    done = sweepctl("fleet", *words)
    assert (done.status, wrong in done.err) == (2, True)


def test_an_existing_log_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "dev-a.mcap").write_bytes(b"")
    done = sweepctl("fleet", "/dev/a", "--out", tmp_path)
    assert done.status == 1
    assert "dev-a.mcap exists" in done.line
