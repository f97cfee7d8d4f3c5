"""The emulated firmware as a host sees it: streams, sessions, commands, silence."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import pytest

from protocol.catalogue import CATALOGUE
from protocol.link import Link, Received
from protocol.message import Direction, Message, RateClass
from protocol.messages import (
    Ack,
    ClearStop,
    Describe,
    Hello,
    HostHello,
    LinkCounters,
    LogText,
    Nack,
    SetMode,
    Status,
    Stop,
    TimeReply,
    TimeRequest,
    VelocitySetpoint,
)
from protocol.values import Fault, Mode, NackReason, ResetCause, StopCause
from support.ends import RAMP_US, REST_M_S, sweeper

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_device.device import VirtualSweeper
    from sim_device.virtual_firmware import Firmware

SESSION = 0xABCD


class Bench:
    """A device on the bench: frames in by hand, frames out decoded."""

    def __init__(self, device: VirtualSweeper | None = None) -> None:
        self.device = device or sweeper()
        self.link = Link(Direction.HOST)
        self.now_us = 0
        self.heard: list[tuple[int, Message]] = []
        self.counter = 0
        self._take(self.device.step(b"", 0))  # the hello of its boot

    @property
    def firmware(self) -> Firmware:
        return self.device.firmware

    def send(self, *messages: Message, node: int = 1, stamp_us: int | None = None) -> list[Message]:
        for message in messages:
            self.link.send(message, self.now_us if stamp_us is None else stamp_us, node=node)
        return self._take(self.device.step(self.link.data_to_send(), self.now_us))

    def run(self, duration_s: float, each: Callable[[], None] = lambda: None) -> list[Message]:
        found: list[Message] = []
        for _ in range(round(duration_s * 100)):
            self.now_us += 10_000
            found += self._take(self.device.step(b"", self.now_us))
            each()
        return found

    def _take(self, out: bytes) -> list[Message]:
        messages = [e.message for e in self.link.receive(out) if isinstance(e, Received)]
        self.heard += [(self.now_us, m) for m in messages]
        return messages

    def join(self, session: int = SESSION) -> None:
        self.send(HostHello(CATALOGUE.hash, session, 0, "test"))
        self.send(HostHello(CATALOGUE.hash, session, 1, "test"))

    def free(self) -> None:
        self.join()
        self.send(ClearStop(1, self.firmware.latch.cause), SetMode(2, Mode.VELOCITY))
        assert self.firmware.mode is Mode.VELOCITY

    def drive(self, ttl_ms: int = 200, stamp_us: int | None = None) -> None:
        self.counter += 1
        self.send(
            VelocitySetpoint(2000, 0, ttl_ms, self.counter & 0xFF),
            stamp_us=stamp_us,
        )

    def ping(self) -> None:
        self.send(TimeRequest(1))

    def cause(self) -> StopCause:
        return self.firmware.latch.cause

    @property
    def speed(self) -> float:
        return abs(self.device.truth.v_m_s)


def kinds(messages: list[Message]) -> list[str]:
    return [type(m).__name__ for m in messages]


def test_streams_come_at_their_default_rates() -> None:
    bench = Bench()
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
    bench = Bench()
    bench.join()
    bench.run(1.0, bench.ping)
    assert max(Counter(t for t, m in bench.heard if t > 100_000).values()) <= 5


def test_hello_is_said_each_second_until_agreed() -> None:
    bench = Bench()
    assert kinds(bench.run(5.0)) == ["Hello"] * 5
    bench.send(HostHello(CATALOGUE.hash, SESSION, 0, "test"))
    hellos = bench.run(0.9)
    assert "Status" not in kinds(hellos)
    bench.join()
    assert "Hello" not in kinds(bench.run(2.0, bench.ping))


def test_hello_names_device_boot_and_session() -> None:
    bench = Bench()
    (hello,) = bench.send(HostHello(1, SESSION, 0, "test"))
    assert isinstance(hello, Hello)
    assert hello.session_id == SESSION
    assert hello.boot_id == bench.firmware.identity.boot_id != 0
    assert hello.uid == bench.firmware.identity.uid
    assert hello.reset_cause == ResetCause.POWER_ON
    bench.device.reset(ResetCause.BROWN_OUT, boot_id=99)
    bench.run(0.5)
    again = bench.send(HostHello(1, SESSION, 0, "test"))[-1]
    assert isinstance(again, Hello)
    assert (again.boot_id, again.reset_cause) == (99, ResetCause.BROWN_OUT)
    assert again.uid == hello.uid


def test_a_session_of_id_0_is_none() -> None:
    """Nobody would ever be missed in it."""
    bench = Bench()
    bench.send(HostHello(CATALOGUE.hash, 0, 1, "test"))
    assert not bench.firmware.agreed
    bench.join()
    bench.send(HostHello(CATALOGUE.hash, 0, 1, "test"))
    assert bench.firmware.session_id == SESSION


def test_a_host_may_have_any_name() -> None:
    bench = Bench()
    bench.send(HostHello(CATALOGUE.hash, SESSION, 1, "🤖" * 57))
    logs = [m for m in bench.run(1.0, bench.ping) if isinstance(m, LogText)]
    assert logs
    assert all(m.line.startswith("session with 🤖") for m in logs[:1])


def test_frames_for_another_node_are_not_obeyed_nor_count_as_a_host() -> None:
    bench = Bench()
    bench.free()
    bench.send(Stop(9, StopCause.OPERATOR), node=2)
    assert not bench.firmware.latch.latched
    bench.run(1.5, lambda: _ping_node(bench, 2))
    assert bench.cause() is StopCause.LINK
    assert kinds(bench.send(Stop(9, StopCause.OPERATOR), node=0)) == ["Ack"]
    assert bench.cause() is StopCause.OPERATOR


def _ping_node(bench: Bench, node: int) -> None:
    bench.send(TimeRequest(1), node=node)


def test_commands_before_agreement_are_refused() -> None:
    bench = Bench()
    refused = bench.send(ClearStop(1, StopCause.SESSION_END), SetMode(2, Mode.VELOCITY))
    assert [m.reason for m in refused if isinstance(m, Nack)] == [NackReason.NO_SESSION] * 2
    bench.send(HostHello(CATALOGUE.hash, SESSION, 0, "test"))
    (again,) = bench.send(ClearStop(3, StopCause.SESSION_END))
    assert isinstance(again, Nack)


def test_an_unknown_mode_is_refused() -> None:
    bench = Bench()
    bench.free()
    (reply,) = bench.send(SetMode(7, 9))
    assert isinstance(reply, Nack)
    assert reply.reason == NackReason.BAD_VALUE
    assert bench.firmware.mode is Mode.VELOCITY


def test_a_repeated_command_is_answered_and_not_carried_out_again() -> None:
    bench = Bench()
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
    bench = Bench()
    bench.free()
    bench.send(Stop(5, raw))
    assert bench.firmware.latch.cause is StopCause.OPERATOR


def test_describe_answers_for_what_it_does_not_know() -> None:
    bench = Bench()
    assert kinds(bench.send(Describe(0x7D, 3), Describe(0x12, 255))) == ["DescribeReply"] * 2


def test_time_requests_are_stamped_twice() -> None:
    bench = Bench()
    bench.join()
    bench.run(0.12)
    (reply,) = bench.send(TimeRequest(42))
    assert isinstance(reply, TimeReply)
    assert reply.ping == 42
    assert reply.received_us == bench.now_us


def test_a_host_of_no_session_is_told_who_this_is_at_most_ten_times_a_second() -> None:
    bench = Bench()
    bench.run(0.5)
    told = [m for _ in range(50) for m in (*bench.send(TimeRequest(1)), *bench.run(0.01))]
    hellos = [m for m in told if isinstance(m, Hello)]
    assert not [m for m in told if isinstance(m, TimeReply)]
    assert 4 <= len(hellos) <= 6
    assert all(m.session_id == 0 for m in hellos)


# ---- the safety chain, at the device ----------------------------------------------------


def test_it_drives_on_fresh_setpoints_and_stops_when_they_end() -> None:
    bench = Bench()
    bench.free()
    bench.run(1.0, bench.drive)
    assert bench.speed == pytest.approx(0.2, abs=0.02)
    last = bench.now_us
    moving = [0]

    def look() -> None:
        bench.ping()  # heartbeats go on, and must not feed the setpoint
        if bench.speed > REST_M_S:
            moving[0] = bench.now_us

    bench.run(2.0, look)
    assert last < moving[0] <= last + 250_000 + RAMP_US
    assert not bench.firmware.latch.latched, "an expired setpoint does not latch"
    status = [m for _, m in bench.heard if isinstance(m, Status)][-1]
    assert status.faults & Fault.SETPOINT_EXPIRED
    bench.run(0.5, bench.drive)
    assert bench.speed > 0.15, "fresh ones of the same session go on"
    status = [m for _, m in bench.heard if isinstance(m, Status)][-1]
    assert not status.faults & Fault.SETPOINT_EXPIRED


def test_a_silent_host_latches_link() -> None:
    bench = Bench()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.run(0.98)
    assert not bench.firmware.latch.latched
    bench.run(0.05)
    assert bench.firmware.latch.cause is StopCause.LINK
    assert not bench.firmware.agreed
    assert bench.firmware.mode is Mode.IDLE
    assert kinds(bench.run(1.0)) == ["Hello"], "nobody is there: it says hello"


def test_an_orderly_end_stays_one() -> None:
    bench = Bench()
    bench.free()
    bench.send(Stop(9, StopCause.SESSION_END))
    bench.run(2.0)
    assert bench.firmware.latch.cause is StopCause.SESSION_END


def test_a_new_session_finds_it_latched() -> None:
    bench = Bench()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.send(HostHello(CATALOGUE.hash, SESSION + 1, 1, "another"))
    assert bench.firmware.latch.cause is StopCause.LINK
    assert bench.firmware.mode is Mode.IDLE
    bench.run(1.0, bench.drive)
    assert bench.speed < REST_M_S


def test_a_hello_of_the_same_session_changes_nothing() -> None:
    bench = Bench()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.join()
    assert not bench.firmware.latch.latched
    assert bench.firmware.mode is Mode.VELOCITY


def test_setpoints_while_latched_or_idle_are_nothing() -> None:
    bench = Bench()
    bench.join()
    bench.run(0.5, bench.drive)
    bench.send(ClearStop(1, StopCause.SESSION_END))
    bench.run(0.5, bench.drive)  # free, but idle
    bench.send(SetMode(2, Mode.VELOCITY))
    bench.run(0.5, bench.ping)  # in velocity mode, but none since
    assert bench.speed < REST_M_S
    assert bench.device.truth.path_m < 0.001


def test_the_latch_alone_holds_the_wheels() -> None:
    """Whatever else a fault handler forgets to do."""
    bench = Bench()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.firmware.latch.latch(StopCause.HARDWARE)
    bench.run(RAMP_US / 1e6, bench.drive)
    assert bench.firmware.mode is Mode.VELOCITY
    assert bench.speed < REST_M_S
    path = bench.device.truth.path_m
    bench.run(0.5, bench.drive)
    assert bench.device.truth.path_m == pytest.approx(path, abs=1e-4)


def test_a_3_s_stall_and_its_burst_move_nothing() -> None:
    bench = Bench()
    bench.free()
    bench.run(1.0, bench.drive)
    stalled: list[tuple[int, int]] = []
    for _ in range(300):
        bench.now_us += 10_000
        bench.device.step(b"", bench.now_us)
        bench.counter += 1
        stalled.append((bench.now_us, bench.counter))
    start = bench.device.truth.path_m
    assert bench.speed < REST_M_S
    for stamp_us, counter in stalled:
        bench.send(VelocitySetpoint(3000, 0, 250, counter & 0xFF), stamp_us=stamp_us)
    bench.run(1.0)
    assert bench.device.truth.path_m == pytest.approx(start, abs=1e-4)
    assert bench.firmware.latch.cause is StopCause.LINK


def test_a_shorter_stall_is_refused_by_age_alone() -> None:
    """For 0.9 s the session goes on and the mode is velocity: only freshness is in the way."""
    bench = Bench()
    bench.free()
    bench.run(1.0, bench.drive)
    first = bench.now_us
    bench.run(0.9)
    path = bench.device.truth.path_m
    for k in range(30):  # of the first 0.6 s
        bench.counter += 1
        bench.send(
            VelocitySetpoint(3000, 0, 250, bench.counter & 0xFF), stamp_us=first + k * 20_000
        )
    bench.run(0.9)
    assert bench.device.truth.path_m == pytest.approx(path, abs=1e-4)
    counters = [m for _, m in bench.heard if isinstance(m, LinkCounters)][-1]
    assert counters.stale == 30
    assert not bench.firmware.latch.latched or bench.firmware.latch.cause is StopCause.LINK


def test_clocks_that_wrap_stop_nothing() -> None:
    """Both 32-bit microsecond clocks wrap after 71.6 minutes; here both within a second."""
    device = sweeper()
    device._next_tick_us = (1 << 32) - 1_500_000  # noqa: SLF001 - it has been on for 71 minutes
    bench = Bench(device)
    bench.now_us = (1 << 32) - 1_500_000
    bench.free()
    bench.run(3.0, bench.drive)  # the host's stamps are the bench's, and wrap with it
    assert bench.speed == pytest.approx(0.2, abs=0.02)
    assert not bench.firmware.latch.latched
    counters = [m for _, m in bench.heard if isinstance(m, LinkCounters)][-1]
    assert counters.stale == 0


def test_a_reboot_forgets_session_and_latches() -> None:
    bench = Bench()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.device.reset(ResetCause.SOFTWARE)
    firmware = bench.device.firmware
    assert firmware.latch.cause is StopCause.SESSION_END
    bench.run(1.0, bench.drive)
    assert not firmware.agreed
    assert bench.speed < REST_M_S
