"""The safety chain over a real pty, each link broken.

Bounds are of the emulator's own time, plus the time for which the machine did not run it. The
emulator reads a setpoint that arrived before the break when it runs again. The time to live starts
then.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from typing import TYPE_CHECKING

import pytest

from bridge.io.owner_client import ask
from bridge.record.reader import LogReader
from sim_device.ports.control import ask_control
from support.root import ROOT
from support.targets import TARGETS
from support.two_processes import (
    PATIENCE_S,
    Command,
    Emulator,
    Together,
    connect,
    held_up_s,
    last_motion_s,
    truth,
)
from support.waiting import until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from support.processes import Done
    from support.two_processes import Pose

pytestmark = pytest.mark.realtime

AT_REST_S = 0.25 + 0.45
"""Maximum time until the robot is at rest, s: the time to live, and the ramp with the motors' lag.
"""
MOVING_M_S = 0.15
STOOD_S = 0.1
"""Maximum standstill of a driving robot, s: it turns at the end of a lane."""


def drive(device: Emulator, cwd: Path, *arguments: str | Path) -> Command:
    host = Command("connect", device.port, "--plan", "paper", *arguments, cwd=cwd)
    host.prints("run is driving")
    under_way(device, 0.08)
    return host


def under_way(device: Emulator, path_m: float) -> None:
    """Wait until the robot has driven this path and moves; a busy machine is slow."""

    def moving() -> bool:
        reported = ask(device.port, {"do": "status"})["status"]
        return bool(reported["path_m"] > path_m and reported["v_m_s"] > MOVING_M_S)

    until(moving)


def comes_to_rest(poses: list[Pose], before_s: float, broken_s: float) -> None:
    """Check that the robot moved until ``before_s``, and rests soon after ``broken_s``."""
    stood_s = last_motion_s(poses)
    assert stood_s > before_s - STOOD_S, "it was moving"
    held_s = held_up_s(poses, before_s, stood_s)
    assert stood_s < broken_s + AT_REST_S + held_s, f"the machine held it up for {held_s:.3f} s"


def run(cwd: Path, *arguments: str) -> Done:
    """Run any command to its end."""
    with Command(*arguments, cwd=cwd) as command:
        return command.end()


def a_killed_host(tmp_path: Path, target: str) -> None:
    log, world = tmp_path / "killed.mcap", tmp_path / "truth.mcap"
    with Emulator(tmp_path, "--target", target, "--truth", world) as device:
        with drive(device, tmp_path, "--out", log) as host:
            before_s = time.time()
            host.send(signal.SIGKILL)
            assert host.end().status == -signal.SIGKILL
            killed_s = time.time()
        time.sleep(1.3)
        rejected = connect(tmp_path, device.port, "--plan", "paper", "--json", "--out", "r.mcap")
        again_s = time.time()
        assert rejected.status == 5
        assert "cause: link" in rejected.complaint
        assert "--clear-stop" in rejected.complaint
        assert rejected.json["outcome"] == "stopped"
        with drive(device, tmp_path, "--clear-stop", "--json", "--out", "f.mcap") as host:
            under_way(device, 0.12)
            host.send(signal.SIGINT)
            freed = host.end()
        assert freed.status == 0, freed.err
        assert freed.json["path_m"] > 0.1
        assert device.stop().status == 0
    poses = [p for p in truth(world) if p.at_s < again_s]
    comes_to_rest(poses, before_s, killed_s)
    assert poses[-1].at_s > killed_s + 1.2
    reader = LogReader(log)
    assert sum(1 for _ in reader.messages(["/device/imu"])) > 200, "the log is readable"


def a_host_that_is_stopped_and_goes_on(tmp_path: Path, target: str) -> None:
    world = tmp_path / "truth.mcap"
    with Emulator(tmp_path, "--target", target, "--truth", world) as device:
        with drive(device, tmp_path, "--json", "--out", tmp_path / "run.mcap") as host:
            before_s = time.time()
            host.send(signal.SIGSTOP)
            host.is_stopped()
            frozen_s = time.time()
            time.sleep(2.5)
            host.send(signal.SIGCONT)
            ended = host.end()
        time.sleep(0.5)
        assert device.stop().status == 0
    assert ended.status == 5, ended.err
    assert "check it, then restart" in ended.json["reason"]
    comes_to_rest(truth(world), before_s, frozen_s)


def a_port_that_vanishes_and_comes_back(tmp_path: Path, target: str) -> None:
    link = tmp_path / "port"
    log = tmp_path / "run.mcap"
    with Emulator(tmp_path, "--target", target, "--pty-link", link) as device:
        assert device.port == str(link)
        host = drive(device, tmp_path, "--json", "--out", log)
        with host:
            device.send(signal.SIGKILL)
            device.end()
            host.prints("link:")
            world = tmp_path / "second.mcap"
            with Emulator(
                tmp_path, "--target", target, "--pty-link", link, "--truth", world
            ) as second:
                ended = host.end()
                time.sleep(0.3)
                assert second.stop().status == 0
            assert last_motion_s(truth(world)) < 0, "it does not drive on by itself"
    assert ended.status == 5, ended.err
    assert "lost and is back" in ended.json["reason"]
    assert not LogReader(log).truncated


def a_plug_that_is_pulled_and_put_back(tmp_path: Path, target: str) -> None:
    """The device runs on meanwhile; the run asks, and continues after a person's confirmation."""
    world, control = tmp_path / "truth.mcap", tmp_path / "ctl"
    link = tmp_path / "port"
    with Emulator(
        tmp_path, "--target", target, "--pty-link", link, "--truth", world, "--control", control
    ) as device:
        with drive(device, tmp_path, "--resume", "ask", "--out", tmp_path / "run.mcap") as host:
            before_s = time.time()
            assert ask_control(control, "start unplug:1.5")["ok"]
            pulled_s = time.time()
            host.prints("is gone: it was unplugged")
            host.prints("the device is back without a reboot")
            host.prints("press r")
            time.sleep(1.0)
            again_s = time.time()
            assert ask(device.port, {"do": "resume"})["ok"]
            host.prints("stop cleared: link")
            path_m = ask_control(control, "truth")["truth"]["path_m"]
            until(lambda: ask_control(control, "truth")["truth"]["path_m"] > path_m + 0.1)
            moved_s = time.time()
            stopped = run(tmp_path, "stop", device.port, "--json")
            assert stopped.status == 0
            assert stopped.json["confirmed"] is True
            assert host.end().status == 5
        time.sleep(0.5)
        assert device.stop().status == 0
    poses = truth(world)
    comes_to_rest([p for p in poses if p.at_s < again_s], before_s, pulled_s)
    assert last_motion_s([p for p in poses if p.at_s < moved_s]) > again_s, "it went on when asked"


