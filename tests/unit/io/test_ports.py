"""Real serial ports, as far as a pseudo-terminal behaves like a serial port."""

from __future__ import annotations

import os
import pty
import resource
import socket
import stat
import threading
import tty
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from bridge.errors import PortBusyError, PortError
from bridge.io.can_port import CanPort
from bridge.io.ports import SerialPort

if TYPE_CHECKING:
    from collections.abc import Iterator


class Pty:
    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        self.path = os.ttyname(self.slave)
        self._open = [self.master, self.slave]

    def hang_up(self) -> None:
        while self._open:
            os.close(self._open.pop())


@pytest.fixture(name="wire")
def _wire() -> Iterator[Pty]:
    wire = Pty()
    yield wire
    wire.hang_up()


def test_bytes_pass_both_ways(wire: Pty) -> None:
    with SerialPort(wire.path) as port:
        os.write(wire.master, b"\x00\x11\x13\x03\x0a\x0d\xff")
        assert port.wait(1.0) == b"\x00\x11\x13\x03\x0a\x0d\xff", "raw: no byte means anything"
        assert port.write(b"\x00\x04\n") == 3
        assert os.read(wire.master, 10) == b"\x00\x04\n"
        assert port.wait(0.0) == b""


def test_a_full_port_reports_so_and_does_not_spin(wire: Pty) -> None:
    """The non-blocking write of pyserial repeats until the port accepts bytes."""
    with SerialPort(wire.path) as port:
        taken = 0
        while written := port.write(bytes(1000)):
            taken += written
            assert taken < 1_000_000, "it never says that it is full"
        got = 0
        while got < taken:
            got += len(os.read(wire.master, 65536))
        assert port.write(b"x") == 1


def test_a_wait_can_be_ended(wire: Pty) -> None:
    with SerialPort(wire.path) as port:
        timer = threading.Timer(0.05, port.wake)
        timer.start()
        assert port.wait(60.0) == b""
        timer.join()
        assert port.wait(0.0) == b"", "one wake ends one wait"


def test_a_vanished_port_is_reported_by_name(wire: Pty) -> None:
    with SerialPort(wire.path) as port:
        wire.hang_up()
        with pytest.raises(PortError, match=f"{wire.path} is gone"):
            port.wait(1.0)
        with pytest.raises(PortError, match="is gone"):
            port.write(b"x")


@pytest.mark.parametrize(
    ("sent", "reason"),
    [
        (b"refused: busy with another host\r\n", ": the peer sent text instead of frames: refused"),
        (b"", " is gone: it was unplugged"),
        (b"\x00\x10\x11frame\x00", " is gone: it was unplugged"),
        (b"boot of something\n\x00\x10\x11\n", " is gone: it was unplugged"),
    ],
)
def test_a_closed_port_reports_the_peers_reason(sent: bytes, reason: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        name = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with SerialPort(name) as port:
            client, _ = server.accept()
            with client:
                client.sendall(sent)
            received = b""
            while received != sent:
                received += port.wait(5.0)
            with pytest.raises(PortError) as caught:
                port.wait(5.0)
        assert str(caught.value).startswith(f"{name}{reason}")


def test_a_busy_port_names_its_owner(wire: Pty) -> None:
    with (
        SerialPort(wire.path),
        pytest.raises(PortBusyError, match=f"process {os.getpid()}") as caught,
    ):
        SerialPort(wire.path)
    assert caught.value.exit_status == 3
    with SerialPort(wire.path) as again:
        assert again.write(b"x") == 1


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("/dev/ttySWEEPER9", "does not exist"),
        ("/dev/null", "is not a serial port"),
        ("/", "cannot open"),
        ("socket://", "port"),
        ("socket://127.0.0.1:1", "cannot open"),
        ("nonsense://x", "is not a port"),
    ],
)
def test_a_port_that_cannot_be_opened_is_one_line(name: str, word: str) -> None:
    with pytest.raises(PortError) as caught:
        SerialPort(name)
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_status == 3


def _descriptors() -> int:
    return sum(1 for _ in Path("/dev/fd").iterdir())


def test_opening_leaves_no_descriptor_behind(wire: Pty, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no port")
    before = _descriptors()
    for _ in range(5):
        with SerialPort(wire.path):
            pass
        with pytest.raises(PortError):
            SerialPort(str(tmp_path / "file"))
    assert _descriptors() == before


@pytest.fixture(name="crowded")
def _crowded() -> Iterator[None]:
    """Keep 1200 files of this process open."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(4096, hard)), hard))
    held: list[int] = []
    try:
        held.append(os.open(os.devnull, os.O_RDONLY))
        while len(held) < 1200:
            held.append(os.dup(held[0]))
        yield
    finally:
        for number in held:
            os.close(number)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.usefixtures("crowded")
def test_a_port_works_in_a_process_with_a_thousand_files(wire: Pty) -> None:
    """Its descriptor is beyond the range of ``select``."""
    with SerialPort(wire.path) as port:
        assert port.wait(0.0) == b""
        os.write(wire.master, b"hello")
        assert port.wait(5.0) == b"hello"
        assert port.write(b"x") == 1
        assert os.read(wire.master, 10) == b"x"
        threading.Timer(0.05, port.wake).start()
        assert port.wait(5.0) == b""
        wire.hang_up()
        with pytest.raises(PortError, match="is gone"):
            port.wait(5.0)


@pytest.mark.usefixtures("crowded")
def test_a_tcp_port_works_in_a_process_with_a_thousand_files() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        name = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with SerialPort(name) as port:
            client, _ = server.accept()
            with client:
                client.sendall(b"hello")
                assert port.wait(5.0) == b"hello"
                assert port.write(b"x") == 1
                assert client.recv(10) == b"x"


@pytest.mark.usefixtures("crowded")
def test_a_bus_that_python_can_cannot_wait_for_is_an_error(wire: Pty) -> None:
    """Its reads would end in an error that looks like a garbled line, forever."""
    with pytest.raises(PortError, match=r"1024 or more open files.*close some"):
        CanPort(f"can:slcan:{wire.path}")


def test_a_wake_never_writes_to_a_descriptor_that_was_closed_meanwhile(
    wire: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another file may already have its number."""
    port = SerialPort(wire.path)
    closing = threading.Thread(target=port.close)
    real_write = os.write
    written: list[bool] = []

    def write(fd: int, data: bytes) -> int:
        if not written:
            closing.start()
            closing.join(timeout=0.2)  # it has closed by now what it can close
            written.append(stat.S_ISFIFO(os.fstat(fd).st_mode))
        return real_write(fd, data)

    monkeypatch.setattr(os, "write", write)
    try:
        port.wake()
    finally:
        closing.join()
    assert written == [True], "the pipe was still open"
