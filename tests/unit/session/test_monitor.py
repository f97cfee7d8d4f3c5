"""The monitor's output for frames that the tests encode by hand from PROTOCOL.md."""

from __future__ import annotations

import struct

import pytest

from bridge.session.monitor import (
    RATE_WINDOW_NS,
    Monitor,
    Seen,
    TypeCount,
    UnknownTypeError,
    as_text,
    texts,
)
from protocol.can.link import CanLink
from protocol.clock import HostNs
from protocol.messages.device import Encoders, Hello, ImuInfo, Sync
from protocol.messages.host import Stop
from protocol.messages.values import StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.dissected import random_messages
from support.reference_codec import cobs_encode, crc32
from tools.live.monitor_view import MonitorLines

MS = 1_000_000


def framed(node: int, type_id: int, seq: int, t_us: int, payload: bytes) -> bytes:
    """Return a frame as PROTOCOL.md describes it, encoded without the package ``protocol``."""
    body = struct.pack("<BBBBI", 2 << 4, node, type_id, seq, t_us) + payload
    return b"\0" + cobs_encode(body + struct.pack("<I", crc32(body))) + b"\0"


RANGE = framed(3, 0x20, 7, 1_500_000, struct.pack("<HBBBB", 1234, 80, 255, 0b101, 61))


def test_a_message_is_reported_with_its_units_and_names() -> None:
    seen = Monitor().receive(RANGE, HostNs(5 * MS))
    assert len(seen) == 1
    one = seen[0]
    assert (one.kind, one.name, one.node, one.direction) == ("message", "range", 3, "device")
    assert (one.t_us, one.host_ns) == (1_500_000, 5 * MS)
    assert one.fields == {
        "ultrasonic_m": pytest.approx(1.234),
        "infrared_left_m": pytest.approx(0.1),  # 80 steps of 1.25 mm
        "infrared_right_m": None,
        "contacts": ["bumper_left", "cliff"],
        "ultrasonic_age_s": pytest.approx(0.061),
    }
    assert one.text == (
        "ultrasonic=1.234m infrared_left=0.1m infrared_right=- contacts=bumper_left|cliff "
        "ultrasonic_age=0.061s"
    )
    assert one.raw == bytes.fromhex("d20450ff053d")


@pytest.mark.parametrize("seed", range(4))
def test_every_message_of_the_catalogue_is_shown(seed: int) -> None:
    for spec, message in random_messages(seed):
        shown = texts(spec, message)
        assert [name for name, _, _ in shown] == [item.name for item in spec.fields]


def test_a_scale_is_shown_with_its_unit() -> None:
    scale = ImuInfo(163_840_000, 1_310_000, 3_400_000, 3_653)
    shown = as_text(CATALOGUE.by_name["imu_info"], scale)
    assert shown == "accel=16384/g gyro=131/(°/s) temperature=340/K zero=36.53°C"


def test_both_directions_are_received_in_order() -> None:
    host = Link(Direction.HOST)
    host.send(Stop(9, StopCause.OPERATOR), 0, node=3)
    stop = host.data_to_send()
    seen = Monitor().receive(RANGE + stop + RANGE, HostNs(0))
    assert [(s.name, s.direction) for s in seen] == [
        ("range", "device"),
        ("stop", "host"),
        ("range", "device"),
    ]
    assert seen[1].fields["cause"] == "operator"


def test_the_split_of_the_bytes_does_not_change_the_messages() -> None:
    stream = RANGE + b"noise\0" + RANGE
    whole = Monitor().receive(stream, HostNs(0))
    monitor = Monitor()
    cut = [s for byte in stream for s in monitor.receive(bytes([byte]), HostNs(0))]
    assert [(s.kind, s.name, s.raw) for s in cut] == [(s.kind, s.name, s.raw) for s in whole]
    assert [s.kind for s in whole] == ["message", "damaged", "message"]


def test_broken_bytes_are_given_whole_and_counted_once() -> None:
    spoilt = bytearray(RANGE)
    spoilt[-3] ^= 0x40
    monitor = Monitor()
    seen = monitor.receive(bytes(spoilt), HostNs(0))
    assert [s.kind for s in seen] == ["damaged"]
    assert seen[0].raw == bytes(spoilt).strip(b"\0")
    assert monitor.damaged == 1
    assert monitor.newest_damage == seen[0]
    assert "not a frame (crc)" in seen[0].text


def test_an_undeclared_type_is_reported_once() -> None:
    monitor = Monitor()
    seen = monitor.receive(framed(1, 0x7A, 0, 0, b"\1\2"), HostNs(0))
    assert [(s.kind, s.name, s.raw) for s in seen] == [("rejected", "type", b"\1\2")]
    assert (monitor.rejected, monitor.damaged) == (1, 0)


def test_types_that_were_not_asked_for_are_counted_and_not_reported() -> None:
    monitor = Monitor(types=["encoders"])
    assert monitor.receive(RANGE, HostNs(0)) == []
    assert monitor.types["range"].count == 1
    with pytest.raises(UnknownTypeError, match="unknown message 'rangee'"):
        Monitor(types=["rangee"])


