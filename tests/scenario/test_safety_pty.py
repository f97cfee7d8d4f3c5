"""The safety chain over a real pty, each link broken: bounds are of the emulator's own time."""

from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING

import pytest

from bridge.record.reader import LogReader
from support.two_processes import (
    Command,
    Emulator,
    Together,
    connect,
    last_motion_s,
    truth,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

AT_REST_S = 0.25 + 0.45
"""Time to live, and the ramp with the motors' lag."""
SLACK_S = 0.3
"""What two busy cores may add between our clock and the kernel's delivery of a signal."""


def drive(device: Emulator, cwd: Path, *arguments: str | Path) -> Command:
    host = Command("connect", device.port, "--plan", "paper", *arguments, cwd=cwd)
    host.says("run is driving")
    time.sleep(0.8)  # by now it is under way
    return host


def a_killed_host(tmp_path: Path) -> None:
    log, world = tmp_path / "killed.mcap", tmp_path / "truth.mcap"
    with Emulator(tmp_path, "--truth", world) as device:
        with drive(device, tmp_path, "--out", log) as host:
            killed_s = time.time()
            host.send(signal.SIGKILL)
            assert host.end().status == -signal.SIGKILL
        time.sleep(1.3)
        refused = connect(tmp_path, device.port, "--plan", "paper", "--json", "--out", "r.mcap")
        again_s = time.time()
        assert refused.status == 5
        assert "cause: link" in refused.complaint
        assert "--clear-stop" in refused.complaint
        assert refused.json["outcome"] == "stopped"
        freed = connect(
            tmp_path,
            device.port,
            *("--plan", "paper", "--clear-stop", "--duration", "5", "--json", "--out", "f.mcap"),
        )
        assert freed.status == 0, freed.err
        assert freed.json["path_m"] > 0.1
        assert device.stop().status == 0
    poses = [p for p in truth(world) if p.at_s < again_s]
    stood_s = last_motion_s(poses)
    assert stood_s > killed_s - 0.1, "it was moving when the host died"
    assert stood_s < killed_s + AT_REST_S + SLACK_S
    assert poses[-1].at_s > killed_s + 1.2
    reader = LogReader(log)
    assert sum(1 for _ in reader.messages(["/device/imu"])) > 200, "the log is readable"


def a_host_that_is_stopped_and_goes_on(tmp_path: Path) -> None:
    world = tmp_path / "truth.mcap"
    with Emulator(tmp_path, "--truth", world) as device:
        with drive(device, tmp_path, "--json", "--out", tmp_path / "run.mcap") as host:
            frozen_s = time.time()
            host.send(signal.SIGSTOP)
            time.sleep(2.5)
            host.send(signal.SIGCONT)
            ended = host.end()
        time.sleep(0.5)
        assert device.stop().status == 0
    assert ended.status == 5, ended.err
    assert "look, then start anew" in ended.json["reason"]
    stood_s = last_motion_s(truth(world))
    assert frozen_s - 0.1 < stood_s < frozen_s + AT_REST_S + SLACK_S, "it never moved again"


def a_port_that_vanishes_and_comes_back(tmp_path: Path) -> None:
    link = tmp_path / "port"
    log = tmp_path / "run.mcap"
    with Emulator(tmp_path, "--pty-link", link) as device:
        assert device.port == str(link)
        host = drive(device, tmp_path, "--json", "--out", log)
        with host:
            device.send(signal.SIGKILL)
            device.end()
            host.says("link:")
            world = tmp_path / "second.mcap"
            with Emulator(tmp_path, "--pty-link", link, "--truth", world) as second:
                ended = host.end()
                time.sleep(0.3)
                assert second.stop().status == 0
            assert last_motion_s(truth(world)) < 0, "it does not drive on by itself"
    assert ended.status == 5, ended.err
    assert "lost and is back" in ended.json["reason"]
    assert not LogReader(log).truncated


SCENARIOS = (a_killed_host, a_host_that_is_stopped_and_goes_on, a_port_that_vanishes_and_comes_back)


@pytest.fixture(scope="module", name="together")
def _together(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Together]:
    with Together(SCENARIOS, tmp_path_factory.mktemp("safety")) as together:
        yield together


@pytest.mark.parametrize("scenario", [s.__name__ for s in SCENARIOS])
def test_the_robot_stands(scenario: str, together: Together) -> None:
    together.result(scenario)
