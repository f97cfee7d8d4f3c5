"""Streams: rates, stamps, sequence and values."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from protocol.can.frames import RECORD
from protocol.messages.device import Encoders, Imu, ImuInfo, LogText, Range, Sync
from protocol.messages.host import ClearStop, Describe, SetStreamRate
from protocol.messages.values import Capability, NackReason, StopCause
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from protocol.schema.message import Direction, RateClass
from support.probe import since
from support.reference_codec import RefDamage, RefFrame, parse_stream

if TYPE_CHECKING:
    from protocol.schema.message import Message, MessageSpec
    from support.probe import Heard, Probe

TOLERANCE = 0.05
"""Relative tolerance of a rate. A crystal is a thousand times better, a drifting loop is not."""
NEEDS = {"planner_state": Capability.ONBOARD_PLANNER}


def type_of(kind: type[Message]) -> int:
    return CATALOGUE.by_class[kind].type_id


def stamps(received: list[Heard], kind: type[Message]) -> list[int]:
    return [h.frame.t_us for h in received if isinstance(h.message, kind)]


def rate_hz(received: list[Heard], kind: type[Message]) -> float:
    """Return the rate by the device's own stamps, Hz; 0 for fewer than two messages."""
    times = stamps(received, kind)
    if len(times) < 2:
        return 0.0
    return (len(times) - 1) * 1e6 / sum(since(a, b) for a, b in pairwise(times))


def set_rate(device: Probe, kind: type[Message], tenths: int) -> None:
    reason = device.refusal(lambda i: SetStreamRate(i, type_of(kind), tenths))
    assert reason is None, f"{kind.__name__} at {tenths / 10} Hz: {reason}"


def streams_of(device: Probe) -> list[MessageSpec]:
    """Return the streams that the device should send by itself after the handshake."""
    assert device.hello is not None
    return [
        spec
        for spec in CATALOGUE
        if spec.direction is Direction.DEVICE
        and spec.rate is RateClass.STREAM
        and device.has(spec.cls)
        and NEEDS.get(spec.name, Capability(0)) & ~device.hello.capabilities == 0
    ]


@pytest.mark.slow
def test_every_stream_flows_at_its_default_rate(device: Probe) -> None:
    device.handshake(quick_status=False)
    received = device.listen(2.6)
    for spec in streams_of(device):
        measured = rate_hz(received, spec.cls)
        assert measured == pytest.approx(spec.default_hz, rel=TOLERANCE), (
            f"{spec.name}: {measured:.2f} Hz by its stamps, {spec.default_hz} Hz declared"
        )


@pytest.mark.slow
def test_a_rate_ends_with_the_session_that_set_it(device: Probe) -> None:
    device.handshake(quick_status=False)
    for kind, tenths in ((Imu, 200), (Encoders, 1000), (Range, 0)):
        if device.has(kind):
            set_rate(device, kind, tenths)
    device.ping()
    received = device.listen(0.8)
    for kind, hertz in ((Imu, 20.0), (Encoders, 100.0), (Range, 0.0)):
        if device.has(kind):
            measured = rate_hz(received, kind)
            assert measured == pytest.approx(hertz, rel=TOLERANCE), f"{kind.__name__} {measured}"
    device.handshake(quick_status=False)
    received = device.listen(0.6)
    for kind in (Imu, Encoders, Range):
        if device.has(kind):
            declared = CATALOGUE.by_class[kind].default_hz
            assert rate_hz(received, kind) == pytest.approx(declared, rel=TOLERANCE), (
                f"{kind.__name__}: the rate of the last session is still set"
            )


@pytest.mark.parametrize(
    ("stream", "tenths", "why"),
    [
        (0x19, 100, "ack is no stream"),
        (0x02, 100, "the host's own stream"),
        (0x7E, 100, "no such message"),
        (0x13, 10_001, "above what is declared"),
        (0x10, 39, "sync below 4 Hz: stamps on CAN could not be extended"),
    ],
)
def test_a_rate_that_cannot_be_is_rejected(
    device: Probe, stream: int, tenths: int, why: str
) -> None:
    device.handshake()
    reason = device.refusal(lambda i: SetStreamRate(i, stream, tenths))
    if reason is NackReason.UNKNOWN_COMMAND:
        device.needs(what=False, name="it does not set rates")
    assert reason in {NackReason.BAD_VALUE, NackReason.UNSUPPORTED}, f"{why}: {reason}"


def test_stamps_advance_and_are_of_the_sampling(device: Probe) -> None:
    """A message that waits behind other bytes keeps the stamp of its sampling.

    Many questions make the line busy. If the device stamped a message when it sends it, the spacing
    of the stamps would vary. Some jitter of the sampling itself is normal.
    """
    device.handshake()
    mark = len(device.received)
    period_us = 1e6 / CATALOGUE.by_class[Imu].default_hz
    for _ in range(25):
        for spec in list(CATALOGUE)[:4]:
            device.send(Describe(spec.type_id, len(spec.fields)))
        device.listen(0.04)
    times = stamps(device.received[mark:], Imu)
    assert len(times) > 50
    gaps = [since(a, b) for a, b in pairwise(times)]
    assert min(gaps) > 0, "a stamp that does not advance"
    off = sorted(abs(gap - period_us) / period_us for gap in gaps)
    assert off[int(0.8 * len(off))] < 0.3, (
        f"samples every {period_us:.0f} us are stamped {sorted(gaps)[:3]} … {sorted(gaps)[-3:]} us "
        "apart: not the moment of sampling"
    )


