"""``sweepctl drive`` and ``connect`` on a terminal: keys, the dead-man button, the picture."""

from __future__ import annotations

import os
import struct
from typing import TYPE_CHECKING

import pytest

from bridge.record.reader import LogReader
from protocol.messages.values import StopCause
from support.cli import sweepctl
from support.root import ROOT
from support.served import Served
from support.terminal import OnTerminal
from support.waiting import until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("target")]

UP, UP_AGAIN, UP_RELEASED = b"\x1b[A", b"\x1b[1;1:2A", b"\x1b[1;1:3A"


@pytest.fixture
def served() -> Iterator[Served]:
    with Served() as served:
        yield served


def latched(served: Served) -> int:
    """Return the stop cause that the device has latched."""
    return int(served.device.firmware.latch.cause)


def rests(served: Served) -> bool:
    return served.device.truth.v_m_s == 0.0


def test_a_tap_drives_a_little_and_space_stops(served: Served, tmp_path: Path) -> None:
    truth = served.device.truth
    with OnTerminal("drive", served.port, "--out", tmp_path / "d.mcap", cwd=tmp_path) as terminal:
        terminal.shows("run driving")
        assert served.device.truth.pose == truth.pose, "nothing moves by itself"
        terminal.press(UP)
        until(lambda: served.device.truth.path_m > 0.02)
        assert served.device.truth.v_m_s < 0.13
        until(lambda: rests(served))  # the robot stops without a command
        # 0.7 s at 0.1 m/s, the ramps, and the delay of a setpoint on a busy machine
        assert 0.03 < served.device.truth.path_m < 0.15
        assert latched(served) == StopCause.NONE, "letting go is no stop"
        terminal.press(b"m")
        terminal.shows("mark 1 recorded")
        terminal.press(b" ")
        assert terminal.end() == 5
    assert latched(served) == StopCause.OPERATOR
    messages = list(LogReader(tmp_path / "d.mcap").messages(["/events"]))
    assert any("mark 1 at" in str(message.decoded) for message in messages)

    rejected = sweepctl("drive", served.port)
    assert rejected.status == 2, "no terminal, no drive"
    assert "terminal" in rejected.line
    with OnTerminal("drive", served.port, cwd=tmp_path) as again:
        assert again.end() == 5
        assert b"add --clear-stop" in again.drawn
    assert latched(served) == StopCause.OPERATOR


def pad_event(kind: int, number: int, value: int) -> bytes:
    return struct.pack("<IhBB", 0, value, kind, number)


OPEN_FIFO = """
import os
from bridge.io import gamepad
gamepad.open_joystick = lambda path: os.open(path, os.O_RDONLY | os.O_NONBLOCK)
"""
"""Module that Python loads at its start. It lets a FIFO stand for a joystick device."""


def test_a_held_key_or_stick_drives_until_its_release(served: Served, tmp_path: Path) -> None:
    pad = tmp_path / "js0"
    os.mkfifo(pad)
    keeper = os.open(pad, os.O_RDWR)

    def push() -> None:
        os.write(keeper, pad_event(1, 4, 1) + pad_event(2, 1, -20000))

    (tmp_path / "sitecustomize.py").write_text(OPEN_FIFO)
    path = os.pathsep.join((str(tmp_path), str(ROOT)))
    asked = ("drive", served.port, "--speed", "0.2", "--gamepad", pad)
    with OnTerminal(*asked, cwd=tmp_path, kitty=True, PYTHONPATH=path) as terminal:
        terminal.shows("run driving")
        terminal.shows("hold")
        terminal.press(UP)
        until(lambda: served.device.truth.path_m > 0.3, lambda: terminal.press(UP_AGAIN))
        assert served.device.truth.v_m_s == pytest.approx(0.2, abs=0.03)
        terminal.press(UP_RELEASED)
        until(lambda: rests(served))
        assert latched(served) == StopCause.NONE
        before_m = served.device.truth.path_m
        until(lambda: served.device.truth.path_m > before_m + 0.05, push)
        os.write(keeper, pad_event(1, 4, 0))  # the pad's dead-man button is released
        until(lambda: rests(served))
        assert latched(served) == StopCause.NONE
        terminal.press(b"\x1b[99;5u")  # Ctrl-C in the kitty keyboard protocol
        assert terminal.end() == 0
        assert b"\x1b[>11u" in terminal.drawn
        assert terminal.drawn.count(b"\x1b[<u") == 1, "the terminal is put back"
    os.close(keeper)
    assert latched(served) == StopCause.SESSION_END


def test_connect_shows_and_starts_only_when_asked_twice(served: Served, tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text("wheel_base_m = 0.25\n")
    with OnTerminal("connect", served.port, "--robot", file, cwd=tmp_path) as terminal:
        terminal.shows("wheel_base: the device has 0.23 m, the robot file has 0.25 m")
        for text in ("run waiting", "battery", "front", "lost", "events", "are compatible"):
            terminal.shows(text)
        terminal.press(b"g")
        terminal.shows("press g again to start the plan")
        assert latched(served) == StopCause.SESSION_END, "nothing was asked"
        terminal.press(b"g")
        terminal.shows("run driving")
        until(lambda: served.device.truth.path_m > 0.05)
        terminal.press(b"p")
        terminal.shows("the plan is paused")
        until(lambda: rests(served))
        terminal.press(b"s")
        assert terminal.end() == 5
    assert latched(served) == StopCause.OPERATOR


def test_the_viewers_address_is_shown_during_the_run(served: Served, tmp_path: Path) -> None:
    with OnTerminal("connect", served.port, "--serve", cwd=tmp_path) as terminal:
        terminal.shows("run waiting")
        _, picture = terminal.drawn.split(b"\x1b[?1049h", 1)  # alternate screen
        for part in ("port", served.port, "elapsed", "viewer", "http://127.0.0.1:", "log", "runs/"):
            assert part.encode() in picture, part
        terminal.press(b"s")
        assert terminal.end() == 5
