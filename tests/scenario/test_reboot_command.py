"""``sweepctl reboot`` and ``monitor``, with a free port and with a port that a process owns."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest

from support.cli import sweepctl
from support.terminal import OnTerminal
from support.two_processes import Command, Emulator

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.realtime


def test_a_rebooted_device_reconnects(tmp_path: Path, target: str) -> None:
    with Emulator(tmp_path, "--target", target) as device:
        first = sweepctl("reboot", device.port, "--json")
        again = sweepctl("reboot", device.port, "--json")
    assert (first.status, again.status) == (0, 0), first.err + again.err
    assert "has rebooted (cause: software)" in again.err
    boots = [done.json["device"]["boot_id"] for done in (first, again)]
    assert boots[0] != boots[1]


def test_an_owner_is_asked_and_rejects_while_the_robot_may_move(
    tmp_path: Path, target: str
) -> None:
    with Emulator(tmp_path, "--target", target) as device:
        with Command("connect", device.port, "--out", "watched.mcap", cwd=tmp_path) as owner:
            owner.prints("host and device are compatible")
            done = sweepctl("reboot", device.port, "--json")
            assert done.status == 0, done.err
            owner.prints("the device rebooted")
            owner.send(signal.SIGINT)
            assert owner.end().status == 0
        moving = ("--plan", "paper", "--out", "moving.mcap")
        with Command("connect", device.port, *moving, cwd=tmp_path) as owner:
            owner.prints("run is driving")
            rejected = sweepctl("reboot", device.port)
            assert rejected.status == 4
            assert "the robot may move (run: " in rejected.line
            assert "sweepctl stop" in rejected.line
            owner.send(signal.SIGINT)
            assert owner.end().status == 0


def test_a_monitor_beside_an_owner_is_a_picture_on_a_terminal(tmp_path: Path, target: str) -> None:
    with (
        Emulator(tmp_path, "--target", target) as device,
        Command("connect", device.port, "--out", "watched.mcap", cwd=tmp_path) as owner,
    ):
        owner.prints("host and device are compatible")
        with OnTerminal("monitor", device.port, "--duration", "3", cwd=tmp_path) as terminal:
            for text in ("events", "swept", "this command only shows its run", "Ctrl-C: end"):
                terminal.shows(text)
            assert terminal.end() == 0
            assert terminal.drawn.count(b"mode=") == 0
        lines = sweepctl("monitor", device.port, "--duration", "1")
        assert lines.status == 0
        assert lines.out.count("mode=") >= 2, "without a terminal each look is a line"
        owner.send(signal.SIGINT)
        assert owner.end().status == 0
