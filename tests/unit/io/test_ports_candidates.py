"""Candidate ports: found by USB descriptors, by stable names, and by the hellos on them."""

from __future__ import annotations

import errno
import os
import pty
import re
import threading
import time
import tty
from contextlib import contextmanager, suppress
from importlib.resources import files
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from bridge.errors import PortError
from bridge.io import candidates as module
from bridge.io import ports
from bridge.io.candidates import ADAPTERS, Candidate, candidates, probe
from bridge.io.reopening import Opener, PortOptions, stable_name
from protocol.link import Received
from protocol.messages.device import Hello
from protocol.messages.host import HostHello
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path


PATIENCE_S = 60.0
"""Maximum time of a step, s; only a hang is longer."""


def info(device: str, vid: int | None, pid: int | None, **more: Any) -> SimpleNamespace:  # noqa: ANN401 - as pyserial's
    reported = {"serial_number": None, "manufacturer": None, "product": None, "description": "n/a"}
    return SimpleNamespace(device=device, vid=vid, pid=pid, **{**reported, **more})


@pytest.fixture(name="by_id")
def _by_id(tmp_path: Path) -> Path:
    folder = tmp_path / "by-id"
    folder.mkdir()
    for name in ("ttyUSB0", "ttyACM0"):
        (tmp_path / name).touch()
    (folder / "usb-FTDI_A5-if00").symlink_to("../ttyUSB0")
    return folder