def test_another_nodes_messages_are_left_out() -> None:
    assert Monitor(node=4).receive(RANGE, HostNs(0)) == []
    assert len(Monitor(node=3).receive(RANGE, HostNs(0))) == 1


def test_rates_are_those_of_the_last_two_seconds() -> None:
    monitor = Monitor()
    for i in range(300):  # 50 Hz for 6 s
        monitor.receive(RANGE, HostNs(20 * i * MS))
    assert monitor.rates_hz()["range"] == pytest.approx(50.0, rel=0.02)
    monitor.tick(HostNs(7_000 * MS))  # silent for 1 s
    assert monitor.rates_hz()["range"] == pytest.approx(25.0, rel=0.05)
    monitor.tick(HostNs(9_000 * MS))
    assert monitor.rates_hz()["range"] == 0.0


def test_lost_frames_are_counted_by_their_numbers() -> None:
    monitor = Monitor()
    for seq in (1, 2, 6):
        monitor.receive(framed(3, 0x16, seq, 0, struct.pack("<HH", 1, 2)), HostNs(0))
    assert monitor.lost == 3


def test_a_device_with_another_catalogue_is_named() -> None:
    hello = Hello(0x1234, bytes(12), 1, 0, 0, 0, 1, 0, 0, "other")
    link = Link(Direction.DEVICE)
    link.send(hello, 0, node=2)
    monitor = Monitor()
    monitor.receive(link.data_to_send(), HostNs(0))
    assert monitor.foreign_catalogues == {2: 0x1234}


def test_a_bus_receives_both_directions() -> None:
    device, host = CanLink(Direction.DEVICE), CanLink(Direction.HOST)
    device.send(Sync(1), 1_000_000, node=5)
    device.send(Encoders(10, 20), 1_010_000, node=5)
    host.send(Stop(1, StopCause.OPERATOR), 0, node=5)
    monitor = Monitor(CanLink)
    seen = monitor.receive(device.data_to_send() + host.data_to_send(), HostNs(0))
    assert [s.name for s in seen] == ["sync", "encoders", "stop"]
    assert seen[1].fields == {"left": 10, "right": 20}


def test_a_missing_node_is_reported_once_with_those_that_answer(
    capsys: pytest.CaptureFixture[str],
) -> None:
    monitor, lines = Monitor(node=9), MonitorLines(raw=False)
    second = 1_000_000_000
    for at in range(1, 6):
        monitor.receive(framed(3, 0x16, at, 1, struct.pack("<HH", 1, 2)), HostNs(at * second))
        lines.tick(monitor, HostNs(at * second))
    monitor.receive(framed(4, 0x16, 1, 1, struct.pack("<HH", 1, 2)), HostNs(6 * second))
    lines.tick(monitor, HostNs(6 * second))
    printed = capsys.readouterr().err.splitlines()
    assert printed == [
        "rates (Hz): no messages from node 9; other nodes that send: 3",
        "rates (Hz): no messages from node 9; other nodes that send: 3, 4",
    ]


def test_a_silence_is_reported_once_and_again_after_it_was_broken(
    capsys: pytest.CaptureFixture[str],
) -> None:
    monitor, lines = Monitor(), MonitorLines(raw=False)
    second = 1_000_000_000
    for at in range(1, 20):
        data = framed(3, 0x16, at, 1, struct.pack("<HH", 1, 2)) if at == 8 else b""
        monitor.receive(data, HostNs(at * second))
        lines.tick(monitor, HostNs(at * second))
    printed = capsys.readouterr().err.splitlines()
    silences = [line for line in printed if "no messages" in line]
    assert silences == ["rates (Hz): no messages"] * 2
    assert any("encoders" in line for line in printed)


@pytest.mark.parametrize(
    ("times_s", "now_s", "rate_hz"),
    [
        ((0.95, 1.95), 2.0, 1.0),
        ((0.02, 1.02), 1.03, 1.0),
        ((0.5,), 0.6, 1.0),
        ((0.1, 0.1), 0.1, 2.0),
        ((0.0, 1.0, 2.0), 2.0, 1.0),
        ((1.0, 1.1, 1.2), 1.2, 10.0),
        ((1.0, 1.1, 1.2), 2.5, 2.0),
        ((0.0,), 3.0, 0.0),
    ],
)
def test_a_rate_counts_intervals(times_s: tuple[float, ...], now_s: float, rate_hz: float) -> None:
    count = TypeCount("hello")
    for time_s in times_s:
        count.add(Seen(round(time_s * 1e9), "message", "hello", 1, "device", 0, {}, "", b""))
    assert count.rate_hz(round(now_s * 1e9), 0) == pytest.approx(rate_hz)


def test_messages_of_the_window_only_are_kept_if_nobody_asks_for_the_rate() -> None:
    count = TypeCount("imu")
    for k in range(20_000):
        count.add(Seen(k * 20_000_000, "message", "imu", 1, "device", 0, {}, "", b""))
    assert count.count == 20_000
    assert len(count._times) <= RATE_WINDOW_NS / 20_000_000 + 1  # noqa: SLF001 - the memory in question
