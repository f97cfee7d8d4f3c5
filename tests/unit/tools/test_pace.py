"""The pauses of a simulated run that has a limited speed."""

from __future__ import annotations

from bridge.motion.geometry import Pose2
from bridge.record.sink import NullSink
from bridge.session.records import TruthRecord
from tools.virtual.pace import PacedSink


class SlowClock:
    """A clock that advances only by pauses and by the test."""

    def __init__(self) -> None:
        self.now_ns = 1_000
        self.pauses_s: list[float] = []

    def now(self) -> int:
        return self.now_ns

    def pause(self, duration_s: float) -> None:
        self.pauses_s.append(duration_s)
        self.now_ns += round(duration_s * 1e9)


def records(count: int, step_ns: int) -> list[TruthRecord]:
    return [TruthRecord(7 + number * step_ns, Pose2(0.0, 0.0, 0.0)) for number in range(count)]


def test_a_run_takes_its_time_over_the_speed() -> None:
    clock = SlowClock()
    sink = PacedSink(NullSink(), 4.0, clock.now, clock.pause)
    for record in records(101, 100_000_000):
        sink.write(record)
    assert abs(sum(clock.pauses_s) - 10.0 / 4.0) < 0.03


def test_a_run_that_is_late_does_not_wait() -> None:
    clock = SlowClock()
    sink = PacedSink(NullSink(), 1.0, clock.now, clock.pause)
    for record in records(20, 100_000_000):
        clock.now_ns += 150_000_000
        sink.write(record)
    assert clock.pauses_s == []
