"""The bound of the time synchronisation contains the true time, for any clocks and adapters."""

from __future__ import annotations

import random

from hypothesis import example, given, settings
from hypothesis import strategies as st

from bridge.session.timesync import TimeSync
from protocol.clock import HostNs

WRAP = 1 << 32


class Adapter:
    """Delays of one direction: a minimum, a fast tail, and a latency timer that may be late."""

    def __init__(self, rng: random.Random, floor_us: float, timer_us: float) -> None:
        self._rng, self._floor_us, self._timer_us = rng, floor_us, timer_us

    def delay_us(self) -> float:
        rng = self._rng
        late = 30_000.0 if rng.random() < 0.01 else 0.0
        return self._floor_us + rng.random() * self._timer_us + rng.expovariate(0.01) + late


UP_FLOOR_US, DOWN_FLOOR_US = 150.0, 250.0
"""Minimum delays, µs, that a program may declare for a known wire."""


def run(  # noqa: PLR0913, PLR0917 - properties of a link and a clock
    seed: int,
    drift_ppm: float,
    timer_us: float,
    device_first_us: int,
    step_at: int | None = None,
    sync: TimeSync | None = None,
) -> tuple[list[float], list[float], TimeSync]:
    """Run a minute of pings and telemetry.

    Return |error| / bound of every sample, the bounds (µs) after 10 s, and the synchronisation.
    """
    rng = random.Random(seed)
    sync = TimeSync() if sync is None else sync
    up, down = Adapter(rng, UP_FLOOR_US, 200.0), Adapter(rng, DOWN_FLOOR_US, timer_us)
    drift = drift_ppm * 1e-6
    step_us = 0

    def device(at_us: float) -> int:
        return int(device_first_us + step_us + at_us * (1 + drift))

    def host(at_us: float) -> HostNs:
        return HostNs(7_000_000_000 + round(at_us * 1000))

    ratios, bounds = [], []
    pings = 0.0
    for k in range(3_000):  # telemetry every 20 ms
        at = k * 20_000.0
        if k == step_at:
            step_us = 50_000
        if at >= pings:
            received = at + up.delay_us()
            replied = received + rng.uniform(20, 400)
            arrived = replied + down.delay_us()
            stamp = sync.extend(device(received) % WRAP)
            reply = sync.extend(device(replied) % WRAP)
            sync.exchange(host(at), stamp, reply, host(arrived))
            pings += 100_000 if k < 250 else 250_000
        sampled = sync.extend(device(at) % WRAP)
        sync.arrival(sampled, host(at + rng.uniform(0, 300) + down.delay_us()))
        mapped = sync.map(sampled)
        if mapped is not None:
            ratios.append(abs(mapped.host_ns - host(at)) / mapped.bound_ns)
            if k > 500:
                bounds.append(mapped.bound_ns / 1000)
    return ratios, bounds, sync


@given(
    st.integers(0, 10_000),
    st.floats(-100.0, 100.0),
    st.sampled_from([0.0, 1_000.0, 16_000.0]),
    st.sampled_from([0, 5_000_000, WRAP - 20_000_000, 9 * WRAP - 1_000_000]),
)
@example(1, 100.0, 16_000.0, WRAP - 20_000_000)
@example(2, -100.0, 1_000.0, 0)
@settings(max_examples=12)
def test_the_truth_lies_within_the_bound(
    seed: int, drift_ppm: float, timer_us: float, device_first_us: int
) -> None:
    ratios, bounds, sync = run(seed, drift_ppm, timer_us, device_first_us)
    assert max(ratios) <= 1.0
    assert sync.steps == 0, "jitter was reported as a step"
    # The bound contains half of the sum of both minimum delays, which no exchange can measure,
    # and the fast tail.
    assert sorted(bounds)[len(bounds) // 2] < 700.0


@given(st.integers(0, 10_000), st.floats(-100.0, 100.0), st.sampled_from([1_000.0, 16_000.0]))
@settings(max_examples=6)
def test_a_step_of_the_clock_is_found(seed: int, drift_ppm: float, timer_us: float) -> None:
    ratios, _, sync = run(seed, drift_ppm, timer_us, 0, step_at=1500)
    assert sync.steps == 1
    wrong = [r for r in ratios if r > 1.0]
    # The mapping is wrong from the step to the next ping: at most 0.25 s of telemetry.
    assert len(wrong) <= 13
    assert max(ratios[-500:]) <= 1.0


def percentile(values: list[float], percent: float) -> float:
    return sorted(values)[int(len(values) * percent / 100.0)]


@given(st.integers(0, 10_000), st.floats(-100.0, 100.0), st.sampled_from([1_000.0, 16_000.0]))
@example(3, 100.0, 1_000.0)
@example(4, -100.0, 16_000.0)
@settings(max_examples=3)
def test_a_declared_delay_makes_the_bound_small_and_it_stays_honest(
    seed: int, drift_ppm: float, timer_us: float
) -> None:
    """If both minimum delays are declared, their difference causes no error.

    With 1 ms adapters, the 95th percentile of the bound after 10 s is about 0.1 ms.
    """
    sync = TimeSync(round(UP_FLOOR_US * 1000), round(DOWN_FLOOR_US * 1000))
    ratios, bounds, _ = run(seed, drift_ppm, timer_us, 0, sync=sync)
    inside = sum(ratio <= 1.0 for ratio in ratios)
    assert inside >= 0.999 * len(ratios)
    if timer_us <= 1_000.0:
        assert percentile(bounds, 95.0) < 110.0
        errors = [r * b for r, b in zip(ratios[-len(bounds) :], bounds, strict=True)]
        assert percentile(errors, 95.0) < 100.0


@given(st.integers(0, 10_000), st.floats(-100.0, 100.0))
@settings(max_examples=3)
def test_without_a_declaration_the_minimum_delays_remain(seed: int, drift_ppm: float) -> None:
    """The bound contains half of the sum of both delays, the error half of their difference."""
    ratios, bounds, _ = run(seed, drift_ppm, 1_000.0, 0)
    errors = [r * b for r, b in zip(ratios[-len(bounds) :], bounds, strict=True)]
    assert percentile(errors, 95.0) < 0.5 * (DOWN_FLOOR_US - UP_FLOOR_US) + 100.0
    assert percentile(bounds, 95.0) < 0.5 * (UP_FLOOR_US + DOWN_FLOOR_US) + 200.0


def test_over_many_runs_the_bound_of_a_declared_link_is_below_a_tenth_of_a_millisecond() -> None:
    bounds: list[float] = []
    inside = count = 0
    for seed, drift_ppm in enumerate((-100.0, 0.0, 50.0, 100.0)):
        sync = TimeSync(round(UP_FLOOR_US * 1000), round(DOWN_FLOOR_US * 1000))
        ratios, own, _ = run(seed, drift_ppm, 1_000.0, 0, sync=sync)
        bounds += own
        inside += sum(ratio <= 1.0 for ratio in ratios)
        count += len(ratios)
    assert percentile(bounds, 95.0) < 100.0
    assert inside >= 0.999 * count


def test_a_wrong_declared_delay_makes_the_bound_wrong() -> None:
    """A wrong declaration makes the bound wrong, so only known delays may be declared."""
    sync = TimeSync(round(UP_FLOOR_US * 1000), 3_000_000)
    ratios, _, _ = run(1, 20.0, 1_000.0, 0, sync=sync)
    assert sum(ratio > 1.0 for ratio in ratios) > 0.5 * len(ratios)
