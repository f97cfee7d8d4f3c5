"""One side of a link: received messages, rejections, statistics and the send queue."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from protocol.clock import DeviceUs, elapsed_us, extend_us
from protocol.errors import FieldRangeError, LocalError, ProtocolError, RemoteError
from protocol.link import LinkEvent, Received, Rejected, WrongDirectionError
from protocol.messages.device import Encoders, Hello, Imu, LogText, Power, Sync
from protocol.messages.host import HostHello, SetMode, Stop, VelocitySetpoint
from protocol.messages.values import Fault, Mode, flag_labels, label
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.codec import Codec
from protocol.schema.message import Direction
from protocol.uart.framing import Damage, DamagedFrame, FrameSizeError
from protocol.uart.link import Link
from support import reference_codec as ref

if TYPE_CHECKING:
    from protocol.schema.message import Message


def host() -> Link:
    return Link(Direction.HOST)


def device() -> Link:
    return Link(Direction.DEVICE)


def messages(events: list[LinkEvent]) -> list[Message]:
    assert all(isinstance(e, Received) for e in events), events
    return [e.message for e in events if isinstance(e, Received)]


def frames(link: Link, *sent: Message, node: int = 1) -> list[bytes]:
    """Return the bytes of each message, sent one by one."""
    out: list[bytes] = []
    for message in sent:
        assert link.send(message, 0, node=node)
        out.append(link.data_to_send())
    return out


def sequence(data: bytes) -> list[int]:
    return [f.seq for f in ref.parse_stream(data) if isinstance(f, ref.RefFrame)]


# ---- sending ------------------------------------------------------------------------------


def test_each_end_receives_the_others_messages() -> None:
    ours, theirs = host(), device()
    ours.send(Stop(5, 4), 77, node=0, flags=2)
    assert ours.has_data
    data = ours.data_to_send()
    assert ours.data_to_send() == b""
    (event,) = theirs.receive(data)
    assert isinstance(event, Received)
    assert event.message == Stop(5, 4)
    assert event.spec is CATALOGUE.spec(Stop)
    assert (event.frame.node, event.frame.t_us, event.frame.flags) == (0, 77, 2)
    assert (ours.statistics.frames_out, theirs.statistics.frames_in) == (1, 1)
    assert ours.statistics.bytes_out == theirs.statistics.bytes_in == len(data)


def test_the_first_of_a_queue_gets_the_leading_zero_and_only_it() -> None:
    link = device()
    for count in (3, 2):
        for value in range(count):
            link.send(Sync(0x01010101 + value), 0x01010101, node=1)
        data = link.data_to_send()
        assert data[0] == 0
        assert data.count(0) == 1 + count
        assert b"\0\0" not in data


def test_latest_replaces_a_waiting_message_and_keeps_the_rest() -> None:
    link, peer = host(), device()
    link.send(VelocitySetpoint(1, 0, 200, 0), 0, node=1, latest=True)
    link.send(SetMode(1, 1), 0, node=1)
    link.send(VelocitySetpoint(2, 0, 200, 1), 0, node=1, latest=True)
    link.send(VelocitySetpoint(3, 0, 200, 2), 0, node=1, latest=True)
    data = link.data_to_send()
    assert data[0] == 0  # even if the first frame was replaced
    assert messages(peer.receive(data)) == [SetMode(1, 1), VelocitySetpoint(3, 0, 200, 2)]
    assert (link.statistics.superseded, link.statistics.frames_out) == (2, 2)


def test_a_replaced_message_leaves_no_gap_in_the_sequence() -> None:
    link, peer = host(), device()
    for counter in range(10):
        link.send(VelocitySetpoint(1, 0, 200, counter), 0, node=1, latest=True)
        link.send(VelocitySetpoint(2, 0, 200, counter), 0, node=1, latest=True)
        peer.receive(link.data_to_send())
    assert (peer.statistics.frames_in, peer.statistics.lost) == (10, 0)


def test_latest_leaves_another_node_s_message_alone() -> None:
    link, peer = host(), device()
    link.send(VelocitySetpoint(1, 0, 200, 0), 0, node=1, latest=True)
    link.send(VelocitySetpoint(2, 0, 200, 0), 0, node=2, latest=True)
    assert len(peer.receive(link.data_to_send())) == 2


def test_latest_after_the_queue_was_fetched_replaces_nothing() -> None:
    link = host()
    link.send(VelocitySetpoint(1, 0, 200, 0), 0, node=1, latest=True)
    link.data_to_send()
    link.send(VelocitySetpoint(2, 0, 200, 1), 0, node=1, latest=True)
    assert link.statistics.superseded == 0


def test_sequence_counts_all_frames_and_wraps() -> None:
    link = device()
    data = b"".join(frames(link, *(Sync(i) for i in range(300))))
    assert sequence(data) == [i % 256 for i in range(300)]


def test_the_other_side_s_message_is_rejected() -> None:
    with pytest.raises(WrongDirectionError, match="Imu is not sent in this direction") as raised:
        host().send(Imu(0, 0, 0, 0, 0, 0, 0), 0, node=1)
    assert raised.value.message == "Imu"
    with pytest.raises(WrongDirectionError):
        device().send(Stop(1, 1), 0, node=1)


@pytest.mark.parametrize(
    ("message", "options", "error"),
    [
        (Sync(-1), {"node": 1}, FieldRangeError),
        (Sync(1), {"node": 16}, FieldRangeError),
        (Sync(1), {"node": 1, "flags": 16}, FieldRangeError),
        (LogText(1, "é" * 121), {"node": 1}, FrameSizeError),
        (Hello(0, b"short", 0, 0, 0, 0, 0, 0, 0, ""), {"node": 1}, FieldRangeError),
    ],
)
def test_an_invalid_message_is_rejected_at_once_without_a_trace(
    message: Message, options: dict[str, int], error: type[LocalError]
) -> None:
    link = device()
    with pytest.raises(error):
        link.send(message, 0, **options)  # type: ignore[arg-type]  # without latest
    assert not link.has_data
    assert link.statistics.frames_out == 0
    assert sequence(frames(link, Sync(1))[0]) == [0]


def test_errors_are_distinguished_by_blame() -> None:
    assert issubclass(FieldRangeError, LocalError)
    assert issubclass(FrameSizeError, LocalError)
    assert issubclass(LocalError, ProtocolError)
    assert not issubclass(LocalError, RemoteError)


# ---- receiving ----------------------------------------------------------------------------


def test_a_disabled_type_is_neither_sent_nor_decoded() -> None:
    ours, theirs = host(), device()
    (data,) = frames(theirs, Power(16000, 200, 0, 0))
    ours.disabled.add(CATALOGUE.spec(Power).type_id)
    (event,) = ours.receive(data)
    assert isinstance(event, Rejected)
    assert event.reason == "disabled"
    assert (ours.statistics.frames_in, ours.statistics.rejected) == (1, 1)
    theirs.disabled.add(CATALOGUE.spec(Power).type_id)
    assert theirs.send(Power(1, 2, 3, 4), 0, node=1) is False
    assert not theirs.has_data


def test_an_echo_is_rejected_and_does_not_change_the_sequence() -> None:
    ours, theirs = host(), device()
    echo = frames(ours, *(SetMode(i, 1) for i in range(40)))
    telemetry = frames(theirs, Encoders(1, 2), Encoders(3, 4))
    (event,) = ours.receive(telemetry[0])
    assert isinstance(event, Received)
    for data in echo:
        (event,) = ours.receive(data)
        assert isinstance(event, Rejected)
        assert event.reason == "direction"
    ours.receive(telemetry[1])
    assert (ours.statistics.lost, ours.statistics.frames_in) == (0, 2)


def test_another_version_is_rejected_for_any_type() -> None:
    ours = host()
    data = ref.frame_bytes(
        version=3, flags=1, node=1, type_id=0x10, seq=9, t_us=0, payload=bytes(4)
    )
    (event,) = ours.receive(data)
    assert isinstance(event, Rejected)
    assert (event.reason, event.frame.version, event.frame.flags) == ("version", 3, 1)
    assert (ours.statistics.frames_in, ours.statistics.rejected) == (0, 1)


def test_a_payload_of_a_wrong_length_is_rejected() -> None:
    data = ref.frame_bytes(flags=0, node=1, type_id=0x10, seq=9, t_us=0, payload=bytes(3))
    (event,) = host().receive(data)
    assert isinstance(event, Rejected)
    assert event.reason == "payload"


def test_shared_fields_reach_the_message() -> None:
    ours = Link(Direction.HOST, codec=Codec())
    ours.codec.limit(0x24, 2)
    data = ref.frame_bytes(flags=0, node=1, type_id=0x24, seq=9, t_us=0, payload=b"\x80\x3e\xc8")
    (message,) = messages(ours.receive(data))
    assert tuple(message) == (16000, 200, None, None)


def test_damage_is_counted_and_passed_on() -> None:
    ours, theirs = host(), device()
    (data,) = frames(theirs, Encoders(0x0101, 0x0101))
    spoilt = data[:-2] + bytes([data[-2] ^ 4]) + b"\0"
    (event,) = ours.receive(spoilt)
    assert isinstance(event, DamagedFrame)
    assert event.damage is Damage.CRC
    assert (ours.statistics.damaged, ours.statistics.frames_in) == (1, 0)


@pytest.mark.parametrize(
    ("order", "lost", "reordered"),
    [
        ([0, 1, 2, 3], 0, 0),
        ([7, 8, 9], 0, 0),  # reception may begin at any number without a loss
        ([0, 3, 4], 2, 0),
        ([0, 1, 1, 2], 0, 1),
        ([0, 2, 1, 3], 1, 1),
        ([254, 255, 0, 1], 0, 0),
        ([250, 3], 8, 0),
        ([10, 9, 8, 11], 0, 2),
    ],
)
def test_losses_and_reordering_by_sequence(order: list[int], lost: int, reordered: int) -> None:
    sent = frames(device(), *(Sync(i) for i in range(256)))
    ours = host()
    for index in order:
        ours.receive(sent[index])
    assert (ours.statistics.lost, ours.statistics.reordered) == (lost, reordered)
    assert ours.statistics.frames_in == len(order)
    assert ours.statistics.by_type == {0x10: len(order)}


def test_unknown_and_disabled_types_keep_their_place_in_the_sequence() -> None:
    ours = host()
    ours.disabled.add(0x24)
    for seq, type_id in enumerate([0x10, 0x77, 0x24, 0x10]):
        ours.receive(
            ref.frame_bytes(flags=0, node=1, type_id=type_id, seq=seq, t_us=0, payload=bytes(4))
        )
    assert (ours.statistics.lost, ours.statistics.frames_in) == (0, 4)


def test_each_device_has_its_own_sequence() -> None:
    one, two, ours = device(), device(), host()
    for i in range(50):
        ours.receive(frames(one, Sync(i), node=1)[0])
        if i % 3 == 0:
            ours.receive(frames(two, Sync(i), node=2)[0])
    assert ours.statistics.lost == 0


def test_a_host_has_one_sequence_for_all_nodes() -> None:
    ours, theirs = host(), device()
    for i in range(50):
        theirs.receive(frames(ours, SetMode(i, 1), node=1)[0])
        if i % 10 == 0:
            theirs.receive(frames(ours, HostHello(0, 1, 0, 1, ""), node=0)[0])
    assert (theirs.statistics.lost, theirs.statistics.reordered) == (0, 0)


def test_after_a_new_boot_any_sequence_number_may_come() -> None:
    ours = host()
    ours.receive(frames(device(), *(Sync(i) for i in range(41)))[-1])
    ours.forget_sequence()
    ours.receive(frames(device(), Sync(0))[0])
    assert (ours.statistics.lost, ours.statistics.reordered) == (0, 0)


def hello(boot_id: int) -> Hello:
    return Hello(0, bytes(12), boot_id, 0, 0, 0, 0, 1, 0, "device")


@pytest.mark.parametrize("before", [0, 1, 100, 127, 128, 200, 254, 255, 256])
def test_a_new_boot_that_a_hello_names_is_no_loss(before: int) -> None:
    ours = host()
    for frame in frames(device(), hello(1), *(Sync(i) for i in range(before))):
        ours.receive(frame)
    for frame in frames(device(), hello(2), *(Sync(i) for i in range(5))):
        ours.receive(frame)
    assert (ours.statistics.lost, ours.statistics.reordered) == (0, 0)


def test_frames_lost_before_a_hello_of_the_same_boot_are_counted() -> None:
    sent = frames(device(), hello(1), Sync(0), Sync(1), hello(1), Sync(2))
    ours = host()
    for frame in (sent[0], sent[3], sent[4]):
        ours.receive(frame)
    assert (ours.statistics.lost, ours.statistics.reordered) == (2, 0)


# ---- clock and labels ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reference", "low32", "expected"),
    [
        (0, 5, 5),
        (100, 90, 90),
        (0xFFFFFFF0, 0x10, 0x1_0000_0010),  # with a wrap in between
        (0x1_0000_0010, 0xFFFFFFF0, 0xFFFFFFF0),  # a stamp from before the wrap
        (5 << 32, 0xFFFFFFFF, (5 << 32) - 1),
        ((5 << 32) + 7, 7, (5 << 32) + 7),
        (0x7FFFFFFF, 0xFFFFFFFE, 0xFFFFFFFE),  # just below half of the 32-bit range ahead
        (0x80000000, 5, 5),  # just below half of the 32-bit range back
    ],
)
def test_extend_us_gives_the_nearest_moment(reference: int, low32: int, expected: int) -> None:
    assert extend_us(DeviceUs(reference), low32) == expected


def test_extend_us_follows_a_clock_through_wraps() -> None:
    moment = DeviceUs(0)
    for step in range(20):
        true = step * 1_500_000_000
        moment = extend_us(moment, true & 0xFFFFFFFF)
        assert moment == true


def test_labels_never_raise() -> None:
    assert label(Mode, 1) == "velocity"
    assert label(Mode, 200) == "unknown(200)"
    assert flag_labels(Fault, 0) == []
    assert flag_labels(Fault, Fault.IMU | Fault.LIFTED | 1 << 16) == ["imu", "lifted", "bit16"]


@pytest.mark.parametrize(
    ("since", "until", "expected"),
    [
        (0, 5, 5),
        (5, 0, -5),
        (0xFFFF_FFFF, 1, 2),
        (1, 0xFFFF_FFFF, -2),
        ((7 << 32) + 3, 5, 2),
        (0, 0x7FFF_FFFF, 0x7FFF_FFFF),
        (0, 0x8000_0000, -0x8000_0000),
    ],
)
def test_elapsed_us_is_the_nearest_difference_of_two_stamps(
    since: int, until: int, expected: int
) -> None:
    assert elapsed_us(since, until) == expected
