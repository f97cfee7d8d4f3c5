"""The session's transition table, and each way in which a session can fail."""

from __future__ import annotations

from zlib import crc32

import pytest
from cobs import cobs

from bridge.session.session import HANDSHAKE_TIMEOUT_NS, OPEN_TIMEOUT_NS, Session
from bridge.session.states import (
    TRANSITIONS,
    CommandEnded,
    Data,
    Failed,
    SessionReady,
    State,
    StateChanged,
)
from protocol.clock import HostNs
from protocol.messages.device import Hello
from protocol.messages.host import HostHello, Stop, TimeRequest, VelocitySetpoint
from protocol.messages.values import Mode, NackReason, StopCause
from protocol.uart.framing import encode_frame
from support.ends import Ends, SessionEnd, session_end, sweeper
from support.hostile import Pipe

pytestmark = pytest.mark.usefixtures("target")

EVENTS = sorted({event for _, event in TRANSITIONS})
SECOND = 1_000_000_000


def moved(state: State, event: str) -> State:
    session = Session(lambda: 1)
    session.state = state
    session.fire(event, "test")
    return session.state


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("event", EVENTS)
def test_only_moves_of_the_table_happen(state: State, event: str) -> None:
    assert moved(state, event) is TRANSITIONS.get((state, event), state)


def test_the_table_leaves_no_state_without_an_end() -> None:
    assert all((state, "close") in TRANSITIONS for state in State)
    reachable, found = {State.CLOSED}, 0
    while len(reachable) != found:
        found = len(reachable)
        reachable |= {new for (old, _), new in TRANSITIONS.items() if old in reachable}
    assert reachable == set(State)


def test_a_closed_session_receives_nothing_and_asks_for_nothing() -> None:
    session = Session(lambda: 1)
    device = sweeper()
    assert session.receive(device.step(b"", 2_000_000), HostNs(0)) == []
    assert session.poll(HostNs(10 * SECOND)) == []
    assert session.next_deadline() is None
    assert session.data_to_send() == b""


def alone(feed: bytes = b"", *, echo: bool = False) -> Failed:
    """Open a session on a port without a sweeper; return how it failed."""
    session = Session(lambda: 1)
    now = HostNs(5 * SECOND)
    session.open(now)
    failures: list[Failed] = []
    for _ in range(400):
        events = session.receive(feed, now) if feed else []
        events += session.poll(now)
        out = session.data_to_send()
        if echo:
            events += session.receive(out, now)
        failures += [e for e in events if isinstance(e, Failed)]
        now = HostNs(now + 10_000_000)
    assert session.state is State.FAILED
    assert len(failures) == 1, "a failure is reported once"
    return failures[0]


def test_silence() -> None:
    assert alone().kind == "silence"


def test_garbage_reports_the_number_of_bytes() -> None:
    failed = alone(bytes(range(200)))
    assert failed.kind == "garbage"
    assert "baud" in failed.text
    assert any(word.isdigit() for word in failed.text.split())


def test_bytes_that_never_end_a_frame_are_garbage_too() -> None:
    assert alone(b"\x55" * 7).kind == "garbage"


def test_an_echo_is_recognised() -> None:
    failed = alone(echo=True)
    assert failed.kind == "echo"
    assert "echo" in failed.text


def test_another_version_is_named() -> None:
    frame = bytearray(encode_frame(1, 0x1B, 0, 0, b"x" * 40))
    body = _decoded(frame)
    failed = alone(_recoded(bytes([1 << 4]) + body[1:]))
    assert failed.kind == "version"
    assert "version 1, this program uses 2" in failed.text


def _decoded(frame: bytearray) -> bytes:
    return bytes(cobs.decode(bytes(frame[:-1])))[:-4]


def _recoded(body: bytes) -> bytes:
    return bytes(cobs.encode(body + crc32(body).to_bytes(4, "little"))) + b"\0"


def test_a_device_that_sends_but_never_answers_is_lost() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ends.to_device.cut = True  # the host's TX wire is broken; the device sends hellos at 1 Hz
    assert ends.run(12.0, lambda: host.session.state is State.FAILED)
    assert [e.kind for e in host.of(Failed)] == ["transmit_only"]
    assert ends.now_us * 1000 < HANDSHAKE_TIMEOUT_NS + SECOND
    assert ends.now_us * 1000 > OPEN_TIMEOUT_NS


def ready(ends: Ends, host: SessionEnd) -> None:
    assert ends.run(3.0, lambda: host.session.state is State.READY), host.session.state


def test_a_session_opens_within_a_fifth_of_a_second() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    assert ends.now_us < 200_000
    (negotiated,) = host.of(SessionReady)
    assert not negotiated.rebooted
    assert negotiated.differences == ()


