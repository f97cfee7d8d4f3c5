"""``sweepctl monitor --handshake``: sensors of an idle robot, with and without a port owner."""

from __future__ import annotations

import json
import math
import signal
from typing import TYPE_CHECKING

import pytest

import bridge
from protocol.messages.values import Mode
from support.cli import sweepctl
from support.served import Served
from support.terminal import OnTerminal
from support.two_processes import Command
from support.waiting import until
from tools.live.shared import OwnerPicture

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("target")]


@pytest.fixture
def served() -> Iterator[Served]:
    with Served() as served:
        yield served


def test_an_idle_robot_shows_its_sensors_and_stands_still(served: Served) -> None:
    before = served.device.truth.pose
    done = sweepctl("monitor", served.port, "--handshake", "--duration", "2", "--json")
    assert done.status == 0, done.err
    state = done.json["state"]
    assert (state["session"], state["run"], state["mode"]) == ("ready", "waiting", "idle")
    assert state["imu"]["accel_m_s2"][2] == pytest.approx(9.8, abs=0.6)
    assert state["range"]["infrared_left_m"] is None or state["range"]["infrared_left_m"] > 0
    assert state["power"]["battery_v"] > 10
    assert served.device.firmware.mode is Mode.IDLE
    assert served.device.truth.pose == before


def test_each_state_is_a_line(served: Served) -> None:
    done = sweepctl("monitor", served.port, "--handshake", "--duration", "1", "--jsonl")
    states = [json.loads(line) for line in done.out.splitlines()]
    assert len(states) >= 2
    assert all("imu" in state for state in states)
    plain = sweepctl("monitor", served.port, "--handshake", "--duration", "1")
    assert plain.out.startswith("ready/waiting mode=idle stop=")


def test_beside_an_owner_it_shows_the_owners_state(served: Served) -> None:
    with bridge.open(served.port):
        done = sweepctl("monitor", served.port, "--handshake", "--duration", "1", "--json")
    assert done.status == 0
    assert done.json["owner"]["session"] == "ready"
    assert "another sweepctl has" in done.err


@pytest.mark.parametrize("words", [(), ("--handshake",)])
def test_beside_an_owner_a_terminal_shows_the_owners_dashboard(
    served: Served, tmp_path: Path, words: tuple[str, ...]
) -> None:
    run = ("--plan", "u-shape", "--room", "empty", "--out", "run.mcap")
    with Command("connect", served.port, *run, cwd=tmp_path) as owner:
        owner.prints("run is driving")
        with OnTerminal("monitor", served.port, *words, cwd=tmp_path) as terminal:
            for text in ("u-shape", "run driving", "coverage", "swept", "walls", "run is driving"):
                terminal.shows(text)
            terminal.shows("only shows its run")
            owner.send(signal.SIGINT)
            assert owner.end().status == 0
            assert terminal.end() == 0, "it ends with the run"


def test_a_terminal_shows_the_dashboard_of_an_idle_robot(served: Served, tmp_path: Path) -> None:
    until(lambda: served.device.truth.v_m_s == 0.0, what="it rests after its drive")
    before = served.device.truth.pose
    with OnTerminal("monitor", served.port, "--handshake", cwd=tmp_path) as terminal:
        for text in ("run waiting", "idle", "battery", "moves nothing"):
            terminal.shows(text)
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.end() == 0
    assert served.device.truth.pose == before
    assert list(tmp_path.iterdir()) == [], "nothing is recorded"


def test_the_path_before_joining_is_shown_of_an_owner_without_a_dashboard(
    served: Served, tmp_path: Path
) -> None:
    run = ("--plan", "u-shape", "--room", "empty", "--out", "run.mcap", "--quiet")
    with Command("connect", served.port, *run, cwd=tmp_path) as owner:
        owner.prints("run is driving")
        begun_m = served.device.truth.path_m
        until(lambda: served.device.truth.path_m > begun_m + 0.3, what="the robot drives")
        picture = OwnerPicture(served.port, hz=4.0)
        trail = list(picture.facts.trail)
        owner.send(signal.SIGINT)
        assert owner.end().status == 0
    assert len(trail) > 3
    assert sum(map(math.dist, trail, trail[1:])) == pytest.approx(0.3, abs=0.1)


def test_the_robot_file_is_read_before_the_port_is_opened(served: Served, tmp_path: Path) -> None:
    done = sweepctl("monitor", served.port, "--handshake", "--robot", tmp_path / "no.toml")
    assert done.status == 2
    assert "cannot read robot file" in done.line


def test_conflicting_options_are_rejected(served: Served) -> None:
    for words in (("imu",), ("--raw",)):
        done = sweepctl("monitor", served.port, "--handshake", *words)
        assert (done.status, "omit TYPE and --raw" in done.line) == (2, True)
    done = sweepctl("monitor", "/dev/none-such", "--handshake", "--json")
    assert done.status == 3
