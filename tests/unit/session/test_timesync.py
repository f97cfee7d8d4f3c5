"""Conversion of device time to host time, with wraps, steps and resets of the device clock."""

from __future__ import annotations

import pytest

from bridge.session.timesync import STEP_SAMPLES, TimeSync
from protocol.clock import DeviceUs, HostNs

WRAP = 1 << 32


class World:
    """Two clocks and a wire with fixed delays."""

    def __init__(self, *, drift_ppm: float = 0.0, device_us: int = 0, delay_us: int = 500) -> None:
        self.sync = TimeSync()
        self.now_us = 0
        self.drift = drift_ppm * 1e-6
        self.device_first_us = device_us
        self.delay_us = delay_us

    def host_ns(self, now_us: float) -> HostNs:
        return HostNs(round(now_us * 1000) + 9_000_000_000)

    def device_us(self, now_us: float) -> int:
        return int(self.device_first_us + now_us * (1 + self.drift))

    def ping(self, *, extra_us: int = 0) -> bool:
        sent = self.now_us
        received = sent + self.delay_us + extra_us
        arrived = received + 100 + self.delay_us
        sync = self.sync
        stamp = sync.extend(self.device_us(received) % WRAP)
        reply = sync.extend(self.device_us(received + 100) % WRAP)
        self.now_us += 100_000
        return sync.exchange(self.host_ns(sent), stamp, reply, self.host_ns(arrived))

    def error_ns(self) -> tuple[float, int]:
        """Return error and bound of a sample stamped now."""
        mapped = self.sync.map(self.sync.extend(self.device_us(self.now_us) % WRAP))
        assert mapped is not None
        return mapped.host_ns - self.host_ns(self.now_us), mapped.bound_ns


def test_nothing_is_known_before_the_first_exchange() -> None:
    sync = TimeSync()
    assert sync.map(DeviceUs(5)) is None
    sync.arrival(sync.extend(5), HostNs(7))
    assert sync.map(DeviceUs(5)) is None


def test_a_symmetric_link_is_synchronised_to_the_microsecond() -> None:
    world = World()
    for _ in range(100):
        assert world.ping()
    error, bound = world.error_ns()
    assert abs(error) < 60_000
    assert abs(error) <= bound < 700_000


@pytest.mark.parametrize("drift_ppm", [-97.3, -13.7, 0.0, 13.7, 97.3])
def test_stamps_cut_to_microseconds_are_within_the_bound(drift_ppm: float) -> None:
    """On a wire without delay, truncation to microseconds is the only error."""
    world = World(drift_ppm=drift_ppm, delay_us=0)
    for _ in range(300):
        world.ping()
        world.now_us += 3_137
        error, bound = world.error_ns()
        assert abs(error) <= bound
    assert bound < 200_000


@pytest.mark.parametrize("first_us", [WRAP - 3_000_000, WRAP - 100, 5 * WRAP - 4_000_000])
def test_a_wrap_of_the_device_clock_is_no_step(first_us: int) -> None:
    world = World(device_us=first_us, drift_ppm=40)
    for _ in range(120):
        assert world.ping()
        error, bound = world.error_ns()
        assert abs(error) <= bound
    assert world.sync.steps == 0


@pytest.mark.parametrize("step_us", [-5_000_000, -20_000, 20_000, 5_000_000])
def test_a_step_is_found_and_samples_are_unbounded_meanwhile(step_us: int) -> None:
    world = World(device_us=100_000_000)
    for _ in range(100):
        world.ping()
    world.device_first_us += step_us
    reported = []
    for _ in range(STEP_SAMPLES):
        reported.append(world.ping())
        mapped = world.sync.map(world.sync.extend(world.device_us(world.now_us) % WRAP))
        assert mapped is None, "no time is better than a wrong time"
    assert reported == [True] * (STEP_SAMPLES - 1) + [False]
    assert world.sync.steps == 1
    for _ in range(30):
        assert world.ping()
    error, bound = world.error_ns()
    assert abs(error) <= bound < 1_000_000


def test_one_slow_ping_is_no_step() -> None:
    world = World()
    for k in range(100):
        assert world.ping(extra_us=300_000 if k % 7 == 3 else 0)
        assert abs(world.error_ns()[0]) <= world.error_ns()[1]
    assert world.sync.steps == 0


def test_the_bound_grows_with_the_age_of_the_fit() -> None:
    world = World(drift_ppm=80)
    for _ in range(50):
        world.ping()
    bounds = []
    for _ in range(5):
        world.now_us += 10_000_000
        error, bound = world.error_ns()
        assert abs(error) <= bound
        bounds.append(bound)
    assert bounds == sorted(bounds)
    assert bounds[-1] > bounds[0]


def test_memory_is_bounded_and_old_fences_go() -> None:
    world = World(drift_ppm=20)
    for _ in range(2000):
        world.ping()
    assert max(world.sync.constraints) <= 60


def test_a_reset_clears_the_wraps_too() -> None:
    world = World(device_us=3 * WRAP)
    world.ping()
    world.sync.reset()
    assert world.sync.extend(5) == 5
    assert world.sync.map(DeviceUs(5)) is None


def test_a_step_of_the_host_clock_does_not_forget_the_wraps_of_the_device() -> None:
    world = World(device_us=WRAP - 2_000_000)
    for _ in range(100):
        world.ping()
    before_us = world.sync.extend(world.device_us(world.now_us) % WRAP)
    assert before_us > WRAP
    world.device_first_us += 5_000_000
    while world.sync.steps == 0:
        world.ping()
    after_us = world.sync.extend(world.device_us(world.now_us) % WRAP)
    assert 0 < after_us - before_us < 10_000_000
