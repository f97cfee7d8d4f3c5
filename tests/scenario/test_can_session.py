"""Sessions over a CAN bus in virtual time: one robot, several, a busy bus, a second host."""

from __future__ import annotations

import random
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from bridge.motion.robot_model import RobotModel
from bridge.run.host import Host
from bridge.run.mission import Mission
from bridge.run.options import HostOptions
from bridge.session.records import DeviceMessage, EventRecord, RawCan
from bridge.session.states import CommandEnded, Data, Failed, Ping, SessionReady, State
from protocol.can.link import CanLink, CanStatistics
from protocol.can.load import loads
from protocol.messages.device import Encoders, Imu, Range, Sync
from protocol.messages.host import Stop, StopAll, VelocitySetpoint
from protocol.messages.values import Mode, StopCause
from protocol.schema.message import Direction, Message
from support.can_bus import BITRATE, Bus, BusWire
from support.ends import Collector, Ends, HostEnd, SessionEnd, check_safe, session_end, sweeper

if TYPE_CHECKING:
    from protocol.can.frames import CanFrame
    from sim_device.sweeper import VirtualSweeper

pytestmark = pytest.mark.usefixtures("target")


class BusEnds(Ends):
    """A host and any number of devices on one bus."""

    def __init__(self, host: HostEnd | SessionEnd, *devices: VirtualSweeper) -> None:
        self.bus = Bus()
        self.others = devices[1:]
        first = devices[0]
        super().__init__(
            host,
            first,
            to_device=BusWire(self.bus, "host", "device 0"),
            to_host=BusWire(self.bus, "device 0", "host"),
        )
        for i, _ in enumerate(self.others, 1):
            self.bus.join(f"device {i}")
        self.watch = self.step_others

    def step_others(self) -> None:
        for i, device in enumerate(self.others, 1):
            name = f"device {i}"
            received = b"".join(p.data for p in self.bus.arrived(name, self.now_us))
            self.bus.request(name, device.step(received, self.device_us), self.now_us)


def statistics(end: SessionEnd) -> CanStatistics:
    found = end.session.link.statistics
    assert isinstance(found, CanStatistics)
    return found


def test_handshake_streams_and_a_drive() -> None:
    host = session_end(link=CanLink)
    ends = BusEnds(host, sweeper(link=CanLink))
    assert ends.run(3.0, lambda: host.session.state is State.READY)
    (negotiated,) = host.of(SessionReady)
    assert negotiated.differences == ()
    assert negotiated.node == 1
    host.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    ends.run(0.2)
    host.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.2)
    assert all(c.outcome.accepted for c in host.of(CommandEnded))

    def drive(now_ns: int) -> None:
        if now_ns // 20_000_000 != drive_at[0]:
            drive_at[0] = now_ns // 20_000_000
            host.session.setpoint(0.2, 0.0, 200, ends.host_ns)

    drive_at = [0]
    host.each_turn = drive
    start = ends.device.truth
    ends.run(2.0)
    assert ends.device.truth.pose.distance_m(start.pose) > 0.3
    host.session.stop(StopCause.OPERATOR, ends.host_ns)
    ends.run(1.0)
    assert ends.latched_us is not None
    assert not ends.moving
    check_safe(ends)
    found = statistics(host)
    assert (found.lost, found.damaged, found.rejected, found.stale) == (0, 0, 0, 0)
    assert (found.incomplete, found.given_up, found.duplicates, found.foreign) == (0, 0, 0, 0)
    assert len(host.of(Ping)) > 15
    assert not host.of(Failed)


