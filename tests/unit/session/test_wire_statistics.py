"""Rate, loss, order and age of each message, from series of time stamps with known results."""

from __future__ import annotations

import random

from bridge.session.link_stats import MessageStatistics, Spread
from bridge.session.timesync import Fit
from protocol.messages.device import Ack, Imu
from protocol.schema.catalogue import CATALOGUE

IMU = CATALOGUE.by_class[Imu]
FIT = Fit(0, 5e9, 0.0, 0.0, 0.0)
"""A fit in which device time 0 is host time 5 s, and both clocks have the same rate."""


def series(*stamps_us: int, delay_us: int = 1_500) -> dict[str, object]:
    kind = MessageStatistics(IMU)
    for stamp_us in stamps_us:
        kind.take(stamp_us & 0xFFFF_FFFF, 5_000_000_000 + (stamp_us + delay_us) * 1000, FIT)
    return kind.to_dict()


def test_a_whole_stream() -> None:
    reported = series(*range(0, 1_000_001, 10_000))
    assert reported["count"] == 101
    assert reported["rate_hz"] == 100.0
    assert reported["lost"] == 0
    assert reported["reordered"] == 0
    assert reported["age_ms"] == {"mean": 1.5, "max": 1.5}


def test_holes_are_counted_by_the_period() -> None:
    stamps = [k * 10_000 for k in range(200) if k not in {50, 90, 91, 92, 150}]
    assert series(*stamps)["lost"] == 5


def test_random_loss_is_counted_whole() -> None:
    rng = random.Random(3)
    kept = [k for k in range(20_000) if k < 10 or rng.random() > 0.05]
    reported = series(*(k * 10_000 for k in kept))
    assert isinstance(reported["lost"], int)
    assert abs(reported["lost"] - (kept[-1] + 1 - len(kept))) <= 2


def test_a_rate_that_is_changed_is_no_loss() -> None:
    quick = list(range(0, 1_000_000, 10_000))
    slow = list(range(1_000_000, 3_000_000, 50_000))
    assert series(*quick, *slow)["lost"] == 0
    assert series(*quick, *slow, *range(3_000_000, 4_000_000, 10_000))["lost"] == 0


def test_stamps_wrap() -> None:
    first = (1 << 32) - 500_000
    reported = series(*range(first, first + 1_000_001, 10_000))
    assert reported["lost"] == 0
    assert reported["rate_hz"] == 100.0


def test_a_late_message_is_out_of_order() -> None:
    reported = series(0, 10_000, 20_000, 40_000, 30_000, 50_000, 60_000)
    assert reported["reordered"] == 1
    assert reported["count"] == 7


def test_a_break_is_no_loss() -> None:
    stamps = [*range(0, 1_000_000, 10_000), *range(60_000_000, 61_000_000, 10_000)]
    assert series(*stamps)["lost"] == 0


def test_only_streams_have_a_rate() -> None:
    kind = MessageStatistics(CATALOGUE.by_class[Ack])
    kind.take(0, 0, None)
    kind.take(5_000_000, 0, None)
    reported = kind.to_dict()
    assert (reported["rate_hz"], reported["lost"]) == (None, None)
    assert reported["age_ms"] == {"mean": None, "max": None}


def test_a_distribution_has_its_percentiles_within_nine_percent() -> None:
    rng, spread = random.Random(1), Spread()
    values = sorted(rng.lognormvariate(14.0, 0.5) for _ in range(5_000))
    for value in values:
        spread.add(value)
    for percent in (50.0, 99.0):
        exact = values[int(len(values) * percent / 100.0)]
        assert exact * 0.99 <= spread.percentile_ns(percent) <= exact * 1.1
    assert spread.to_dict()["count"] == 5_000
    assert Spread().to_dict() == {"count": 0, "min": None, "p50": None, "p99": None, "max": None}
