"""A recorded robot on a virtual port: the live host works with it as with a real robot."""

from __future__ import annotations

import random
import signal
from collections import deque
from typing import TYPE_CHECKING

import pytest
from mcap.writer import Writer

from bridge.record.reader import LogReader
from bridge.replay.device import load, replay_device
from bridge.session.session import Session
from bridge.session.states import Data, Ping, State
from bridge.session.timesync import TimeSync
from protocol.clock import HostNs
from protocol.link import Received
from protocol.messages.device import Ack, DescribeReply, Hello, ImuInfo, Nack, Status, TimeReply
from protocol.messages.host import Describe, HostHello, SetMode, Stop, StopAll, TimeRequest
from protocol.messages.values import NackReason
from protocol.schema.message import Direction
from protocol.uart.framing import DamagedFrame
from protocol.uart.link import Link
from support.cli import end, plain_messages, short_runs, start, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.replay.device import ReplayDevice
    from bridge.session.states import SessionEvent
    from protocol.link import LinkEvent
    from protocol.schema.message import Message

pytestmark = pytest.mark.slow

CONVERSATION = {"hello", "describe_reply", "ack", "nack", "time_reply", "parameter_value"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_runs(tmp_path_factory)[0].log


class Peer:
    """The host's end of the port, controlled by the test."""

    def __init__(self, device: ReplayDevice) -> None:
        self.device, self.link = device, Link(Direction.HOST)
        self.now_ns = HostNs(5_000_000_000)

    def send(self, message: Message, node: int = 1) -> list[LinkEvent]:
        self.link.send(message, self.now_ns // 1000, node=node)
        self.device.receive(self.link.data_to_send(), self.now_ns)
        return self.hear()

    def hear(self) -> list[LinkEvent]:
        self.device.poll(self.now_ns)
        return self.link.receive(self.device.data_to_send())

    def wait(self, duration_s: float) -> list[LinkEvent]:
        found, until = [], self.now_ns + round(duration_s * 1e9)
        while self.now_ns < until:
            self.now_ns = HostNs(min(until, max(self.now_ns + 1, self.device.next_deadline())))
            found += self.hear()
        return found


def messages(events: list[LinkEvent]) -> list[Message]:
    return [event.message for event in events if isinstance(event, Received)]


def test_it_sends_hello_and_waits_for_a_handshake(log: Path) -> None:
    peer = Peer(replay_device(LogReader(log)))
    before = messages(peer.wait(3.0))
    assert {type(message) for message in before} == {Hello}
    assert 3 <= len(before) <= 4
    (hello,) = messages(peer.send(HostHello(before[0].catalogue_hash, 77, 0, 0, "me")))  # type: ignore[attr-defined]  # a Hello
    assert isinstance(hello, Hello)
    assert hello.session_id == 77
    assert messages(peer.wait(0.5)) in ([], [hello])
    peer.send(HostHello(hello.catalogue_hash, 77, 0, 1, "me"))
    assert len(messages(peer.wait(1.0))) > 150


def test_it_answers_only_messages_addressed_to_it(log: Path) -> None:
    """Node 0 accepts only stop, hello and time; messages for another node are ignored."""
    peer = Peer(replay_device(LogReader(log)))
    asked = [HostHello(0, 5, 0, 0, "me"), TimeRequest(3), Stop(7, 4), SetMode(8, 1)]
    asked += [Describe(1, 1), StopAll()]
    answered: dict[int, set[type[Message]]] = {
        node: {type(m) for message in asked for m in messages(peer.send(message, node))} - {Hello}
        for node in (0, 1, 2)
    }
    assert answered == {
        0: {TimeReply, Status},
        1: {TimeReply, Status, Ack, Nack, DescribeReply},
        2: set(),
    }


def test_every_message_comes_again_as_it_was(log: Path) -> None:
    recording = load(LogReader(log))
    peer = Peer(replay_device(LogReader(log)))
    events = peer.send(HostHello(0, 5, 0, 1, "me")) + peer.wait(recording.duration_s)
    played = [e for e in events if isinstance(e, Received)]
    reported = [e for e in played if not isinstance(e.message, Hello | ImuInfo)]
    assert len(reported) == len(recording.played) > 2000
    for event, original in zip(reported, recording.played, strict=True):
        assert event.frame.payload == original.payload
        assert event.frame.t_us == original.t_us % (1 << 32)
        assert event.spec.type_id == original.type_id
    for name in ("imu", "encoders", "range", "status", "power"):
        count = sum(e.spec.name == name for e in reported)
        assert count == len(plain_messages(log, f"/device/{name}"))


def test_its_clock_is_never_behind_its_stamps(log: Path) -> None:
    peer = Peer(replay_device(LogReader(log)))
    peer.send(HostHello(0, 5, 0, 1, "me"))
    for ping in range(20):
        newest = max((e.frame.t_us for e in peer.wait(0.25) if isinstance(e, Received)), default=0)
        reply = next(
            e
            for e in peer.send(TimeRequest(ping))
            if isinstance(e, Received) and isinstance(e.message, TimeReply)
        )
        assert isinstance(reply.message, TimeReply)
        assert newest <= reply.message.received_us <= reply.frame.t_us
        assert reply.message.received_us - newest < 60_000


def test_it_stops_and_cannot_be_driven(log: Path) -> None:
    peer = Peer(replay_device(LogReader(log)))
    peer.send(HostHello(0, 5, 0, 1, "me"))
    (ack,) = [m for m in messages(peer.send(Stop(11, 1))) if isinstance(m, Ack)]
    assert ack.command_id == 11
    (nack,) = [m for m in messages(peer.send(SetMode(12, 1))) if isinstance(m, Nack)]
    assert (nack.command_id, nack.reason) == (12, NackReason.UNSUPPORTED)


def test_the_robot_is_at_rest_after_the_end(log: Path) -> None:
    device = replay_device(LogReader(log))
    peer = Peer(device)
    peer.send(HostHello(0, 5, 0, 1, "me"))
    peer.wait(device.recording.duration_s + 0.1)
    assert device.is_over
    after = messages(peer.wait(1.0))
    kinds = {type(message).__name__ for message in after}
    assert {"Status", "Encoders", "Imu"} <= kinds
    assert len({m for m in after if type(m).__name__ == "Encoders"}) == 1


def test_damaged_bytes_are_reproduced(tmp_path: Path) -> None:
    log = tmp_path / "bad.mcap"
    sweepctl(
        *("simulate", "empty", "--planner", "u-shape", "--max-time", "5", "--out", log, "--json"),
        *("--fault", "bit-flips@3:3:rate=0.001,way=up"),
    )
    recording = load(LogReader(log))
    damaged = sum(p.is_damaged for p in recording.played)
    assert damaged > 5
    peer = Peer(replay_device(LogReader(log)))
    events = peer.send(HostHello(0, 5, 0, 1, "me")) + peer.wait(recording.duration_s)
    assert sum(isinstance(e, DamagedFrame) for e in events) >= damaged * 0.9
    received = [e for e in events if isinstance(e, Received)]
    intact = [e for e in received if not isinstance(e.message, Hello | ImuInfo)]
    assert len(intact) == len(recording.played) - damaged, "no neighbour is hurt"


@pytest.mark.realtime
def test_the_live_bridge_runs_on_it(tmp_path: Path) -> None:
    log = tmp_path / "drive.mcap"
    sweepctl("simulate", "case-1", "--planner", "paper", "--max-time", "8", "--out", log, "--json")
    replay = start("replay", log, "--link", "pty", "--pty-link", "robot", cwd=tmp_path)
    try:
        assert replay.stdout is not None
        assert replay.stdout.readline() == "ready robot\n"
        host = end(
            start(
                "connect", "robot", "--duration", "3", "--out", "again.mcap", "--json", cwd=tmp_path
            )
        )
    finally:
        ended = end(replay, signal.SIGHUP)  # its terminal is closed
    assert ended.status == 0
    assert not (tmp_path / "robot").is_symlink(), "the link goes with it"
    assert host.status == 0, host.err
    assert host.json["outcome"] == "stopped"
    assert host.json["wire"]["crc_errors"] == 0

    def content(path: Path) -> list[tuple[int, ...]]:
        return [
            (m.decoded.t_us, m.decoded.gyro_z, m.decoded.accel_x)
            for m in LogReader(path).messages({"/device/imu"})
        ]

    recorded, again = content(log), content(tmp_path / "again.mcap")
    assert len(again) > 100
    begin = recorded.index(again[0])
    assert again == recorded[begin : begin + len(again)]


def test_files_that_cannot_be_replayed(tmp_path: Path, log: Path) -> None:
    for options in (
        ("--pty-link", "x"),
        ("--link", "pty", "--speed", "2"),
        ("--json",),
        ("--check", "--link", "pty"),
        ("--check", "--serve"),
        ("--check", "--to", "3"),
        ("--from", "5", "--to", "5"),
    ):
        assert sweepctl("replay", log, *options).status == 2
    checked = sweepctl("replay", log, "--check", "--json")
    assert checked.status == 0
    assert checked.json["same"] is True
    assert checked.json["equal"] == checked.json["recorded"] > 2000
    capture = tmp_path / "capture.bin"
    capture.write_bytes(b"".join(m.decoded.data for m in LogReader(log).messages({"/raw/uart/rx"})))
    alone = sweepctl("replay", capture, "--check")
    assert alone.status == 1
    assert f"cannot read {capture}: it is a capture" in alone.line
    text = tmp_path / "text"
    text.write_text("hello")
    assert sweepctl("replay", text, "--check").status == 1
    foreign = tmp_path / "foreign.mcap"
    with foreign.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_message(writer.register_channel("/json", "json", 0), 1, b"{}", 1)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    checked = sweepctl("replay", foreign, "--check")
    assert checked.status == 1
    assert "no messages of a robot" in checked.line


@pytest.mark.parametrize(("min_ms", "max_ms"), [(1.0, 5.0), (10.0, 10.0)])
def test_its_clock_does_not_jump_as_the_playing_begins(
    log: Path, min_ms: float, max_ms: float
) -> None:
    """The first hello is stamped before the time of a host's handshake is known."""
    rng = random.Random(1)
    device, session, sync = replay_device(LogReader(log)), Session(lambda: 99), TimeSync()
    up: deque[tuple[int, bytes]] = deque()
    down: deque[tuple[int, bytes]] = deque()
    last_ns = {"up": 0, "down": 0}

    def sent(way: str, queue: deque[tuple[int, bytes]], data: bytes, now_ns: int) -> None:
        if data:
            last_ns[way] = max(last_ns[way], now_ns + round(rng.uniform(min_ms, max_ms) * 1e6))
            queue.append((last_ns[way], data))

    opened_ns = 5_000_000_000
    for now in range(4_000_000_000, 8_000_000_000, 500_000):
        now_ns = HostNs(now)
        while up and up[0][0] <= now:
            device.receive(up.popleft()[1], now_ns)
        device.poll(now_ns)
        sent("down", down, device.data_to_send(), now)
        if now < opened_ns:  # without a reader, bytes wait in the terminal
            continue
        session.open(now_ns)
        events: list[SessionEvent] = []
        while down and down[0][0] <= now:
            events += session.receive(down.popleft()[1], now_ns)
        events += session.poll(now_ns)
        sent("up", up, session.data_to_send(), now)
        for event in events:
            if isinstance(event, Data):
                sync.observe(event[0].frame.t_us, now_ns)
            elif isinstance(event, Ping):
                received, replied = sync.extend(event.received_us), sync.extend(event.replied_us)
                sync.exchange(event.sent_ns, received, replied, event.arrived_ns)
    assert session.state is State.READY
    assert sync.steps == 0
    assert sync.samples > 25
    assert sync.fit is not None
    assert sync.fit.bound_ns > min_ms * 1e6 - 5_000, "nothing tells how a round trip divides"
