"""``emulate`` as a real process: its links, the names of its ports, and its end."""

from __future__ import annotations

import os
import re
import secrets
import signal
import socket
import subprocess
import threading
import time
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

import can
import pytest

from bridge.io.ports import open_port
from bridge.io.stopping import stop_device
from protocol.messages.host import TimeRequest
from protocol.schema.message import Direction
from protocol.uart.link import Link
from sim_device.ports import PortUnavailableError, PtyPort, ask_control
from sim_device.ports.tcp import SILENT_S
from support.processes import COMMAND
from support.root import ROOT
from support.targets import TARGETS
from support.two_processes import PATIENCE_S, Command, Emulator, Together, connect

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.realtime


def read_all(client: socket.socket) -> bytes:
    """Read until the other end closes."""
    client.settimeout(PATIENCE_S)
    data = b""
    while more := client.recv(4096):
        data += more
    return data


@contextmanager
def talking(client: socket.socket) -> Iterator[None]:
    """Request the device's time four times a second; a host does it at least once a second."""
    over, link = threading.Event(), Link(Direction.HOST)

    def talk() -> None:
        while not over.wait(0.25):
            link.send(TimeRequest(1), 0, node=1)
            client.sendall(link.data_to_send())

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def tcp_one_client_and_a_reason_for_the_second(tmp_path: Path, target: str) -> None:
    with Emulator(tmp_path, "--target", target, "--link", "tcp") as device:
        found = re.fullmatch(r"socket://127\.0\.0\.1:(\d+)", device.port)
        assert found
        address = ("127.0.0.1", int(found[1]))
        with socket.create_connection(address) as first:
            device.prints(f"127.0.0.1:{first.getsockname()[1]} is connected")
            with socket.create_connection(address) as second:
                printed = read_all(second).decode()
            assert printed.count("\n") == 1
            assert "rejected: this sweeper has a host already, 127.0.0.1:" in printed
            device.prints("was rejected")
            with talking(first):
                ended = connect(tmp_path, device.port, "--json", "--out", "refused.mcap")
            assert ended.status == 3
            assert "text instead of frames: rejected: this sweeper has a host" in ended.complaint
            reported = [line for line in ended.err.splitlines() if "session: opened" not in line]
            assert reported == [ended.complaint], "one line, and no tries to open it again"
            assert first.recv(100), "the first hears the device all the same"
        device.prints("has left")
        how = ("--json", "--out", "run.mcap", "--adapter-delay", "500,500")
        ended = connect(tmp_path, device.port, "--duration", "1", *how)  # a new client
        assert ended.status == 0, ended.err
        assert "reduce --adapter-delay" in ended.err
        assert ended.json["wire"]["frames"]["rx"] > 50
        assert ended.json["wire"]["crc_errors"] == 0
        ended = device.stop()
    assert (ended.status, ended.out) == (0, "")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(address)


def tcp_a_stop_beside_the_host(tmp_path: Path, target: str) -> None:
    with Emulator(tmp_path, "--target", target, "--link", "tcp") as device:
        how = ("--plan", "paper", "--json", "--out", "run.mcap")
        with Command("connect", device.port, *how, cwd=tmp_path) as host:
            host.prints("run is driving")
            # Use the port directly, as from another machine. On this machine, `stop` would send its
            # request to the process that owns the port.
            assert stop_device(device.port, partial(open_port, device.port)) == [1]
            ended = host.end()
        device.prints("stops the robot")
        assert ended.status == 5, ended.err
        assert "cause: operator" in ended.complaint
        assert device.stop().status == 0


def tcp_a_silent_client_gives_way(tmp_path: Path, target: str) -> None:
    with Emulator(tmp_path, "--target", target, "--link", "tcp") as device:
        host, _, number = device.port.removeprefix("socket://").partition(":")
        with socket.create_connection((host, int(number))) as silent:
            device.prints(f"127.0.0.1:{silent.getsockname()[1]} is connected")
            time.sleep(SILENT_S)
            assert stop_device(device.port, partial(open_port, device.port)) == [1]
            ended = connect(tmp_path, device.port, "--duration", "1", "--json", "--out", "r.mcap")
            assert ended.status == 0, ended.err
            assert b"\0ended: this sweeper had no frame from here for 3 s" in read_all(silent)
        device.prints("it gives way to")
        assert device.stop().status == 0


def tcp_with_a_shared_key(tmp_path: Path, target: str) -> None:
    key, other = tmp_path / "robot.key", tmp_path / "other.key"
    for path in (key, other):
        path.write_text(secrets.token_hex(16))
        path.chmod(0o600)
    with Emulator(tmp_path, "--target", target, "--link", "tcp", "--key-file", key) as device:
        plan = ("--plan", "paper", "--json")
        for number, extra in enumerate([(), ("--key-file", other)]):
            rejected = connect(tmp_path, device.port, *plan, *extra, "--out", f"r{number}.mcap")
            assert rejected.status == 4, rejected.err
            assert "key" in rejected.complaint
        mine = ("--key-file", key, "--duration", "0.1", "--out", "run.mcap")
        ended = connect(tmp_path, device.port, *plan, *mine)
        assert ended.status == 0, ended.err
        assert device.stop().status == 0