def test_stamps_are_of_the_devices_clock_and_not_of_the_future(device: Probe) -> None:
    device.handshake()
    pings = [p for p in (device.ping() for _ in range(8)) if p is not None]
    best = min(pings, key=lambda p: p.round_trip_us)
    mark = len(device.received)
    device.listen(0.5)
    for received in device.received[mark:]:
        # The device replies after the request at the earliest. This bounds how far its clock can
        # be ahead of the estimate from the ping.
        age_us = since(received.frame.t_us, best.replied_us + received.at_us - best.sent_us)
        name = type(received.message).__name__
        assert age_us > -1_000, f"{name} is stamped {-age_us} us too late"
        assert age_us < 500_000, f"{name} is stamped {age_us} us too early"


def test_values_are_in_their_declared_ranges(device: Probe) -> None:
    device.handshake()
    received = device.listen(0.5)
    assert received
    for message, frame in ((h.message, h.frame) for h in received):
        for field, value in zip(CATALOGUE.by_type[frame.type_id].fields, message, strict=True):
            if field.wire.is_integer and value is not None and value != field.none:
                assert field.low <= value <= field.high, f"{type(message).__name__}.{field.name}"


def test_at_rest_the_imu_feels_the_earth_and_nothing_else(device: Probe) -> None:
    device.handshake()
    device.needs(Capability.IMU)
    device.listen(0.3)
    samples = device.of(Imu)
    info = device.of(ImuInfo)[-1]
    mean = [sum(column) / len(samples) for column in zip(*samples, strict=True)]
    felt = math.hypot(*mean[:3]) * 9.80665 / info.accel_per_g
    assert felt == pytest.approx(9.81, rel=0.1), f"{felt:.2f} m/s2 at rest"
    assert mean[2] > 0, "z points up, so it must measure +1 g"
    turning = max(abs(rate) for rate in mean[4:]) / info.gyro_per_deg_s
    assert turning < 10.0, f"{turning:.1f} deg/s at rest; MPU6050 allows 20 before calibration"


def test_the_imu_scale_is_sent_after_hello_and_each_second(
    device: Probe,
) -> None:
    device.handshake()
    device.needs(Capability.IMU)
    device.listen(0.3)
    infos = device.of(ImuInfo)
    assert infos, "no imu_info before the streams"
    assert min(tuple(infos[0])[:3]) > 0
    mark = len(device.received)
    device.listen(2.5)
    again = device.of(ImuInfo, mark)
    assert 2 <= len(again) <= 3, f"{len(again)} imu_info in 2.5 s"
    assert {tuple(i) for i in (*infos, *again)} == {tuple(infos[0])}


@pytest.mark.link("uart")
def test_sequence_numbers_count_every_frame(device: Probe) -> None:
    device.handshake()
    device.listen(0.1)
    device.forget()
    device.ping()
    device.listen(0.4)
    found = parse_stream(bytes(device.raw))
    damage = [f for f in found[1:] if isinstance(f, RefDamage)]
    assert not damage, f"damaged on a good line: {damage}"
    frames = [f for f in found if isinstance(f, RefFrame)]
    assert len(frames) > 50
    for before, after in pairwise(frames):
        assert after.seq == (before.seq + 1) % 256, "a gap in the sequence"
    assert {(f.version, f.node) for f in frames} == {(PROTOCOL_VERSION, device.node)}
    assert all(f.flags & ~1 == 0 for f in frames), "a flag that has no meaning"


@pytest.mark.link("uart")
def test_another_codec_reads_its_bytes(device: Probe) -> None:
    """A second codec that shares no code with ours reads the whole capture."""
    device.handshake()
    device.forget()
    device.ping()
    device.listen(0.3)
    frames = [f for f in parse_stream(bytes(device.raw)) if isinstance(f, RefFrame)]
    ours = [(h.frame.type_id, h.frame.seq, h.frame.t_us, h.frame.payload) for h in device.received]
    theirs = [(f.type_id, f.seq, f.t_us, f.payload) for f in frames]
    first = theirs.index(ours[0])
    assert theirs[first : first + len(ours)] == ours


def test_sync_counts_every_frame(device: Probe) -> None:
    device.handshake()
    device.needs(Sync)
    device.forget()
    device.listen(0.7)
    if device.on_can:
        numbers = [
            (can_id >> 4, int.from_bytes(data[4:8], "little"))
            for can_id, _, data in RECORD.iter_unpack(bytes(device.raw))
            if can_id & 15 == device.node
        ]
    else:
        numbers = [
            (f.type_id, int.from_bytes(f.payload[:4], "little"))
            for f in parse_stream(bytes(device.raw))
            if isinstance(f, RefFrame)
        ]
    at = [i for i, (type_id, _) in enumerate(numbers) if type_id == type_of(Sync)]
    assert len(at) >= 4
    for first, second in pairwise(at):
        counted = numbers[second][1] - numbers[first][1]
        assert counted == second - first, f"{counted} counted, {second - first} received"


def test_log_lines_come_at_most_ten_a_second(device: Probe) -> None:
    device.handshake()
    device.needs(LogText)
    for _ in range(20):
        device.stop()
        device.refusal(lambda i: ClearStop(i, StopCause.OPERATOR))
    device.listen(0.6)
    times = stamps(device.received, LogText)
    gaps = [since(a, b) for a, b in pairwise(times)]
    assert all(gap >= 90_000 for gap in gaps), f"log lines {gaps} us apart"
    assert all(len(line.line.encode()) <= 241 and line.line for line in device.of(LogText))