def a_line_that_stalls_and_then_delivers_what_is_old(tmp_path: Path, target: str) -> None:
    world, control = tmp_path / "truth.mcap", tmp_path / "ctl"
    with Emulator(tmp_path, "--target", target, "--truth", world, "--control", control) as device:
        with drive(device, tmp_path, "--json", "--out", tmp_path / "run.mcap") as host:
            before_s = time.time()
            assert ask_control(control, "start latency:3:ms=3000,way=down")["ok"]
            stalled_s = time.time()
            ended = host.end()
            time.sleep(max(0.0, stalled_s + 7.0 - time.time()))  # all of it has arrived by then
        assert device.stop().status == 0
    assert ended.status == 5, "the status of the device shows a latched stop"
    assert "the device did not confirm the stop" in ended.complaint, "its answer is 3 s late"
    comes_to_rest(truth(world), before_s, stalled_s)  # old setpoints move nothing


BLOCKED = """
import sys, time, bridge
with bridge.open(sys.argv[1]) as robot:
    robot.enable()
    for _ in range(40):
        robot.drive(0.15, 0.0)
        time.sleep(0.05)
    def block():
        print(time.time(), flush=True)
        time.sleep(2.5)
    robot._pump.call(block)  # the loop's own thread is held up
    time.sleep(2.0)
"""


def an_event_loop_that_is_blocked(tmp_path: Path, target: str) -> None:
    world = tmp_path / "truth.mcap"
    with Emulator(tmp_path, "--target", target, "--truth", world) as device:
        done = subprocess.run(
            [sys.executable, "-c", BLOCKED, device.port],
            capture_output=True,
            text=True,
            check=True,
            timeout=PATIENCE_S,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        assert device.stop().status == 0
    blocked_s = float(done.stdout)
    comes_to_rest(truth(world), blocked_s, blocked_s)


def a_stop_from_another_shell(tmp_path: Path, target: str) -> None:
    world = tmp_path / "truth.mcap"
    with Emulator(tmp_path, "--target", target, "--truth", world) as device:
        with drive(device, tmp_path, "--json", "--out", tmp_path / "run.mcap") as host:
            asked_s = time.time()
            stopped = run(tmp_path, "stop", device.port)
            answered_s = time.time()
            assert stopped.status == 0, stopped.err
            assert "confirmed by the device" in stopped.err
            ended = host.end()
        assert ended.status == 5
        assert "stopped by another process (process" in ended.json["reason"]
        # without an owner, `stop` opens the port itself
        again = run(tmp_path, "stop", device.port, "--json")
        assert again.status == 0
        by_wire = {"by": "wire", "confirmed": True, "node": 1, "nodes": [1]}
        assert again.json == {"port": device.port, **by_wire}
        rejected = connect(tmp_path, device.port, "--plan", "paper", "--out", "refused.mcap")
        assert rejected.status == 5
        assert "cause: operator" in rejected.complaint
        assert device.stop().status == 0
        silent = run(tmp_path, "stop", device.port)
        assert silent.status == 3
    comes_to_rest(truth(world), asked_s, answered_s)


SCENARIOS = (
    a_killed_host,
    a_host_that_is_stopped_and_goes_on,
    a_port_that_vanishes_and_comes_back,
    a_plug_that_is_pulled_and_put_back,
    a_line_that_stalls_and_then_delivers_what_is_old,
    an_event_loop_that_is_blocked,
    a_stop_from_another_shell,
)


@pytest.fixture(scope="module", name="together", params=TARGETS)
def _together(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Together]:
    chosen = {s.__name__: partial(s, target=request.param) for s in SCENARIOS}
    with Together(chosen, tmp_path_factory.mktemp("safety")) as together:
        yield together


@pytest.mark.parametrize("scenario", [s.__name__ for s in SCENARIOS])
def test_the_robot_stands(scenario: str, together: Together) -> None:
    together.result(scenario)