def two_that_want_one_link(tmp_path: Path, target: str) -> None:
    link = tmp_path / "sweeper"
    with Emulator(tmp_path, "--target", target, "--pty-link", link) as first:
        held = link.readlink()
        with pytest.raises(PortUnavailableError, match="another emulator that still runs"):
            PtyPort(link)
        assert link.readlink() == held
        first.process.kill()  # no process removes its link
        first.process.wait()
        assert link.is_symlink()
        with Emulator(tmp_path, "--target", target, "--pty-link", link) as heir:
            assert link.is_char_device()
            assert heir.stop().status == 0
        assert not os.path.lexists(link)


def a_port_pulled_and_put_back(tmp_path: Path, target: str) -> None:
    link = tmp_path / "sweeper"
    control = tmp_path / "control"
    with Emulator(tmp_path, "--target", target, "--pty-link", link, "--control", control) as device:
        arguments = (link, "--duration", "5", "--json", "--out", "run.mcap")
        with Command("connect", *arguments, cwd=tmp_path) as host:
            host.prints("host and device are compatible")
            assert ask_control(control, "start unplug:1.5")["ok"]
            device.prints("the port is unplugged")
            assert not os.path.lexists(link)
            device.prints(f"the port is back: {link}")
            assert link.is_symlink()
            ended = host.end()
        assert ended.status == 0, ended.err
        assert ended.json["reason"] == "the requested duration is over"
        assert "is gone" in ended.err
        assert "sweeper is back" in ended.err
        assert ended.err.count("host and device are compatible") == 2
        assert device.stop().status == 0
    assert not os.path.lexists(link)


def a_line_that_is_too_slow_is_reported(tmp_path: Path, target: str) -> None:
    with Emulator(tmp_path, "--target", target, "--baud", "19200", "--stats") as device:
        ended = connect(tmp_path, device.port, "--duration", "3", "--json", "--out", "r.mcap")
        assert ended.status == 0, ended.err
        reported = device.stop().err
    # 1920 B/s whatever the streams need, for the duration that the emulator reports.
    found = re.search(
        r"ran ([\d.]+) s in (\d+) periods: lateness ([\d.]+) ms.* (\d+) B to the host", reported
    )
    assert found, reported
    assert int(found[4]) <= 1920 * float(found[1])
    lost = re.search(r"\d+ B were lost in the device: it sent more than", reported)
    assert (lost is None) == (target == "core"), "the core drops frames before the line is full"


def an_adapter_as_python_can_expects_it(tmp_path: Path, target: str) -> None:
    with Emulator(tmp_path, "--target", target, "--link", "slcan") as device:
        channel = device.port.removeprefix("can:slcan:")
        bus = can.Bus(
            interface="slcan", channel=channel, bitrate=500_000, sleep_after_open=0.0,
            ignore_config=True,
        )  # fmt: skip
        with bus:
            assert bus.get_version(2.0) == (10, 13)  # type: ignore[attr-defined]  # slcan's own
            assert bus.get_serial_number(2.0) == "SW01"  # type: ignore[attr-defined]
            seen = {bus.recv(2.0) for _ in range(3)}
            assert all(m is not None and m.arbitration_id & 0xF == 1 for m in seen), "its hello"
            bus.send(can.Message(arbitration_id=0x7FF, data=b"", is_extended_id=False))
        assert device.stop().status == 0


def nothing_is_left_however_it_ends(tmp_path: Path, target: str) -> None:
    link, control = tmp_path / "sweeper", tmp_path / "control"
    for number in (signal.SIGTERM, signal.SIGINT):
        with Emulator(
            tmp_path, "--target", target, "--pty-link", link, "--control", control
        ) as device:
            assert sorted(tmp_path.iterdir()) == [control, link]
            device.send(number)
            assert device.end().status == 0
        assert list(tmp_path.iterdir()) == []
    # The reader of the ready line may then close it: the device runs on, and ends as usual.
    arguments = [*COMMAND, "emulate", "--pty-link", str(link), "--fault", "silence@0.3:0.1"]
    with subprocess.Popen(
        arguments,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == f"ready {link}\n".encode()
        process.stdout.close()
        process.stderr.close()
        time.sleep(1.0)  # the fault has no reader
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
    assert list(tmp_path.iterdir()) == []


SCENARIOS = (
    tcp_one_client_and_a_reason_for_the_second,
    tcp_a_stop_beside_the_host,
    tcp_a_silent_client_gives_way,
    tcp_with_a_shared_key,
    two_that_want_one_link,
    a_port_pulled_and_put_back,
    a_line_that_is_too_slow_is_reported,
    an_adapter_as_python_can_expects_it,
    nothing_is_left_however_it_ends,
)


@pytest.fixture(scope="module", name="together", params=TARGETS)
def _together(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Together]:
    chosen = {s.__name__: partial(s, target=request.param) for s in SCENARIOS}
    with Together(chosen, tmp_path_factory.mktemp("links")) as together:
        yield together


@pytest.mark.parametrize("scenario", [s.__name__ for s in SCENARIOS])
def test_emulate(scenario: str, together: Together) -> None:
    together.result(scenario)