def test_measured_load_at_default_rates_is_below_thirty_percent_and_as_computed() -> None:
    host = session_end(link=CanLink)
    ends = BusEnds(host, sweeper(link=CanLink))
    assert ends.run(3.0, lambda: host.session.state is State.READY)

    def drive(now_ns: int) -> None:
        if now_ns // 20_000_000 != drive_at[0]:
            drive_at[0] = now_ns // 20_000_000
            host.session.setpoint(0.01, 0.0, 200, ends.host_ns)

    drive_at = [0]
    host.each_turn = drive
    ends.run(6.0)  # after the first pings, which are more frequent
    bits, frames, began_us = ends.bus.bits, len(ends.bus.log), ends.now_us
    ends.run(10.0)
    seconds = (ends.now_us - began_us) / 1e6
    load = (ends.bus.bits - bits) / seconds / BITRATE
    unsent = {"wheel_duty", "planner_state", "log_text"}  # neither end sends them in this test
    quick = {"time_request", "time_reply"}  # four per second now, ten per second at first
    rows = loads()
    shares = [(row, 0.4 if row.name in quick else 1.0) for row in rows if row.name not in unsent]
    nominal = sum(row.bits_per_s * share for row, share in shares) / BITRATE
    worst = sum(row.worst_bits_per_s * share for row, share in shares) / BITRATE
    print(  # noqa: T201 - the figure itself, with pytest -rP
        f"CAN, {BITRATE} bit/s, {seconds:.1f} s: {(len(ends.bus.log) - frames) / seconds:.0f} "
        f"frames/s, load {load:.2%}; computed {nominal:.2%} unstuffed, {worst:.2%} at worst"
    )
    assert nominal <= load <= worst
    assert load < 0.30


@pytest.mark.parametrize(
    ("stop", "node", "can_id"),
    [(StopAll(), 0, 0x000), (Stop(1, StopCause.OPERATOR), 1, 0x011)],
    ids=["of all", "addressed"],
)
def test_stop_wins_arbitration_over_a_bus_that_is_full(
    stop: Message, node: int, can_id: int
) -> None:
    bus = Bus()
    for name in ("host", "chatter", "device"):
        bus.join(name)
    chatter, host = CanLink(Direction.DEVICE), CanLink(Direction.HOST)
    for i in range(200):
        chatter.send(Sync(i), i, node=0)
    bus.request("chatter", chatter.data_to_send(), 0)
    bus.run(10_000)
    host.send(VelocitySetpoint(1, 1, 100, 1), 10_000, node=1)
    host.send(stop, 10_000, node=node)
    bus.request("host", host.data_to_send(), 10_000)
    bus.run(12_000)
    at_us, _, frame = next(row for row in bus.log if row[1] == "host")
    assert frame.can_id == can_id
    longest_us = 135 * 1e6 / BITRATE
    assert at_us - 10_000 <= 2 * longest_us, "one frame that was under way, and its own"


@pytest.mark.python_only("counts within the firmware")
def test_several_robots_are_listed_and_one_is_chosen() -> None:
    devices = [sweeper(seed=n, node=n, link=CanLink) for n in (1, 2, 7)]
    host = session_end(link=CanLink)
    ends = BusEnds(host, *devices)
    assert ends.run(3.0, lambda: host.session.state is State.FAILED)
    (failed,) = host.of(Failed)
    assert failed.kind == "several"
    assert failed.kind == "several"
    for device in devices:
        identity = device.firmware.identity
        assert f"node {identity.node}: virtual sweeper" in failed.text
        assert identity.uid.hex() in failed.text

    chosen = session_end(link=CanLink, node=2)
    ends = BusEnds(chosen, *devices)
    assert ends.run(3.0, lambda: chosen.session.state is State.READY)
    ends.run(1.0)
    assert chosen.session.hello is not None
    assert chosen.session.hello.uid == devices[1].firmware.identity.uid
    assert {d.received.frame.node for d in chosen.of(Data)} == {2}
    assert statistics(chosen).lost == 0
    assert devices[0].firmware.link.statistics.rejected == 0, "neighbours are no errors"


def test_two_robots_with_one_node_are_reported() -> None:
    devices = [sweeper(seed=n, node=3, link=CanLink) for n in (1, 2)]
    host = session_end(link=CanLink)
    ends = BusEnds(host, *devices)
    assert ends.run(5.0, lambda: host.session.state is State.FAILED)
    (failed,) = host.of(Failed)
    assert failed.kind == "several"
    assert "two have the same node" in failed.text


