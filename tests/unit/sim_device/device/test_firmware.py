"""The emulated firmware, tested through its messages: streams, sessions, commands."""

from __future__ import annotations

from collections import Counter

import pytest

from protocol.messages.device import Ack, Hello, LogText, Nack, TimeReply
from protocol.messages.host import (
    ClearStop,
    Describe,
    HostHello,
    SetMode,
    Stop,
    StopAll,
    TimeRequest,
)
from protocol.messages.values import Mode, NackReason, ResetCause, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction, RateClass
from support.lone_device import SESSION, LoneDevice, kinds


def test_streams_come_at_their_default_rates() -> None:
    bench = LoneDevice()
    bench.join()
    bench.run(0.5, bench.ping)
    counted = Counter(kinds([m for m in bench.run(10.0, bench.ping) if not isinstance(m, LogText)]))
    expected = {
        spec.cls.__name__: round(10 * spec.default_hz)
        for spec in CATALOGUE
        if spec.direction is Direction.DEVICE and spec.rate is RateClass.STREAM
    }
    assert {name: counted[name] for name in expected} == expected
    assert expected["Imu"] == 1000
    assert expected["Encoders"] == 500
    assert expected["Range"] == 200
    assert expected["Status"] == 100


def test_streams_do_not_come_in_bursts() -> None:
    bench = LoneDevice()
    bench.join()
    bench.run(1.0, bench.ping)
    assert max(Counter(t for t, m in bench.received if t > 100_000).values()) <= 5


def test_hello_is_sent_each_second_until_the_handshake() -> None:
    bench = LoneDevice()
    assert kinds(bench.run(5.0)) == ["Hello"] * 5
    bench.send(HostHello(CATALOGUE.hash, SESSION, bench.boot_id, 0, "test"))
    hellos = bench.run(0.9)
    assert "Status" not in kinds(hellos)
    bench.join()
    assert "Hello" not in kinds(bench.run(2.0, bench.ping))


def test_hello_names_device_boot_and_session() -> None:
    bench = LoneDevice()
    hello = bench.send(HostHello(1, SESSION, bench.boot_id, 0, "test"))[0]
    assert isinstance(hello, Hello)
    assert hello.session_id == SESSION
    assert hello.boot_id == bench.firmware.identity.boot_id != 0
    assert hello.uid == bench.firmware.identity.uid
    assert hello.reset_cause == ResetCause.POWER_ON
    bench.device.reset(ResetCause.BROWN_OUT, boot_id=99)
    bench.run(0.5)
    again = bench.send(HostHello(1, SESSION, bench.boot_id, 0, "test"))[0]
    assert isinstance(again, Hello)
    assert (again.boot_id, again.reset_cause) == (99, ResetCause.BROWN_OUT)
    assert again.uid == hello.uid


def test_session_id_0_means_no_session() -> None:
    """A session with id 0 would never be lost, so the device must not open one."""
    bench = LoneDevice()
    bench.send(HostHello(CATALOGUE.hash, 0, bench.boot_id, 1, "test"))
    assert not bench.firmware.negotiated
    bench.join()
    bench.send(HostHello(CATALOGUE.hash, 0, bench.boot_id, 1, "test"))
    assert bench.firmware.session_id == SESSION


def test_a_host_may_have_any_name() -> None:
    bench = LoneDevice()
    bench.send(HostHello(CATALOGUE.hash, SESSION, bench.boot_id, 1, "🤖" * 57))
    logs = [m for m in bench.run(1.0, bench.ping) if isinstance(m, LogText)]
    assert logs
    assert all(m.line.startswith("session with 🤖") for m in logs[:1])


def test_frames_for_another_node_are_not_obeyed_nor_count_as_a_host() -> None:
    bench = LoneDevice()
    bench.free()
    bench.send(Stop(9, StopCause.OPERATOR), node=2)
    assert not bench.firmware.latch.latched
    bench.run(1.5, lambda: _ping_node(bench, 2))
    assert bench.cause() is StopCause.LINK
    bench.send(Stop(9, StopCause.OPERATOR), node=0)
    assert bench.cause() is StopCause.LINK, "a stop addresses a single device"
    assert bench.send(StopAll(), node=0) == []
    assert bench.cause() is StopCause.OPERATOR
    assert kinds(bench.run(0.01)) == ["Status"], "the device answers even without a session"


def _ping_node(bench: LoneDevice, node: int) -> None:
    bench.send(TimeRequest(1), node=node)


def test_commands_before_the_handshake_are_rejected() -> None:
    bench = LoneDevice()
    rejected = bench.send(ClearStop(1, StopCause.SESSION_END), SetMode(2, Mode.VELOCITY))
    assert [m.reason for m in rejected if isinstance(m, Nack)] == [NackReason.NO_SESSION] * 2
    bench.send(HostHello(CATALOGUE.hash, SESSION, bench.boot_id, 0, "test"))
    (again,) = bench.send(ClearStop(3, StopCause.SESSION_END))
    assert isinstance(again, Nack)


def test_an_unknown_mode_is_rejected() -> None:
    bench = LoneDevice()
    bench.free()
    (reply,) = bench.send(SetMode(7, 9))
    assert isinstance(reply, Nack)
    assert reply.reason == NackReason.BAD_VALUE
    assert bench.firmware.mode is Mode.VELOCITY


def test_a_repeated_command_is_answered_and_not_carried_out_again() -> None:
    bench = LoneDevice()
    bench.free()
    bench.send(Stop(5, StopCause.OPERATOR))
    # The retry of the clear that came before the stop must not undo the stop.
    (reply,) = bench.send(ClearStop(1, StopCause.SESSION_END))
    assert isinstance(reply, Ack)
    (reply,) = bench.send(SetMode(2, Mode.VELOCITY))
    assert isinstance(reply, Ack)
    assert bench.firmware.latch.cause is StopCause.OPERATOR
    assert bench.firmware.mode is Mode.IDLE


@pytest.mark.parametrize("raw", [0, 6, 255])
def test_a_stop_of_an_unknown_cause_is_the_operators(raw: int) -> None:
    bench = LoneDevice()
    bench.free()
    bench.send(Stop(5, raw))
    assert bench.firmware.latch.cause is StopCause.OPERATOR


def test_describe_answers_for_unknown_messages() -> None:
    bench = LoneDevice()
    assert kinds(bench.send(Describe(0x7D, 3), Describe(0x13, 255))) == ["DescribeReply"] * 2


def test_time_requests_are_stamped_twice() -> None:
    bench = LoneDevice()
    bench.join()
    bench.run(0.12)
    (reply,) = bench.send(TimeRequest(42))
    assert isinstance(reply, TimeReply)
    assert reply.ping == 42
    assert reply.received_us == bench.now_us


def test_a_host_without_a_session_gets_at_most_ten_hellos_a_second() -> None:
    bench = LoneDevice()
    bench.run(0.5)
    reported = [m for _ in range(50) for m in (*bench.send(TimeRequest(1)), *bench.run(0.01))]
    hellos = [m for m in reported if isinstance(m, Hello)]
    assert not [m for m in reported if isinstance(m, TimeReply)]
    assert 4 <= len(hellos) <= 6
    assert all(m.session_id == 0 for m in hellos)