def test_another_device_on_the_port_is_not_accepted() -> None:
    host = session_end()
    ends = Ends(host, sweeper(seed=1))
    ready(ends, host)
    ends.to_host.cut = True
    assert ends.run(3.0, lambda: host.session.state is State.LOST)
    ends.device = sweeper(seed=2)
    ends.booted_us = ends.now_us
    ends.to_host.cut = False
    assert ends.run(5.0, lambda: host.session.state is State.FAILED)
    (failed,) = host.of(Failed)
    assert failed.kind == "other_device"
    assert ends.device.firmware.identity.uid.hex() in failed.text


def test_lost_and_back_is_a_new_session_with_the_same_boot() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    first = host.session.session_id
    ends.to_host.cut = ends.to_device.cut = True
    assert ends.run(3.0, lambda: host.session.state is State.LOST)
    ends.to_host.cut = ends.to_device.cut = False
    ready(ends, host)
    assert host.session.session_id != first
    assert [a.rebooted for a in host.of(SessionReady)] == [False, False]
    assert ends.device.firmware.session_id == host.session.session_id


@pytest.mark.parametrize("latency_us", [1_000, 40_000, 150_000])
def test_ready_means_that_the_device_is_in_our_session(latency_us: int) -> None:
    """Only the direction to the host was cut, so the device still streams in the old session."""
    host = session_end()
    ends = Ends(host, sweeper(), to_device=Pipe(latency_us), to_host=Pipe(latency_us))
    ready(ends, host)
    ends.to_host.cut = True
    assert ends.run(3.0, lambda: host.session.state is State.LOST)
    ends.to_host.cut = False
    ready(ends, host)
    assert ends.device.firmware.session_id == host.session.session_id
    before = len(host.of(StateChanged))
    ends.run(3.0)
    assert host.of(StateChanged)[before:] == [], "the session must stay ready"


def test_a_reboot_is_seen_and_reported() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    ends.run(0.5)
    ends.reboot_device(77)
    assert ends.run(2.0, lambda: host.session.state is not State.READY)
    ready(ends, host)
    assert [a.rebooted for a in host.of(SessionReady)] == [False, True]
    assert host.session.hello is not None
    assert host.session.hello.boot_id == 77


def test_a_reboot_during_the_handshake_restarts_it() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    assert ends.run(3.0, lambda: host.session.state is State.NEGOTIATING)
    ends.reboot_device(78)
    ready(ends, host)
    assert host.of(SessionReady)[-1].hello.boot_id == 78
    assert ends.device.firmware.session_id == host.session.session_id


def test_a_device_that_lost_the_session_repeats_the_handshake() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    ends.to_device.cut = True
    # The device receives nothing for a second, and then sends a hello again.
    assert ends.run(2.5, lambda: host.session.state is not State.READY)
    assert host.of(StateChanged)[-1].why == "the device ended the session"
    ends.to_device.cut = False
    ready(ends, host)
    assert ends.device.firmware.negotiated


def test_reopening_resets_the_previous_device() -> None:
    host = session_end()
    ends = Ends(host, sweeper(seed=1))
    ready(ends, host)
    host.session.close()
    assert host.session.state is State.CLOSED
    ends.device = sweeper(seed=2)
    ends.booted_us = ends.now_us
    host.session.open(ends.host_ns)
    ready(ends, host)
    assert host.of(Failed) == []


def test_only_messages_of_the_requested_node_are_returned() -> None:
    host = SessionEnd(Session(lambda: 1, node=3))
    ends = Ends(host, sweeper(node=2))
    assert ends.run(4.0, lambda: host.session.state is State.FAILED)
    assert host.of(Data) == []
    (failed,) = host.of(Failed)
    assert failed.kind == "other_node"
    assert failed.text.endswith("node 2")


def test_heartbeats_keep_the_link_for_as_long_as_the_host_lives() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    before = len(host.of(StateChanged))
    ends.run(20.0)
    assert host.of(StateChanged)[before:] == []
    pings = [s for s in ends.sent if isinstance(s.message, TimeRequest)]
    fast = [s for s in pings if s.at_us < 4_000_000]
    assert 30 <= len(fast) <= 45
    late = [s for s in pings if s.at_us > 10_000_000]
    assert 50 <= len(late) <= 56, "5 Hz, so that four pings take less than a second"


