"""The loop of a port in virtual time: its waiting times and its data."""

from __future__ import annotations

import pytest

from bridge.io import clock
from bridge.io.port_loop import MAX_WAIT_S, Listening, serve
from protocol.clock import HostNs

BEGAN_NS = 7_000_000_000
MS = 1_000_000


class Port:
    """A port whose bytes arrive at the end of a wait; a wait takes at least 1 µs."""

    name = "port"

    def __init__(self, *coming: bytes) -> None:
        self.now_ns = BEGAN_NS
        self.waits_s: list[float] = []
        self.written: list[bytes] = []
        self._coming = list(coming)

    def wait(self, timeout_s: float) -> bytes:
        self.waits_s.append(timeout_s)
        self.now_ns += max(round(timeout_s * 1e9), 1000)
        return self._coming.pop(0) if self._coming else b""

    def write(self, data: bytes) -> int:
        self.written.append(data)
        return len(data)

    def wake(self) -> None:
        raise AssertionError("nobody else has the port")

    def close(self) -> None:
        raise AssertionError("whoever opened it closes it")


class Due:
    """A protocol engine that sends once, at a given time."""

    def __init__(self, due_ns: int) -> None:
        self.taken: list[tuple[bytes, int]] = []
        self._due_ns = due_ns

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        self.taken.append((data, now_ns))

    def data_to_send(self, now_ns: HostNs) -> bytes:
        return b"due" if now_ns == self._due_ns else b""

    def next_deadline(self) -> HostNs:
        return HostNs(self._due_ns)


@pytest.fixture(name="port")
def _port(monkeypatch: pytest.MonkeyPatch) -> Port:
    port = Port(b"a", b"", b"b")
    monkeypatch.setattr(clock, "now", lambda: HostNs(port.now_ns))
    return port


def test_a_listener_takes_everything_with_its_time_and_sends_nothing(port: Port) -> None:
    taken: list[tuple[bytes, int]] = []
    listener = Listening(lambda data, now_ns: taken.append((data, now_ns)))
    serve(port, listener, HostNs(BEGAN_NS + 250 * MS))
    times = [BEGAN_NS + ms * MS for ms in (100, 200, 250)]
    assert taken == list(zip([b"a", b"", b"b"], times, strict=True))
    assert port.waits_s == pytest.approx([MAX_WAIT_S, MAX_WAIT_S, 0.05])
    assert port.written == []
    assert listener.data_to_send(HostNs(0)) == b""


def test_without_an_end_it_runs_until_it_is_stopped(port: Port) -> None:
    taken: list[bytes] = []
    listener = Listening(lambda data, _now_ns: taken.append(data))
    serve(port, listener, None, lambda: len(taken) == 3)
    assert taken == [b"a", b"", b"b"]
    assert port.waits_s == [MAX_WAIT_S] * 3


def test_due_bytes_are_sent_on_time(port: Port) -> None:
    engine = Due(BEGAN_NS + 30 * MS)
    sent: list[tuple[bytes, int]] = []
    end_ns = HostNs(BEGAN_NS + 31 * MS)
    serve(port, engine, end_ns, sent=lambda data, now_ns: sent.append((data, now_ns)))
    assert sent == [(b"due", BEGAN_NS + 30 * MS)]
    assert port.written == [b"due"]
    assert port.waits_s[0] == pytest.approx(0.03)
    assert set(port.waits_s[1:]) == {0.0}, "a moment that has passed is not waited for"
    assert engine.taken[0] == (b"a", BEGAN_NS + 30 * MS)


def test_at_its_end_it_does_nothing_more(port: Port) -> None:
    engine = Due(BEGAN_NS)
    serve(port, engine, HostNs(BEGAN_NS))
    assert (port.written, port.waits_s, engine.taken) == ([], [], [])
