"""Two processes over a real pty: handshake, motion, recording; and ports without a sweeper."""

from __future__ import annotations

import random
import signal
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING
from zlib import crc32

import pytest
from cobs import cobs

from bridge.record.reader import LogReader
from support.two_processes import Command, Emulator, PtyPeer, Together, connect

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.realtime

DRIVES_S = 4.0
"""Duration of a drive, s, long enough for all counts below."""


def topics(path: Path) -> dict[str, int]:
    counted: dict[str, int] = {}
    for message in LogReader(path).messages():
        counted[message.topic] = counted.get(message.topic, 0) + 1
    return counted


def a_plan_over_a_pty_and_a_second_host_at_the_door(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with Emulator(tmp_path) as device:
        arguments = ("--plan", "paper", "--json", "--out", log)
        with Command("connect", device.port, *arguments, cwd=tmp_path) as host:
            host.prints("run is driving")
            driving_s = time.monotonic()
            busy = connect(tmp_path, device.port, "--json", "--out", tmp_path / "busy.mcap")
            assert busy.status == 3
            assert f"process {host.process.pid}" in busy.complaint
            assert "busy" in busy.complaint
            assert not (tmp_path / "busy.mcap").exists()
            time.sleep(max(0.0, driving_s + DRIVES_S - time.monotonic()))
            host.send(signal.SIGTERM)
            ended = host.end()
        assert ended.status == 0, ended.err
        summary = ended.json
        assert summary["outcome"] == "stopped"
        assert summary["planner"] == "paper"
        assert summary["path_m"] > 0.2
        assert summary["duration_s"] > 1.0
        assert summary["wire"]["crc_errors"] == 0
        assert summary["wire"]["lost"] == 0
        assert summary["wire"]["frames"]["rx"] > 600
        assert summary["log"] == str(log)
        reader = LogReader(log)
        assert not reader.truncated
        assert reader.summary is not None
        assert reader.summary["outcome"] == "stopped"
        counted = topics(log)
        assert counted["/raw/uart/rx"] > 100
        assert counted["/raw/uart/tx"] > 100
        assert counted["/device/imu"] > 300
        assert counted["/pose"] > 50
        assert counted["/cmd"] > 50
        ended = device.stop()
        assert ended.status == 0
        assert ended.out == "", "nothing but the ready line on stdout"


def without_a_log_nothing_is_written(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    with Emulator(tmp_path) as device:
        arguments = (device.port, "--no-record", "--duration", "1", "--json")
        with Command("connect", *arguments, cwd=tmp_path / "here") as host:
            ended = host.end()
    assert ended.status == 0, ended.err
    assert ended.json["log"] is None
    assert ended.json["wire"]["frames"]["rx"] > 50
    assert list((tmp_path / "here").iterdir()) == []


def ctrl_c_stops_the_robot_first_and_closes_the_log_whole(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with Emulator(tmp_path) as device:
        arguments = ("--plan", "paper", "--json", "--out", log)
        with Command("connect", device.port, *arguments, cwd=tmp_path) as host:
            host.prints("run is driving")
            host.send(signal.SIGINT)
            ended = host.end()
        assert ended.status == 0, ended.err
        assert ended.json["outcome"] == "stopped"
        assert ended.json["reason"] == "ended by Ctrl-C", "the device has confirmed the stop"
        reader = LogReader(log)
        assert not reader.truncated
        assert reader.problems == []
        kinds = [m.decoded for m in reader.messages(["/events"])]
        assert any("Ctrl-C" in str(event) for event in kinds)


def _version_3() -> bytes:
    body = bytes([3 << 4, 1, 0x1B, 0, 0, 0, 0, 0]) + bytes(40)
    encoded: bytes = cobs.encode(body + crc32(body).to_bytes(4, "little"))
    return b"\0" + encoded + b"\0"


def ports_that_are_no_sweeper(tmp_path: Path) -> None:
    rng = random.Random(1)
    peers = {
        "silent": PtyPeer(lambda: b""),
        "garbage": PtyPeer(lambda: rng.randbytes(100)),
        "version": PtyPeer(_version_3),
    }
    for name in peers:
        (tmp_path / f"{name}.mcap").write_text("an older log")
    with ExitStack() as stack:
        commands = {}
        for name, peer in peers.items():
            stack.enter_context(peer)
            arguments = (peer.port, "--json", "--out", f"{name}.mcap", "--force")
            commands[name] = stack.enter_context(Command("connect", *arguments, cwd=tmp_path))
        ended = {name: command.end() for name, command in commands.items()}
    assert {name: e.status for name, e in ended.items()} == {
        "silent": 3,
        "garbage": 3,
        "version": 4,
    }
    assert "nothing received" in ended["silent"].complaint
    assert "but no intact frame" in ended["garbage"].complaint
    assert "protocol version 3" in ended["version"].complaint
    for name, end in ended.items():
        assert "Traceback" not in end.err
        assert peers[name].port in end.complaint
        assert end.json["outcome"] == "fault"
        assert end.json["log"] is None
        assert end.err.count(end.json["reason"]) == 1  # only one line contains it
        assert (tmp_path / f"{name}.mcap").read_text() == "an older log"
    assert len(list(tmp_path.glob("*.mcap*"))) == len(peers), "and no log of their own"


SCENARIOS = (
    a_plan_over_a_pty_and_a_second_host_at_the_door,
    without_a_log_nothing_is_written,
    ctrl_c_stops_the_robot_first_and_closes_the_log_whole,
    ports_that_are_no_sweeper,
)


@pytest.fixture(scope="module", name="together")
def _together(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Together]:
    chosen = {s.__name__: s for s in SCENARIOS}
    with Together(chosen, tmp_path_factory.mktemp("connect")) as together:
        yield together


@pytest.mark.parametrize("scenario", [s.__name__ for s in SCENARIOS])
def test_a_real_pty(scenario: str, together: Together) -> None:
    together.result(scenario)


def test_a_port_that_does_not_exist(tmp_path: Path) -> None:
    ended = connect(tmp_path, "/dev/ttySWEEPER9", "--out", tmp_path / "run.mcap")
    assert ended.status == 3
    assert ended.err.count("\n") == 1
    assert "/dev/ttySWEEPER9 does not exist" in ended.complaint
    assert not (tmp_path / "run.mcap").exists()


def test_a_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    ended = connect(tmp_path, str(tmp_path / "notes.txt"))
    assert ended.status == 3
    assert "is not a serial port" in ended.complaint
    assert "Traceback" not in ended.err
