"""A stop on a port that nobody owns: repeated until a device confirms it, or for three seconds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.errors import NoDeviceError, PortError
from bridge.io import clock
from bridge.io.stopping import CONFIRM_S, send_until_confirmed, stop_device
from bridge.session.stop_request import REPEAT_NS, StopRequest
from protocol.clock import HostNs
from protocol.link import NODE_ALL, Received
from protocol.messages.device import Ack, Nack
from protocol.messages.host import Stop
from protocol.messages.values import NackReason, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable

STOP = CATALOGUE.by_class[Stop].type_id
MS = 1_000_000
BEGAN_NS = 5_000 * MS


class Line:
    """A port in virtual time with a device behind it, which answers ``latency_ms`` later."""

    name = "line"

    def __init__(
        self,
        answer: Callable[[Received], Ack | Nack | None],
        *,
        takes: int = 1000,
        latency_ms: int = 1,
        node: int = 4,
    ) -> None:
        self.now_ns = BEGAN_NS
        self.heard: list[Received] = []
        self.heard_ms: list[float] = []
        """When, since the beginning."""
        self.written = b""
        self.waits_s: list[float] = []
        self.closed = False
        self.gone_after: float | None = None
        self._answer, self._takes, self._latency_ns = answer, takes, latency_ms * MS
        self._device, self._node = Link(Direction.DEVICE), node
        self._coming: list[tuple[int, bytes]] = []

    def write(self, data: bytes) -> int:
        taken = data[: self._takes]
        self.written += taken
        for event in self._device.receive(taken):
            if not isinstance(event, Received):
                continue  # a frame that was cut
            self.heard.append(event)
            self.heard_ms.append((self.now_ns - BEGAN_NS) / MS)
            answer = self._answer(event)
            if answer is not None:
                self._device.send(answer, 0, node=self._node)
                at_ns = self.now_ns + self._latency_ns
                self._coming.append((at_ns, self._device.data_to_send()))
        return len(taken)

    def wait(self, timeout_s: float) -> bytes:
        assert timeout_s >= 0.0
        self.waits_s.append(timeout_s)
        if self.gone_after is not None and self.now_ns - BEGAN_NS > self.gone_after * MS:
            raise PortError("line: gone")
        end_ns = self.now_ns + max(round(timeout_s * 1e9), 1)  # a turn of the loop takes time too
        if self._coming and self._coming[0][0] <= end_ns:
            at_ns, data = self._coming.pop(0)
            self.now_ns = max(self.now_ns, at_ns)
            return data
        self.now_ns = end_ns
        return b""

    def wake(self) -> None:
        raise AssertionError("nobody else has the port")

    def close(self) -> None:
        assert not self.closed
        self.closed = True


def confirms(event: Received) -> Ack:
    assert isinstance(event.message, Stop)
    return Ack(event.message.command_id, STOP)


def stop(line: Line, monkeypatch: pytest.MonkeyPatch, node: int | None = None) -> int:
    monkeypatch.setattr(clock, "now", lambda: HostNs(line.now_ns))
    return stop_device("/dev/ttyX", lambda: line, node)


def test_the_node_that_confirms_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(confirms)
    assert stop(line, monkeypatch) == 4
    assert line.closed
    (event,) = line.heard
    assert isinstance(event.message, Stop)
    assert event.message.cause == StopCause.OPERATOR
    assert event.frame.node == NODE_ALL
    assert event.frame.t_us == BEGAN_NS // 1000


def test_each_stop_has_a_command_id_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    ids = set()
    for _ in range(60):
        line = Line(confirms)
        stop(line, monkeypatch)
        message = line.heard[0].message
        assert isinstance(message, Stop)
        ids.add(message.command_id)
    assert len(ids) > 30
    assert max(ids) >= 0x8000, "drawn from all of them"


def test_one_device_of_several_is_asked_for_by_its_node(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(confirms)
    assert stop(line, monkeypatch, node=4) == 4
    assert line.heard[0].frame.node == 4
    other = Line(confirms, node=5)
    with pytest.raises(NoDeviceError):
        stop(other, monkeypatch, node=4)


def test_it_is_repeated_twenty_times_a_second_until_confirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    count = 0

    def after_three(event: Received) -> Ack | None:
        nonlocal count
        count += 1
        return confirms(event) if count > 3 else None

    line = Line(after_three)
    assert stop(line, monkeypatch) == 4
    assert REPEAT_NS == 50 * MS
    assert line.heard_ms == pytest.approx([0.0, 50.0, 100.0, 150.0], abs=0.001)
    assert len({e.message for e in line.heard}) == 1, "one command, repeated as it was"


@pytest.mark.parametrize(
    "answer",
    [
        lambda _: None,
        lambda e: Ack(e.message.command_id ^ 1, STOP),
        lambda e: Ack(e.message.command_id, STOP + 1),
        lambda e: Nack(e.message.command_id, STOP, NackReason.BAD_VALUE),
    ],
    ids=["silent", "another command", "another type", "refused"],
)
def test_what_is_no_confirmation_is_none(
    answer: Callable[[Received], Ack | Nack | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    line = Line(answer)
    with pytest.raises(NoDeviceError) as error:
        stop(line, monkeypatch)
    assert str(error.value) == (
        "/dev/ttyX: no confirmation of the stop within 3 s; switch the robot off"
    )
    assert line.closed
    assert len(line.heard) == round(CONFIRM_S * 1e9 / REPEAT_NS)
    assert line.now_ns - BEGAN_NS == pytest.approx(CONFIRM_S * 1e9, abs=10)


def test_a_confirmation_of_the_last_stop_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(confirms, latency_ms=2_999)
    assert stop(line, monkeypatch) == 4


def test_it_sleeps_until_the_next_one_is_due(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(lambda _: None)
    with pytest.raises(NoDeviceError):
        stop(line, monkeypatch)
    assert line.waits_s == pytest.approx([0.05] * 60, abs=1e-6)


def test_what_was_not_taken_of_a_stop_is_replaced_by_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line = Line(confirms, takes=5)
    monkeypatch.setattr(clock, "now", lambda: HostNs(line.now_ns))
    request = StopRequest(Link, StopCause.SUPERVISE, 7)
    sent: list[tuple[bytes, int]] = []
    end_ns = HostNs(BEGAN_NS + 1000 * MS)
    send_until_confirmed(line, request, end_ns, lambda data, at: sent.append((data, at)))
    assert request.confirmed_by is None
    assert b"".join(data for data, _ in sent) == line.written
    assert [len(data) for data, _ in sent] == [5] * 20
    times = [at - BEGAN_NS for _, at in sent]
    assert times == pytest.approx([50 * MS * i for i in range(20)], abs=30)
    assert line.heard == []


def test_what_the_port_did_not_take_follows_within_the_turn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Something that comes meanwhile ends the wait, and the rest goes out before the next stop."""
    line = Line(confirms, takes=12)
    monkeypatch.setattr(clock, "now", lambda: HostNs(line.now_ns))
    noise = iter([b"\1", b"\2", b"\3"])
    silent = line.wait

    def wait(timeout_s: float) -> bytes:
        line.now_ns += MS
        return next(noise, b"") or silent(timeout_s)

    monkeypatch.setattr(line, "wait", wait)
    request = StopRequest(Link, StopCause.OPERATOR, 7)
    send_until_confirmed(line, request, HostNs(BEGAN_NS + 1000 * MS))
    assert request.confirmed_by == 4
    assert len(line.heard) == 1
    assert line.heard_ms[0] < 10.0


def test_a_port_that_vanishes_is_given_back_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(lambda _: None)
    line.gone_after = 400
    with pytest.raises(PortError, match="gone"):
        stop(line, monkeypatch)
    assert line.closed


def test_without_time_left_nothing_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(confirms)
    monkeypatch.setattr(clock, "now", lambda: HostNs(line.now_ns))
    send_until_confirmed(line, StopRequest(Link, StopCause.OPERATOR, 1), HostNs(BEGAN_NS))
    assert line.written == b""


def test_nothing_goes_out_before_the_next_stop_is_due() -> None:
    request = StopRequest(Link, StopCause.OPERATOR, 0x1_FEDC)
    first = request.data_to_send(HostNs(BEGAN_NS))
    assert request.next_deadline() == BEGAN_NS + REPEAT_NS
    assert request.data_to_send(HostNs(BEGAN_NS + REPEAT_NS - 1)) == b""
    assert request.data_to_send(HostNs(BEGAN_NS + REPEAT_NS)) != b""
    (event,) = Link(Direction.DEVICE).receive(first)
    assert isinstance(event, Received)
    assert event.message == Stop(0xFEDC, StopCause.OPERATOR), "its low 16 bits"
