"""A stop without a session is repeated until the devices confirm it, for at most 3 s."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.errors import NoDeviceError, PortError
from bridge.io import clock
from bridge.io.stopping import CONFIRM_S, send_until_confirmed, stop_device
from bridge.session.stop_request import REPEAT_NS, AddressedStop, StopEverything, stop_request
from protocol.can.link import CanLink
from protocol.clock import HostNs
from protocol.link import NODE_ALL, Received
from protocol.messages.device import Ack, Nack, Status, Sync
from protocol.messages.host import Stop, StopAll
from protocol.messages.values import NackReason, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction, Message
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable

LATCHED = Status(0, StopCause.OPERATOR, 0, 0, 0)
STOP = CATALOGUE.by_class[Stop].type_id
MS = 1_000_000
BEGAN_NS = 5_000 * MS


class Line:
    """A port in virtual time, with a device that answers after ``latency_ms``."""

    name = "line"

    def __init__(
        self,
        answer: Callable[[Received], Message | None],
        *,
        takes: int = 1000,
        latency_ms: int = 1,
        node: int = 4,
    ) -> None:
        self.now_ns = BEGAN_NS
        self.received: list[Received] = []
        self.heard_ms: list[float] = []
        """Arrival times of the frames at the device, ms since the beginning."""
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
                continue  # a truncated frame
            self.received.append(event)
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


def confirms(event: Received) -> Status:
    assert isinstance(event.message, StopAll)
    return LATCHED


def acknowledges(event: Received) -> Ack:
    assert isinstance(event.message, Stop)
    return Ack(event.message.command_id, STOP)


def stop(line: Line, monkeypatch: pytest.MonkeyPatch, node: int | None = None) -> list[int]:
    monkeypatch.setattr(clock, "now", lambda: HostNs(line.now_ns))
    return stop_device("/dev/ttyX", lambda: line, node)


def test_the_node_that_confirms_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(confirms)
    assert stop(line, monkeypatch) == [4]
    assert line.closed
    (event,) = line.received
    assert event.message == StopAll()
    assert (event.frame.node, event.frame.seq, event.frame.t_us) == (NODE_ALL, 0, 0)


def test_the_bytes_are_the_same_from_every_sender(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal bytes prevent two senders on one CAN bus from corrupting each other's frames."""
    line = Line(lambda _: None)
    line.now_ns += 123_456_789
    with pytest.raises(NoDeviceError):
        stop(line, monkeypatch, node=9)
    assert len(set(line.written.split(b"\0")) - {b""}) == 1
    for link in (Link, CanLink):
        bytes_of = set()
        for began_ms in range(0, 500, 7):
            request = StopEverything(link)
            bytes_of |= {
                request.data_to_send(HostNs(began_ms * MS + i * REPEAT_NS)) for i in range(9)
            }
        assert len(bytes_of) == 1


def test_another_device_s_confirmation_is_not_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    assert stop(Line(confirms), monkeypatch, node=4) == [4]
    other = Line(confirms, node=5)
    with pytest.raises(NoDeviceError) as error:
        stop(other, monkeypatch, node=4)
    assert str(error.value) == (
        "/dev/ttyX: no confirmation of the stop from node 4 within 3 s (confirmed by node 5); "
        "switch the robot off"
    )


def test_the_stop_is_repeated_every_25_ms_until_confirmed(monkeypatch: pytest.MonkeyPatch) -> None:
    count = 0

    def after_three(event: Received) -> Status | None:
        nonlocal count
        count += 1
        return confirms(event) if count > 3 else None

    line = Line(after_three)
    assert stop(line, monkeypatch) == [4]
    assert REPEAT_NS == 25 * MS
    assert line.heard_ms == pytest.approx([0.0, 25.0, 50.0, 75.0], abs=0.001)


