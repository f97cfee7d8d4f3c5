"""The bound is honest: the truth lies within it, whatever clocks and adapters do."""

from __future__ import annotations

import random

from hypothesis import example, given, settings
from hypothesis import strategies as st

from bridge.timesync import TimeSync
from protocol.clock import HostNs

WRAP = 1 << 32


class Adapter:
    """Delays of one direction: a floor, a fast tail, and a latency timer that may be late."""

    def __init__(self, rng: random.Random, floor_us: float, timer_us: float) -> None:
        self._rng, self._floor_us, self._timer_us = rng, floor_us, timer_us

    def delay_us(self) -> float:
        rng = self._rng
        late = 30_000.0 if rng.random() < 0.01 else 0.0
        return self._floor_us + rng.random() * self._timer_us + rng.expovariate(0.01) + late


def run(
    seed: int, drift_ppm: float, timer_us: float, device_first_us: int, step_at: int | None = None
) -> tuple[list[float], list[float], TimeSync]:
    """A minute of pings and telemetry; |error| / bound and bounds (µs) of every sample."""
    rng = random.Random(seed)
    sync = TimeSync()
    up, down = Adapter(rng, 150.0, 200.0), Adapter(rng, 250.0, timer_us)
    drift = drift_ppm * 1e-6
    step_us = 0

    def device(at_us: float) -> int:
        return int(device_first_us + step_us + at_us * (1 + drift))

    def host(at_us: float) -> HostNs:
        return HostNs(7_000_000_000 + round(at_us * 1000))

    ratios, bounds = [], []
    pings = 0.0
    for k in range(3_000):  # telemetry each 20 ms
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
    assert sync.steps == 0, "jitter is no step"
    # Half of the two floors is what no exchange can tell; a fast tail comes on top.
    assert sorted(bounds)[len(bounds) // 2] < 700.0


@given(st.integers(0, 10_000), st.floats(-100.0, 100.0), st.sampled_from([1_000.0, 16_000.0]))
@settings(max_examples=6)
def test_a_step_of_the_clock_is_found(seed: int, drift_ppm: float, timer_us: float) -> None:
    ratios, _, sync = run(seed, drift_ppm, timer_us, 0, step_at=1500)
    assert sync.steps == 1
    wrong = [r for r in ratios if r > 1.0]
    # From the step to the next ping, a quarter of a second of telemetry at most.
    assert len(wrong) <= 13
    assert max(ratios[-500:]) <= 1.0
