"""``sweepctl monitor`` as users run it: it shows messages, and it sends no byte."""

from __future__ import annotations

import json
import os
import pty
import signal
import threading
import time
import tty
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

import bridge
from protocol.messages.device import Hello, Imu, Status
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.cli import end, start, sweepctl
from support.served import Served

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.realtime


class Line:
    """The device's end of a serial line: it sends, and stores all bytes from the host."""

    def __init__(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._link = Link(Direction.DEVICE)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._talk, daemon=True)
        self._thread.start()

    def _talk(self) -> None:
        # Opening a port clears its buffer, so earlier bytes are lost.
        while not self._end.wait(0.02):
            for i in range(2):
                self._link.send(Imu(0, 0, 16384, 0, 0, 0, 131), 10_000 * i, node=1)
            self._link.send(Status(0, 1, 0, 0, 5), 20_000, node=1)
            self._link.send(Hello(1, bytes(12), 1, 0, 0, 0, 1, 0, 0, "x"), 0, node=1)
            with suppress(BlockingIOError):  # nobody reads the port
                os.write(self._master, self._link.data_to_send() + b"\0\x05bad\0")

    def written(self) -> bytes:
        """Return all bytes from the host."""
        found = b""
        with suppress(BlockingIOError):
            while data := os.read(self._master, 4096):
                found += data
        return found

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)


@pytest.fixture
def line() -> Iterator[Line]:
    line = Line()
    yield line
    line.close()


def test_it_reports_everything_and_sends_nothing(line: Line, tmp_path: Path) -> None:
    process = start("monitor", line.port, "--jsonl", "--raw", cwd=tmp_path)
    assert process.stdout is not None
    lines = [process.stdout.readline() for _ in range(60)]
    done = end(process, signal.SIGINT)
    assert done.status == 0
    assert line.written() == b"", "a byte left"
    found = [json.loads(text) for text in lines]
    assert {(f["kind"], f["name"]) for f in found} >= {
        ("message", "imu"),
        ("message", "status"),
        ("message", "hello"),
    }
    imu = next(f for f in found if f["name"] == "imu")
    assert imu["fields"]["accel_z_m_s2"] == pytest.approx(9.80665)
    assert imu["fields"]["gyro_z_rad_s"] == pytest.approx(0.0174533, abs=1e-6)  # 1 °/s
    assert len(imu["raw"]) == 28
    bad = [f for f in found if f["kind"] == "damaged"]
    assert "05626164" in {f["raw"] for f in bad}


def test_one_object_at_the_end(line: Line) -> None:
    done = sweepctl("monitor", line.port, "--duration", "0.5", "--json")
    assert done.status == 0
    types = done.json["types"]
    assert types["imu"]["count"] > types["status"]["count"] > 0
    assert types["status"]["newest"]["stop_cause"] == "session_end"
    assert done.json["damaged"] > 0
    assert done.json["strange_catalogues"] == {"1": "00000001"}
    assert line.written() == b""


def test_lines_for_people(line: Line) -> None:
    done = sweepctl("monitor", line.port, "imu", "--duration", "0.5")
    assert done.status == 0
    names = {text.split()[4] for text in done.out.splitlines() if " < " in text}
    assert names == {"imu"}
    assert "! damaged: 4 B" in done.out
    assert "05 62 61 64" in done.out
    assert "fields may be misread" in done.err
    assert line.written() == b""


def test_impossible_requests() -> None:
    assert "unknown message" in sweepctl("monitor", "/dev/null", "imuu").line
    assert sweepctl("monitor", "/dev/null", "imuu").status == 2
    assert sweepctl("monitor", "/dev/none-such").status == 3
    assert sweepctl("monitor", "/dev/null", "--json", "--jsonl").status == 2


def test_on_a_port_with_an_owner_its_knowledge_is_shown() -> None:
    with Served() as served, bridge.open(served.port) as robot:
        while robot.power.latest is None or robot.range.latest is None:
            time.sleep(0.02)
        done = sweepctl("monitor", served.port, "--duration", "0.3")
        reported = sweepctl("monitor", served.port, "--duration", "0.3", "--json")
        for asked in (("imu",), ("--raw",), ("--node", "3")):
            rejected = sweepctl("monitor", served.port, *asked)
            assert rejected.status == 2
            assert f"{asked[0]}" in rejected.err
            assert "reports its state, not the traffic" in rejected.err
    assert done.status == reported.status == 0
    assert "another sweepctl has" in done.err
    assert "ready/waiting mode=idle stop=session_end" in done.out
    assert "range=2.8" in done.out
    assert reported.json["owner"]["session"] == "ready"