@pytest.mark.parametrize(
    ("answer", "whose"),
    [
        (lambda _: None, ""),
        (lambda _: Ack(0, 0), " from node 4"),
        (lambda _: Status(0, StopCause.NONE, 0, 0, 0), " from node 4"),
        (lambda _: Status(0, StopCause.SESSION_END, 0, 0, 0), " from node 4"),
    ],
    ids=["silent", "another message", "free", "latched before, with a lesser cause"],
)
def test_other_messages_are_no_confirmation(
    answer: Callable[[Received], Message | None], whose: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = Line(answer)
    with pytest.raises(NoDeviceError) as error:
        stop(line, monkeypatch)
    assert str(error.value) == (
        f"/dev/ttyX: no confirmation of the stop{whose} within 3 s; switch the robot off"
    )
    assert line.closed
    assert len(line.received) == round(CONFIRM_S * 1e9 / REPEAT_NS)
    assert line.now_ns - BEGAN_NS == pytest.approx(CONFIRM_S * 1e9, abs=10)


def test_on_a_bus_every_detected_device_must_confirm() -> None:
    request = StopEverything(CanLink)
    devices = {node: CanLink(Direction.DEVICE) for node in (2, 3)}

    def report(node: int, cause: StopCause, at_ms: int) -> None:
        device, now_ns = devices[node], HostNs(at_ms * MS)
        device.send(Sync(0), now_ns // 1000, node=node)
        device.send(Status(0, cause, 0, 0, 0), now_ns // 1000, node=node)
        request.receive(device.data_to_send(), now_ns)

    request.data_to_send(HostNs(1000 * MS))
    report(3, StopCause.OPERATOR, 1005)
    report(3, StopCause.NONE, 1100)  # the stop of node 3 has been cleared since
    assert (request.confirmed_by, request.confirmed) == (None, [3]), (
        "other nodes may still be silent"
    )
    report(2, StopCause.LINK, 1190)
    request.receive(b"", HostNs(1300 * MS))
    assert (request.confirmed_by, request.missing) == (None, [2])
    report(2, StopCause.HARDWARE, 1310)
    request.receive(b"", HostNs(1390 * MS))
    assert (request.confirmed_by, request.missing) == (2, [])
    assert request.confirmed == [2, 3]


def test_on_a_bus_the_devices_are_known_200_ms_after_the_last_of_them() -> None:
    request, device = StopEverything(CanLink), CanLink(Direction.DEVICE)
    request.data_to_send(HostNs(BEGAN_NS))
    for message in (Sync(0), LATCHED):
        device.send(message, 0, node=3)
    request.receive(device.data_to_send(), HostNs(BEGAN_NS + 5 * MS))
    request.receive(b"", HostNs(BEGAN_NS + 205 * MS - 1))
    assert request.confirmed_by is None
    request.receive(b"", HostNs(BEGAN_NS + 205 * MS))
    assert request.confirmed_by == 3


def test_on_a_bus_the_confirmation_of_a_known_node_waits_for_others() -> None:
    request, device = StopEverything(CanLink, 3), CanLink(Direction.DEVICE)
    request.data_to_send(HostNs(BEGAN_NS))
    for message in (Sync(0), LATCHED):
        device.send(message, 0, node=3)
    request.receive(device.data_to_send(), HostNs(BEGAN_NS + 5 * MS))
    request.receive(b"", HostNs(BEGAN_NS + 200 * MS - 1))
    assert request.confirmed_by is None
    request.receive(b"", HostNs(BEGAN_NS + 200 * MS))
    assert request.confirmed_by == 3


@pytest.mark.parametrize("fields", [b"\0" + bytes([StopCause.OPERATOR]), None])
def test_a_status_of_another_version_confirms_too(fields: bytes | None) -> None:
    """The first two fields are enough, and further fields do no harm."""
    spec = CATALOGUE.by_class[Status]
    request, other = StopEverything(Link), Link(Direction.DEVICE)
    request.data_to_send(HostNs(BEGAN_NS))
    payload = fields or spec.layout.pack(0, StopCause.OPERATOR, 0, 0, 0) + b"more"
    other.send_payload(spec.type_id, payload, 0, 1)
    request.receive(other.data_to_send(), HostNs(BEGAN_NS))
    assert request.confirmed_by == 1


def test_a_confirmation_of_the_last_stop_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(confirms, latency_ms=2_999)
    assert stop(line, monkeypatch) == [4]


def test_it_sleeps_until_the_next_one_is_due(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(lambda _: None)
    with pytest.raises(NoDeviceError):
        stop(line, monkeypatch)
    assert line.waits_s == pytest.approx([0.025] * 120, abs=1e-6)


def test_the_unsent_rest_of_a_stop_is_replaced_by_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line = Line(confirms, takes=5)
    monkeypatch.setattr(clock, "now", lambda: HostNs(line.now_ns))
    request = AddressedStop(Link, StopCause.SUPERVISE, 7, 4)
    sent: list[tuple[bytes, int]] = []
    end_ns = HostNs(BEGAN_NS + 1000 * MS)
    send_until_confirmed(line, request, end_ns, lambda data, at: sent.append((data, at)))
    assert request.confirmed_by is None
    assert b"".join(data for data, _ in sent) == line.written
    assert [len(data) for data, _ in sent] == [5] * 40
    times = [at - BEGAN_NS for _, at in sent]
    assert times == pytest.approx([25 * MS * i for i in range(40)], abs=60)
    assert line.received == []


def test_unsent_bytes_follow_within_the_turn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A received byte ends the wait, so the rest of a stop is sent before the next stop is due."""
    line = Line(acknowledges, takes=12)
    monkeypatch.setattr(clock, "now", lambda: HostNs(line.now_ns))
    noise = iter([b"\1", b"\2", b"\3"])
    silent = line.wait

    def wait(timeout_s: float) -> bytes:
        line.now_ns += MS
        return next(noise, b"") or silent(timeout_s)

    monkeypatch.setattr(line, "wait", wait)
    request = AddressedStop(Link, StopCause.OPERATOR, 7, 4)
    send_until_confirmed(line, request, HostNs(BEGAN_NS + 1000 * MS))
    assert request.confirmed_by == 4
    assert len(line.received) == 1
    assert line.heard_ms[0] < 10.0


def test_a_vanished_port_is_released_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(lambda _: None)
    line.gone_after = 400
    with pytest.raises(PortError, match="gone"):
        stop(line, monkeypatch)
    assert line.closed


def test_without_time_left_nothing_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(confirms)
    monkeypatch.setattr(clock, "now", lambda: HostNs(line.now_ns))
    send_until_confirmed(line, AddressedStop(Link, StopCause.OPERATOR, 1, 4), HostNs(BEGAN_NS))
    assert line.written == b""


def test_nothing_goes_out_before_the_next_stop_is_due() -> None:
    request = AddressedStop(Link, StopCause.OPERATOR, 0x1_FEDC, 4)
    first = request.data_to_send(HostNs(BEGAN_NS))
    assert request.next_deadline() == BEGAN_NS + REPEAT_NS
    assert request.data_to_send(HostNs(BEGAN_NS + REPEAT_NS - 1)) == b""
    assert request.data_to_send(HostNs(BEGAN_NS + REPEAT_NS)) != b""
    (event,) = Link(Direction.DEVICE).receive(first)
    assert isinstance(event, Received)
    assert event.message == Stop(0xFEDC, StopCause.OPERATOR), "the low 16 bits of the id"
    assert event.frame.t_us == BEGAN_NS // 1000
    device = Link(Direction.DEVICE)
    device.send(Ack(0xFEDC, STOP), 0, node=4)
    request.receive(device.data_to_send(), HostNs(BEGAN_NS))
    assert request.confirmed_by == 4


@pytest.mark.parametrize(
    "answer",
    [
        lambda _: None,
        lambda e: Ack(e.message.command_id ^ 1, STOP),
        lambda e: Ack(e.message.command_id, STOP + 1),
        lambda e: Nack(e.message.command_id, STOP, NackReason.BAD_VALUE),
        lambda _: LATCHED,
    ],
    ids=["silent", "another command", "another type", "refused", "a status"],
)
def test_an_addressed_stop_is_confirmed_by_its_id_alone(
    answer: Callable[[Received], Message | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    for received, confirmed in ((acknowledges, 4), (answer, None)):
        line = Line(received)
        monkeypatch.setattr(clock, "now", lambda at=line: HostNs(at.now_ns))
        request = AddressedStop(Link, StopCause.LINK, 7, 4)
        send_until_confirmed(line, request, HostNs(BEGAN_NS + 200 * MS))
        assert request.confirmed_by == confirmed
    assert {event.frame.node for event in line.received} == {4}
    elsewhere = Line(acknowledges, node=5)
    monkeypatch.setattr(clock, "now", lambda: HostNs(elsewhere.now_ns))
    request = AddressedStop(Link, StopCause.LINK, 7, 4)
    send_until_confirmed(elsewhere, request, HostNs(BEGAN_NS + 200 * MS))
    assert request.confirmed_by is None


def test_a_session_without_a_device_stops_every_device() -> None:
    assert isinstance(stop_request(Link, StopCause.SUPERVISE, 1, None), StopEverything)
    assert isinstance(stop_request(Link, StopCause.SUPERVISE, 1, 3), AddressedStop)