def test_pings_do_not_queue_up_on_a_port_that_takes_nothing() -> None:
    session = Session(lambda: 1)
    device = sweeper()
    now = HostNs(0)
    session.open(now)
    for ms in range(0, 300, 10):
        now = HostNs(ms * 1_000_000)
        session.poll(now)
        session.receive(device.step(session.data_to_send(), ms * 1000), now)
    assert session.state is State.READY
    for ms in range(300, 60_300, 10):
        now = HostNs(ms * 1_000_000)
        session.poll(now)
        # Frames from the device still arrive. The device's state of the session is irrelevant.
        session.receive(_status(ms), now)
    assert session.state is State.READY
    assert len(session.data_to_send()) < 60


def _status(ms: int) -> bytes:
    return encode_frame(1, 0x11, ms // 10 & 0xFF, ms * 1000, bytes(6))


# ---- commands ---------------------------------------------------------------------------


def ended(host: SessionEnd) -> list[tuple[str, bool, int | None]]:
    return [
        (type(e.outcome.message).__name__, e.outcome.accepted, e.outcome.reason)
        for e in host.of(CommandEnded)
    ]


def test_clear_and_mode_are_answered() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    host.session.set_mode(Mode.VELOCITY, ends.host_ns)
    host.session.clear_stop(StopCause.LINK, ends.host_ns)
    host.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    host.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.1)
    assert ended(host) == [
        ("SetMode", False, NackReason.STOP_LATCHED),
        ("ClearStop", False, NackReason.OTHER_CAUSE),
        ("ClearStop", True, None),
        ("SetMode", True, None),
    ]
    assert ends.device.firmware.mode is Mode.VELOCITY


def test_a_stop_whose_ack_is_lost_is_repeated_until_one_comes() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    ends.to_host.cut = True
    host.session.stop(StopCause.OPERATOR, ends.host_ns)
    ends.run(0.7)
    stops = [s for s in ends.sent if isinstance(s.message, Stop)]
    assert len(stops) >= 3
    assert len({s.message for s in stops}) == 1, "each repetition has the same command id"
    ends.to_host.cut = False
    ends.run(0.6)
    assert ended(host) == [("Stop", True, None)]
    count = len([s for s in ends.sent if isinstance(s.message, Stop)])
    ends.run(2.0)
    assert len([s for s in ends.sent if isinstance(s.message, Stop)]) == count


def test_a_lost_stop_is_sent_to_the_device_that_comes_back() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    host.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    ends.run(0.1)
    ends.to_device.cut = ends.to_host.cut = True
    host.session.stop(StopCause.OPERATOR, ends.host_ns)
    assert ends.run(3.0, lambda: host.session.state is State.LOST)
    ends.to_device.cut = ends.to_host.cut = False
    ready(ends, host)
    ends.run(0.2)
    assert ends.device.firmware.latch.cause is StopCause.OPERATOR
    assert ended(host)[-1] == ("Stop", True, None)


def test_a_stop_is_obeyed_without_a_session() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ends.run(0.0005)
    host.session.stop(StopCause.OPERATOR, ends.host_ns)
    assert ends.run(0.5, lambda: ends.device.firmware.latch.cause is StopCause.OPERATOR)


def test_commands_of_a_restarted_host_are_no_repeats() -> None:
    """A restarted host counts its command ids from 1 again, as the host before it did."""
    ends = Ends(first := session_end(), sweeper())
    ready(ends, first)
    first.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    first.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.1)
    assert ends.device.firmware.mode is Mode.VELOCITY
    second = session_end()
    ends.restart_host(second)
    ready(ends, second)
    assert ends.device.firmware.latch.cause is StopCause.LINK, (
        "the device stops before a new host joins"
    )
    second.session.clear_stop(StopCause.LINK, ends.host_ns)
    second.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.1)
    assert ended(second) == [("ClearStop", True, None), ("SetMode", True, None)]
    assert ends.device.firmware.mode is Mode.VELOCITY


def test_setpoints_beyond_the_wire_are_cut_to_it() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    host.session.setpoint(50.0, -50.0, 200, ends.host_ns)
    ends.run(0.05)
    (sent,) = [s.message for s in ends.sent if isinstance(s.message, VelocitySetpoint)]
    assert (sent.v, sent.yaw_rate) == (32767, -32767)


def test_hellos_carry_a_session_id_that_is_never_0() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    hellos = [s.message for s in ends.sent if isinstance(s.message, HostHello)]
    assert hellos
    assert all(hello.session_id for hello in hellos)


def test_the_hello_of_a_session_is_data_for_the_log() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    ready(ends, host)
    reported = [d.received.message for d in host.of(Data)]
    hellos = [m for m in reported if isinstance(m, Hello)]
    assert hellos[-1].session_id == host.session.session_id
    ends.run(1.0)
    later = [d.received.message for d in host.of(Data)][len(reported) :]
    assert not any(isinstance(m, Hello) for m in later), "no hello after the handshake"
    assert len(later) > 150
