"""Simultaneous faults, their events, equal seeds, and the link without faults."""

from __future__ import annotations

import pytest

from bridge.session.states import SessionReady
from sim_device.line.line import LineSettings
from support.rigs import Drive, lost_frames, rig

pytestmark = pytest.mark.usefixtures("target")

# ---- simultaneous faults ------------------------------------------------------------------


def test_the_end_of_one_does_not_end_another() -> None:
    made = rig("wheel-stuck@1:3:left", "wheel-stuck@2:1:both", "wheel-slip@1:both,share=0.5")
    faults = made.plant.faults
    made.step(b"", 1_500_000)
    assert (faults.stuck_left, faults.stuck_right, faults.slip_left) == (True, False, 0.5)
    made.step(b"", 2_500_000)
    assert (faults.stuck_left, faults.stuck_right) == (True, True)
    made.faults.start("wheel-slip:left,share=0.5")
    made.step(b"", 3_500_000)
    assert (faults.stuck_left, faults.stuck_right) == (True, False)
    assert (faults.slip_left, faults.slip_right) == (0.75, 0.5)
    assert made.faults.clear("wheel-slip") == 2
    made.step(b"", 4_500_000)
    assert (faults.stuck_left, faults.slip_left, faults.slip_right) == (False, 0.0, 0.0)
    assert made.faults.active == []


def test_events_are_reported_with_their_time() -> None:
    made = rig("silence@1:0.5", "reset@2", "unplug@9")
    made.step(b"", 3_000_000)
    made.faults.start("lifted@+1:0.25")
    made.step(b"", 5_000_000)
    reported = [(e.t_us, e.what, e.spec.kind.name) for e in made.faults.take_events()]
    assert reported == [
        (1_000_000, "began", "silence"),
        (1_500_000, "ended", "silence"),
        (2_000_000, "struck", "reset"),
        (4_000_000, "began", "lifted"),
        (4_250_000, "ended", "lifted"),
    ]
    assert [spec.kind.name for spec in made.faults.waiting] == ["unplug"]
    assert made.faults.take_events() == []


# ---- seeds --------------------------------------------------------------------------------

STORM = (
    "bit-flips@1:rate=0.001",
    "byte-loss@1:rate=0.0005",
    "duplicates@1:rate=0.0005",
    "bursts@1.5:1:rate=0.0005",
    "jitter@1:ms=5",
    "person@1.5:1",
    "wheel-slip@2",
)


def storm(seed: int) -> list[tuple[int, bytes]]:
    drive = Drive(rig(*STORM, settings=LineSettings(), seed=seed), 0.1)
    drive.run(3.5)
    return drive.bytes


def test_the_same_seed_gives_the_same_bytes() -> None:
    first = storm(1)
    assert first == storm(1)
    assert first != storm(2)


def test_without_faults_a_straight_line_adds_no_delay() -> None:
    with_rig, bare = rig(seed=3), rig(seed=3).device
    drive = Drive(with_rig, 0.2)
    sent: list[tuple[int, bytes]] = []
    step = with_rig.step

    def taped(data: bytes, now_us: int) -> bytes:
        sent.append((now_us, data))
        return step(data, now_us)

    with_rig.step = taped  # type: ignore[method-assign]  # records the input
    drive.run(3.0)
    out = [(at_us, bare.step(data, at_us)) for at_us, data in sent]
    assert [(at, data) for at, data in out if data] == drive.bytes
    assert bare.truth == with_rig.truth


def test_a_fault_that_never_comes_changes_nothing() -> None:
    runs = []
    for faults in ((), ("bit-flips@100",), ("person@100", "reset@100")):
        drive = Drive(rig(*faults), 0.2)
        drive.run(2.5)
        runs.append(drive.bytes)
    assert runs[0] == runs[1] == runs[2]


def test_handshake_over_the_real_line_and_its_pace() -> None:
    drive = Drive(rig(settings=LineSettings(115_200, 16_000)))
    drive.run(4.0)
    assert isinstance(drive.negotiated()[0], SessionReady)
    assert drive.session.link.statistics.lost == 0
    assert lost_frames(drive, 2.0, 4.0) < 0.02
    for at_us, data in drive.bytes:
        assert len(data) <= 62 * (1 + 16_000 * 11_520 // 62_000_000) + 124
        assert at_us > 0
    assert 16_000 <= max(drive.round_trips_us(1.0, 4.0)) < 40_000


def test_bytes_that_the_host_does_not_read_overflow_the_adapter() -> None:
    drive = Drive(rig(settings=LineSettings()))
    drive.run(2.0)
    made, now_us, held = drive.rig, drive.now_us, 0
    while made.counts().adapter_overrun == 0:
        now_us = made.next_deadline_us()
        out = made.step(b"", now_us)
        made.take_back(out, now_us)
        held = max(held, len(out))
        assert now_us < 6_000_000
    assert held <= 4096 + 62
    out = made.step(b"", now_us + 1_000)
    assert 4000 < len(out) <= 4096 + 200, "buffered bytes arrive once the host reads again"
