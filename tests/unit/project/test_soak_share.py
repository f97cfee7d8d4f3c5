"""A part of the endurance campaign; ``make soak`` runs all of it."""

from __future__ import annotations

import random

from bridge.motion.geometry import Pose2
from bridge.record.sink import NullSink
from bridge.session.records import EventRecord, Severity, TruthRecord
from protocol.messages.values import StopCause
from sim_device.faults.kinds import KINDS, parse_fault
from sim_device.sweeper import VirtualSweeper
from soak.faults import draw_fault, run
from soak.watched import RAMP_S, Truth
from tools.cli.rooms import load_room


def test_random_faults_neither_crash_nor_move_nor_spoil_the_log() -> None:
    result = run(13, max_s=12.0)
    assert result.bad == []
    assert result.messages > 1000


def test_every_kind_can_be_drawn() -> None:
    plan = load_room("case-1")
    for kind in KINDS.values():
        for seed in range(20):
            spec = draw_fault(kind, random.Random(seed), plan)
            assert parse_fault(spec.text) == spec


def test_motion_under_a_latch_is_seen() -> None:
    device = VirtualSweeper(load_room("case-1"), seed=1, noise="none")
    truth = Truth(NullSink())
    truth.attach(_Made(device))  # type: ignore[arg-type]  # has a device
    ns = 1_000_000
    steps = round(RAMP_S / 0.02) + 6
    for step in range(steps):  # 0.2 m/s, although a stop is latched since boot
        truth.write(TruthRecord(step * 20 * ns, Pose2(0.004 * step, 0.0, 0.0)))
    assert 3 < len(truth.unsafe) < 8, "fewer than the ten that are kept"
    assert truth.unsafe[0].startswith(f"at {RAMP_S + 0.03:.2f} s")
    device.firmware.latch.clear(StopCause.SESSION_END)
    seen = len(truth.unsafe)
    truth.write(TruthRecord(steps * 20 * ns, Pose2(0.004 * steps, 0.0, 0.0)))
    assert len(truth.unsafe) == seen, "no stop is latched, so motion is safe"
    truth.write(TruthRecord((steps + 1) * 20 * ns, Pose2(0.004 * steps + 0.1, 0.0, 0.0)))
    assert len(truth.unsafe) == seen + 1
    assert "5.00 m/s" in truth.unsafe[-1]


def test_a_robot_that_an_obstacle_shoves_does_not_drive() -> None:
    truth = Truth(NullSink())
    truth.attach(_Made(VirtualSweeper(load_room("case-1"), seed=1, noise="none")))  # type: ignore[arg-type]  # has a device
    ns = 1_000_000
    for step in range(100):
        truth.write(TruthRecord(step * 20 * ns, Pose2(0.0, 0.0, 0.0)))
    moved = {"fault": "obstacle", "what": "began"}
    truth.write(EventRecord(1990 * ns, Severity.WARNING, "fault", "began", "obstacle", moved))
    truth.write(TruthRecord(2000 * ns, Pose2(0.1, 0.0, 0.0)))
    assert truth.unsafe == []
    assert truth.simulated_s == 2.0
    truth.write(TruthRecord(2020 * ns, Pose2(0.2, 0.0, 0.0)))
    assert "5.00 m/s" in truth.unsafe[0], "the obstacle excuses only one step"


class _Made:
    """A run that has only its device."""

    def __init__(self, device: VirtualSweeper) -> None:
        self.device = device