def test_likely_ones_come_first_by_their_stable_names(
    by_id: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = [
        info("/dev/ttyS0", None, None),
        info(str(tmp_path / "ttyACM0"), 0xAD50, 0x60C4, serial_number="C1"),
        info(str(tmp_path / "ttyUSB0"), 0x0403, 0x6001, serial_number="A5"),
        info("/dev/ttyUSB9", 0x1234, 0x5678, manufacturer="Acme", product="Modem"),
    ]
    monkeypatch.setattr("bridge.io.candidates.list_ports.comports", lambda: listed)
    monkeypatch.setattr(module, "NET", tmp_path / "net")
    (tmp_path / "net" / "can0").mkdir(parents=True)
    (tmp_path / "net" / "can0" / "type").write_text("280\n")
    (tmp_path / "net" / "eth0").mkdir()
    (tmp_path / "net" / "eth0" / "type").write_text("1\n")
    found = candidates(by_id=by_id)
    assert [(one.port, one.what, one.known) for one in found] == [
        (f"can:slcan:{tmp_path / 'ttyACM0'}", "CANtact (slcan)", True),
        (str(by_id / "usb-FTDI_A5-if00"), "FTDI FT232R", True),
        ("/dev/ttyS0", "serial port", False),
        ("/dev/ttyUSB9", "Acme Modem", False),
        ("can:socketcan:can0", "CAN interface", False),
    ]
    assert found[1].usb_id == "0403:6001"


def test_a_stable_name_is_followed_wherever_it_leads(by_id: Path, tmp_path: Path) -> None:
    link = str(by_id / "usb-FTDI_A5-if00")
    assert stable_name(str(tmp_path / "ttyUSB0"), by_id) == link
    assert stable_name(f"can:slcan:{tmp_path / 'ttyUSB0'}", by_id) == f"can:slcan:{link}"
    assert stable_name(str(tmp_path / "ttyACM0"), by_id) == str(tmp_path / "ttyACM0")
    assert stable_name(link, by_id) == link, "a link that was given is kept"
    assert stable_name("socket://127.0.0.1:7", by_id) == "socket://127.0.0.1:7"


class Pty:
    """A pseudo-terminal: both ends of a serial line."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.name = os.ttyname(self.slave)

    def received(self) -> bytes:
        try:
            return os.read(self.master, 4096)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture(name="line")
def _line() -> Iterator[Pty]:
    line = Pty()
    yield line
    line.close()


def test_the_same_adapter_is_opened_again_under_another_name(tmp_path: Path, line: Pty) -> None:
    folder = tmp_path / "by-id"
    folder.mkdir()
    link = folder / "usb-FTDI_A5-if00"
    link.symlink_to(line.name)
    opener = Opener(line.name, PortOptions(), by_id=folder)
    opener().close()
    assert opener.stable == str(link)
    other = Pty()
    try:
        link.unlink()
        link.symlink_to(other.name)
        with opener() as port:  # type: ignore[attr-defined]  # as of a serial port
            assert port.name == str(link)
            port.write(b"here")
            assert other.received() == b"here"
            assert line.received() == b""
    finally:
        other.close()


def hello(link: Link) -> bytes:
    link.send(Hello(CATALOGUE.hash, bytes(range(12)), 7, 0, 0, 0, 1, 2, 3, "test"), 0, node=4)
    return link.data_to_send()


@contextmanager
def repeating(line: Pty, printed: Callable[[], bytes]) -> Iterator[None]:
    """Send bytes repeatedly, because opening a port discards earlier bytes."""
    end = threading.Event()

    def speak() -> None:
        while not end.wait(0.01):
            with suppress(BlockingIOError):
                os.write(line.master, printed())

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def test_probing_only_listens(line: Pty, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LISTEN_S", PATIENCE_S)
    device = Link(Direction.DEVICE)
    with repeating(line, lambda: hello(device)):
        (found,) = probe(candidates([line.name]))
    assert found.found == {"node": 4, "uid": bytes(range(12)).hex(), "firmware": "test 1.2.3"}
    assert line.received() == b"", "no byte to a device that nobody knows"


def test_active_probing_asks(line: Pty, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LISTEN_S", PATIENCE_S)
    asked: list[object] = []

    def device() -> None:
        link = Link(Direction.DEVICE)
        while not asked:
            for event in link.receive(line.received()):
                assert isinstance(event, Received)
                asked.append(event.message)
                os.write(line.master, hello(link))
            time.sleep(0.01)

    thread = threading.Thread(target=device)
    thread.start()
    (found,) = probe(candidates([line.name]), active=True)
    thread.join()
    assert found.found is not None
    assert [type(message) for message in asked] == [HostHello]


def test_a_line_that_is_no_sweeper_s(line: Pty, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LISTEN_S", 0.05)
    (silent,) = probe(candidates([line.name]))
    assert silent.note == "silent"
    sentence = b"$GPGGA,\r\n"
    with repeating(line, lambda: sentence):
        for listen_s in (0.1, 1.0, PATIENCE_S / 2):  # longer if the sender was delayed
            monkeypatch.setattr(module, "LISTEN_S", listen_s)
            (talking,) = probe(candidates([line.name]))
            if talking.note != "silent":
                break
    assert talking.note is not None
    assert re.match(r"received [1-9]\d* bytes but no hello", talking.note)


def test_an_open_file_is_left_alone(line: Pty) -> None:
    taken = Candidate(line.name, line.name, "as given", owner=4321)
    (left,) = probe([taken])
    assert left.note == "process 4321 has it open"
    with ports.SerialPort(line.name):
        (mine,) = candidates([line.name])
        assert mine.owner == os.getpid()


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    (gone,) = probe(candidates([str(tmp_path / "ttyUSB3")]))
    assert gone.note is not None
    assert "does not exist" in gone.note


# ---- access -----------------------------------------------------------------------------


def test_denied_access_reports_the_remedy(line: Pty, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("bridge.io.ports.serial.serial_for_url", denied)
    with pytest.raises(PortError, match="permission denied") as error:
        ports.SerialPort(line.name)
    text = str(error.value)
    assert "sweepctl ports --udev-rule" in text
    assert "usermod -aG" in text or "group" not in text


def test_the_udev_rule_names_every_adapter_of_the_table() -> None:
    rule = files("tools").joinpath("data/70-sweepctl.rules").read_text(encoding="utf-8")
    named = re.findall(r'ATTRS\{idVendor\}=="(\w{4})", ATTRS\{idProduct\}=="(\w{4})"', rule)
    assert {(int(vid, 16), int(pid, 16)) for vid, pid in named} == set(ADAPTERS)
    for needed in ('ENV{ID_MM_DEVICE_IGNORE}="1"', 'TAG+="uaccess"', "SYMLINK+=", "GROUP="):
        assert needed in rule


def test_the_udev_rule_is_well_formed() -> None:
    """By the grammar of udev(7): KEY[{attribute}] operator "value", separated by commas."""
    pair = r'[A-Z]+(?:\{[\w/]+\})?(?:==|!=|=|\+=|-=|:=)"[^"]*"'
    rule = files("tools").joinpath("data/70-sweepctl.rules").read_text(encoding="utf-8")
    lines = [line for line in rule.splitlines() if line and not line.startswith("#")]
    for line in lines:
        assert re.fullmatch(f"{pair}(?:, {pair})*", line), line
    labels = set(re.findall(r'LABEL="(\w+)"', rule))
    assert set(re.findall(r'GOTO="(\w+)"', rule)) == labels
