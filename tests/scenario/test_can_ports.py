"""Real CAN back ends of python-can: in one process, a serial adapter, UDP multicast."""

from __future__ import annotations

import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING

import can
import pytest
from can.interfaces.udp_multicast.utils import pack_message, unpack_message
from can.interfaces.virtual import VirtualBus

import bridge
from bridge.errors import PortBusyError, PortError, SeveralDevicesError
from bridge.io.can_port import CanPort
from bridge.io.multicast import MulticastBus
from bridge.io.ports import open_port
from bridge.record.reader import LogReader
from protocol.can.frames import RECORD, CanFrame
from protocol.can.link import CanLink
from sim_device.ports import MulticastPort, SlcanPort
from support.can_bus import frame_bits
from support.ends import sweeper
from support.two_processes import PATIENCE_S, Command, Emulator, connect
from support.waiting import until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from support.processes import Done

pytestmark = pytest.mark.realtime

DRIVES_S = 1.5
"""Duration of a drive, s: more than a path of 0.2 m needs."""
FRAME = RECORD.pack(0x121, 3, b"abc")
DGRAM = socket.SOCK_DGRAM


@contextmanager
def device_on(port: str, node: int = 1) -> Iterator[None]:
    """Run a virtual sweeper in a thread, in real time, on its own connection to a bus."""
    device, end = sweeper(node=node, link=CanLink), threading.Event()
    bus = CanPort(port)

    def live() -> None:
        began_ns = time.monotonic_ns()
        while not end.is_set():
            now_us = (time.monotonic_ns() - began_ns) // 1000
            data = bus.wait(max(0.0, (device.next_deadline_us() - now_us) / 1e6))
            out = device.step(data, (time.monotonic_ns() - began_ns) // 1000)
            if out:
                bus.write(out)

    thread = threading.Thread(target=live, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join(5.0)
        bus.close()


def drive_a_little(port: str) -> None:
    """Use the public API: complete the handshake, receive every sensor's data, drive, stop."""
    with bridge.open(port) as robot:
        until(lambda: robot.imu.latest is not None)
        until(lambda: robot.range.latest is not None)
        robot.enable()
        start = robot.pose
        for _ in range(20):
            robot.drive(0.2, 0.0)
            time.sleep(0.05)
        assert robot.pose.distance_m(start) > 0.05


def test_the_virtual_bus_of_one_process_with_two_robots_and_a_listener() -> None:
    tap = can.Bus(interface="virtual", channel="sweepers", ignore_config=True)
    with device_on("can:virtual:sweepers"), device_on("can:virtual:sweepers", node=2):
        with pytest.raises(SeveralDevicesError, match=r"several devices answer.*node 1.*node 2"):
            bridge.open("can:virtual:sweepers")
        with bridge.open("can:virtual:sweepers", node=2) as robot:
            until(lambda: robot.imu.latest is not None)
            time.sleep(1.0)
    bits = count = 0
    while (message := tap.recv(0.0)) is not None:
        bits += frame_bits(CanFrame(message.arbitration_id, bytes(message.data)))
        count += 1
    tap.shutdown()
    assert count > 300
    assert bits / count < 135


def test_a_drive_over_the_virtual_bus() -> None:
    with device_on("can:virtual:drive"):
        drive_a_little("can:virtual:drive")


def test_a_port_reads_writes_wakes_and_reports_bad_names() -> None:
    with CanPort("can:virtual:pair") as one, CanPort("can:virtual:pair") as two:
        assert one.write(FRAME * 3 + FRAME[:5]) == 3 * RECORD.size
        assert two.wait(1.0) == FRAME * 3
        threading.Timer(0.05, two.wake).start()
        assert two.wait(30.0) == b""
    for name in ("can:", "can:virtual", "can:virtual:", "can:nosuch:x"):
        with pytest.raises(PortError, match="can:"):
            open_port(name)
    with pytest.raises(PortError, match="Invalid bitrate"), SlcanPort() as adapter:
        open_port(adapter.path, bitrate=123_456)
    with pytest.raises(PortError, match="does not exist"):
        open_port("can:slcan:/dev/no-such-adapter")


def test_an_adapter_has_one_owner_and_garbled_lines_are_no_frames() -> None:
    with SlcanPort() as adapter, CanPort(adapter.path) as port:
        with pytest.raises(PortBusyError, match=f"process {os.getpid()}"):
            CanPort(adapter.path)
        assert adapter.read() == b""
        os.write(adapter.filenos()[0], b"t12x1\rt1\r\xff\xfe\rt1219\r")
        time.sleep(0.05)
        assert port.wait(0.2) == b""
        assert port.garbled >= 2
        port.write(FRAME)
        assert adapter.read() == FRAME
        adapter.write(FRAME)
        found = b""
        for _ in range(5):
            found = found or port.wait(0.2)
        assert found == FRAME


def stopped_after_a_while(host: Command) -> Done:
    """Press Ctrl-C after a short drive."""
    time.sleep(DRIVES_S)
    host.send(signal.SIGINT)
    return host.end()


def test_a_plan_over_a_serial_can_adapter(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with Emulator(tmp_path, "--link", "slcan") as device:
        assert re.fullmatch(r"can:slcan:/dev/pts/\d+", device.port)
        arguments = ("--plan", "paper", "--json", "--out", log)
        with Command("connect", device.port, *arguments, cwd=tmp_path) as host:
            host.prints("run is driving")
            busy = connect(tmp_path, device.port, "--duration", "1", "--json", "--out", "busy.mcap")
            assert busy.status == 3
            assert f"process {host.process.pid}" in busy.complaint
            ended = stopped_after_a_while(host)
        assert device.stop().status == 0
    assert ended.status == 0, ended.err
    summary = ended.json
    assert summary["path_m"] > 0.2
    assert summary["wire"]["lost"] == 0
    assert summary["wire"]["crc_errors"] == 0
    counted: dict[str, int] = {}
    for message in LogReader(log).messages():
        counted[message.topic] = counted.get(message.topic, 0) + 1
    assert counted["/raw/can"] > 1000
    assert "/raw/uart/rx" not in counted
    assert counted["/device/imu"] > 300


def test_robots_and_a_host_in_processes_of_their_own_over_udp(tmp_path: Path) -> None:
    with (
        Emulator(tmp_path, "--link", "udpcan", "--node", "1") as one,
        Emulator(tmp_path, "--link", "udpcan", "--node", "2", "--seed", "5") as two,
    ):
        assert one.port == two.port == "can:udp_multicast:239.74.163.2"
        several = connect(tmp_path, one.port, "--json", "--out", "several.mcap")
        assert several.status == 2
        assert "several devices answer" in several.complaint
        assert several.complaint.endswith("; choose one with --node N")
        assert re.search(r"node 1: .*node 2: ", several.complaint)
        assert several.err.count("several devices answer") == 1
        assert not (tmp_path / "several.mcap").exists()
        with Command("bringup", one.port, cwd=tmp_path) as bench:
            rejected = bench.end()
        assert rejected.status == several.status
        assert rejected.complaint.endswith("; choose one with --node N")
        arguments = ("--node", "2", "--plan", "paper", "--json")
        with Command("connect", one.port, *arguments, "--out", "two.mcap", cwd=tmp_path) as host:
            host.prints("run is driving")
            again = ("--node", "1", "--duration", "1", "--json", "--out", "again.mcap")
            second = connect(tmp_path, one.port, *again)
            assert second.status == 3
            assert "another host sends on this bus" in second.complaint
            ended = stopped_after_a_while(host)
        assert ended.status == 0, ended.err
        assert ended.json["path_m"] > 0.1
        assert ended.json["wire"]["lost"] == 0
        nodes = {m.decoded.node for m in LogReader(tmp_path / "two.mcap").messages(["/device/imu"])}
        assert nodes == {2}


class FullNetwork(VirtualBus):
    """A bus that accepts two frames, and then no more."""

    def __init__(self, group: str) -> None:
        super().__init__(channel=group)
        self.sent: list[int] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if len(self.sent) == 2:
            raise can.CanOperationError("No buffer space available")
        self.sent.append(msg.arbitration_id)
        super().send(msg, timeout)


def test_unsent_frames_are_not_counted_as_sent() -> None:
    """With full network buffers the rest goes back to the line, which reports it."""
    joined: list[FullNetwork] = []

    def join(group: str) -> can.BusABC:
        joined.append(FullNetwork(group))
        return joined[-1]

    with MulticastPort(join) as port:
        frames = b"".join(RECORD.pack(can_id, 1, b"x") for can_id in (0x121, 0x131, 0x141))
        assert port.write(frames) == 2 * RECORD.size
        assert joined[0].sent == [0x121, 0x131]
        port.unplug()
        assert port.write(frames) == len(frames), "nobody wants it"


def in_msgpack(**fields: object) -> bytes:
    """Return a frame in python-can's own form, with some invalid fields."""
    frame = can.Message(arbitration_id=1, data=b"x", is_extended_id=False)
    for name, value in fields.items():
        setattr(frame, name, value)
    return pack_message(frame)


NO_FRAMES = (
    b"",
    b"garbage",
    b"\x81\xa1x\x01",
    b"\xa2\xff\xfe",  # text that is invalid UTF-8
    in_msgpack(arbitration_id=1.5),
    in_msgpack(arbitration_id=float("nan")),
    in_msgpack(dlc=1.0),
    in_msgpack(arbitration_id="1"),
    in_msgpack(data="x"),
)


def test_datagrams_that_are_no_frames_do_not_end_a_device() -> None:
    def join(group: str) -> can.BusABC:
        return MulticastBus(group)

    with MulticastPort(join, "239.74.163.3") as port, socket.socket(type=DGRAM) as stranger:
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        for data in NO_FRAMES:
            stranger.sendto(data, ("239.74.163.3", 43113))
        with CanPort("can:udp_multicast:239.74.163.3") as host:
            host.write(FRAME)
            found = b""
            for _ in range(10):
                select.select(port.filenos(), [], [], 0.2)
                found = found or port.read()
            assert found == FRAME


def test_datagrams_that_are_no_frames_do_not_end_the_port() -> None:
    with CanPort("can:udp_multicast:239.74.163.5") as port, socket.socket(type=DGRAM) as stranger:
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        for data in NO_FRAMES:
            stranger.sendto(data, ("239.74.163.5", 43113))
        with CanPort("can:udp_multicast:239.74.163.5") as other:
            other.write(FRAME)
            found = b""
            for _ in range(10):
                found = found or port.wait(0.2)
            assert found == FRAME
            assert other.wait(0.1) == b"", "its own frame is not heard"
        assert port.garbled == len(NO_FRAMES)


def test_only_data_frames_reach_the_device() -> None:
    """Error frames have an identifier and data too: the controller's report."""
    group = "239.74.163.6"
    with (
        MulticastPort(MulticastBus, group) as device,
        socket.socket(type=DGRAM) as stranger,
    ):
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        frames = [
            can.Message(arbitration_id=0x100, is_extended_id=False, is_error_frame=True, data=b"x"),
            can.Message(arbitration_id=0x100, is_extended_id=False, is_remote_frame=True),
            can.Message(arbitration_id=0x100, is_extended_id=True, data=b"x"),
            can.Message(arbitration_id=0x200, is_extended_id=False, data=b"x"),
        ]
        for frame in frames:
            stranger.sendto(pack_message(frame), (group, 43113))
        select.select(device.filenos(), [], [], PATIENCE_S)
        assert ids(device.read()) == [0x200]


GROUP = "239.74.163.4"
_SENDER = """
import socket, sys
with socket.socket(type=socket.SOCK_DGRAM) as out:
    out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
    out.sendto(bytes.fromhex(sys.argv[2]), (sys.argv[1], 43113))
"""


def sent_by_another_process(address: str, can_id: int) -> None:
    """Send a frame in python-can's own form."""
    data = pack_message(can.Message(arbitration_id=can_id, data=b"x", is_extended_id=False)).hex()
    subprocess.run([sys.executable, "-c", _SENDER, address, data], check=True)


def own_addresses() -> list[str]:
    """Return this machine's addresses: one that only it can reach, and those that others can."""
    found = ["127.0.0.1", "127.0.0.5"]
    with socket.socket(type=DGRAM) as probe, suppress(OSError):  # without any network
        probe.connect(("203.0.113.9", 9))  # sends nothing; it chooses the address to send from
        found.append(probe.getsockname()[0])
    return found


@pytest.mark.parametrize("lan", [False, True])
def test_only_datagrams_to_the_group_are_on_the_bus(lan: bool) -> None:  # noqa: FBT001 - of a test
    """A datagram to an address of this machine is no frame, whatever its sender."""
    join = partial(MulticastBus, lan=lan)
    with (
        CanPort(f"can:udp_multicast:{GROUP}", lan=lan) as host,
        MulticastPort(join, GROUP) as device,
    ):
        for address in own_addresses():
            sent_by_another_process(address, 0x100)
        # the last one: any other accepted frame comes before it
        sent_by_another_process(GROUP, 0x200)
        assert ids(host.wait(PATIENCE_S)) == [0x200]
        select.select(device.filenos(), [], [], PATIENCE_S)
        assert ids(device.read()) == [0x200]


def ids(data: bytes) -> list[int]:
    return [can_id for can_id, _, _ in RECORD.iter_unpack(data)]


def test_a_frame_of_another_machine_is_taken_only_with_lan(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sender's address decides. Here it is in a foreign network."""
    frame = pack_message(can.Message(arbitration_id=0x123, data=b"x", is_extended_id=False))

    class Network(socket.socket):
        """Datagrams from another machine."""

        def recvfrom(self, size: int, flags: int = 0, /) -> tuple[bytes, tuple[str, int]]:
            data, _ = super().recvfrom(size, flags)
            return data, ("203.0.113.9", 43113)

    monkeypatch.setattr(socket, "socket", Network)
    for lan in (False, True):
        with MulticastBus(GROUP, lan=lan) as near, MulticastBus(GROUP, lan=lan) as far:
            far.send(unpack_message(frame))
            message = near.recv(0.5)
            assert (message is not None) == lan


def test_a_drive_over_socketcan(monkeypatch: pytest.MonkeyPatch) -> None:
    """The test runs all our code above python-can, whose in-process bus replaces the kernel's."""
    asked: list[dict[str, object]] = []

    def opened(**options: object) -> can.BusABC:
        asked.append(options)
        return VirtualBus(channel=str(options["channel"]))

    monkeypatch.setattr(can, "Bus", opened)
    with device_on("can:socketcan:can7"):
        drive_a_little("can:socketcan:can7")
    # The system sets the interface's rate (ip link), not a user over python-can.
    wanted = {"interface": "socketcan", "channel": "can7", "ignore_config": True}
    assert asked == [wanted, wanted]


def test_socketcan_that_is_not_there_is_reported() -> None:
    with pytest.raises(PortError, match="cannot open can:socketcan:nosuchcan"):
        open_port("can:socketcan:nosuchcan")