def test_a_second_host_is_rejected_and_changes_nothing() -> None:
    first, device = session_end(link=CanLink), sweeper(link=CanLink)
    ends = BusEnds(first, device)
    assert ends.run(3.0, lambda: first.session.state is State.READY)
    second = session_end(link=CanLink)
    ends.bus.join("second")
    second.open(ends.host_ns)
    wrote = b""

    def both() -> None:
        nonlocal wrote
        pieces = [p.data for p in ends.bus.arrived("second", ends.now_us)]
        wrote += second.turn(pieces, ends.host_ns)

    ends.watch = both
    ends.run(1.0)
    (failed,) = second.of(Failed)
    assert failed.kind == "other_host"
    assert wrote == b"", "not a frame of it was sent"
    assert first.session.state is State.READY


@pytest.mark.python_only("counts the damage of one sequence of frames")
@pytest.mark.parametrize("seed", range(3))
def test_a_bus_that_loses_and_doubles_frames(seed: int) -> None:
    rng = random.Random(seed)
    host = session_end(link=CanLink)
    device = sweeper(link=CanLink)
    ends = BusEnds(host, device)

    def spoil(_frame: CanFrame) -> int:
        return rng.choices([0, 1, 2], [0.05, 0.9, 0.05])[0]

    ends.bus.spoil = spoil
    assert ends.run(8.0, lambda: host.session.state is State.READY)
    ends.run(5.0)
    assert host.session.state is State.READY
    found = statistics(host)
    assert found.lost > 50
    assert found.duplicates > 50
    assert found.incomplete > 20
    assert found.damaged == 0
    kinds = {type(d.received.message) for d in host.of(Data)}
    assert {Imu, Encoders, Range} <= kinds
    for data in host.of(Data):
        message = data.received.message
        if isinstance(message, Encoders):  # it stands still, with perfect encoders
            assert (message.left, message.right) == device.sensors.encoders()


def test_every_frame_is_on_record_and_stamps_are_the_devices() -> None:
    sink = Collector()
    host = Host(
        RobotModel(),
        sink,
        HostOptions(0, link=CanLink),
        Mission(None),
        lambda: 12345,
    )
    ends = BusEnds(HostEnd(host), sweeper(link=CanLink))
    ends.run(3.0)
    frames = sink.of(RawCan)
    received = [f for f in frames if not f.outgoing]
    printed = [f for f in frames if f.outgoing]
    on_bus = [(f.can_id, f.data) for _, who, f in ends.bus.log if who == "device 0"]
    assert [(f.can_id, f.data) for f in received] == on_bus[: len(received)]
    assert len(on_bus) - len(received) <= 5, "what came after the last turn"
    assert [(f.can_id, f.data) for f in printed][:1] == [
        (f.can_id, f.data) for _, who, f in ends.bus.log if who == "host"
    ][:1]
    imu = [m for m in sink.of(DeviceMessage) if isinstance(m.message, Imu)]
    steps = {b.t_us - a.t_us for a, b in pairwise(imu)}
    assert steps == {10_000}
    assert not [e for e in sink.of(EventRecord) if e.kind in {"rejected", "damaged"}]


def test_messages_of_a_rebooted_device_are_received() -> None:
    host = session_end(link=CanLink)
    ends = BusEnds(host, sweeper(link=CanLink))
    assert ends.run(3.0, lambda: host.session.state is State.READY)
    ends.run(4.0)
    ends.reboot_device(77)
    ends.run(0.5)
    assert ends.run(5.0, lambda: host.session.state is State.READY)
    ends.run(1.0)
    assert [a.rebooted for a in host.of(SessionReady)] == [False, True]
    late = [d for d in host.of(Data) if isinstance(d.received.message, Imu)][-1]
    assert late.received.frame.t_us < 8_000_000
