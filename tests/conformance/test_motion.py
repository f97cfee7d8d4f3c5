"""Motion: setpoints, their time to live, and everything that ends them.

These checks turn the wheels. On the floor, the robot would turn on the spot. Lift its wheels off
the floor.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from protocol.messages.host import Reboot, SetMode, SetParameter, SetStreamRate, Stop
from protocol.messages.values import Fault, Mode, NackReason, StopCause
from support.probe import now_us, since
from support.probe_parameters import every, put, raw_of, value_of

if TYPE_CHECKING:
    from support.probe import Probe

pytestmark = pytest.mark.motion

TURN_RAD_S = 0.8
"""Yaw rate of the checks, rad/s: with a wheel base of 0.23 m each wheel runs at 0.09 m/s."""
STILL = 4
"""Number of counts by which a resting wheel may still move."""
MOVED = 25
EXPIRY_S = 0.25
RAMP_S = 0.5
"""Maximum time from the speed of the checks to rest, s. It includes 0.1 s of deceleration at
1 m/s², the motors' lag and the host's pauses."""


def ready(device: Probe, mode: Mode = Mode.VELOCITY) -> None:
    """Clear the stop and enter a driving mode, at rest, with frequent encoders."""
    device.handshake()
    device.refusal(lambda i: SetStreamRate(i, 0x16, 1000))
    device.enter(mode)
    assert device.until(lambda: at_rest(device), 3.0), "the robot moves without a setpoint"


def at_rest(device: Probe, for_us: int = 200_000) -> bool:
    counts = device.counts()
    if not counts or since(counts[0][0], counts[-1][0]) < for_us:
        return False
    last = counts[-1]
    recent = [c for c in counts if since(c[0], last[0]) <= for_us]
    return all(abs(c[1] - last[1]) + abs(c[2] - last[2]) <= STILL for c in recent)


def turning(device: Probe, seconds: float, yaw_rate_rad_s: float = TURN_RAD_S) -> int:
    """Turn on the spot; return the host time of the last setpoint."""
    return device.keep_saying(lambda: device.setpoint(0.0, yaw_rate_rad_s), seconds)


def travel(device: Probe, mark_us: int) -> tuple[int, int]:
    """Return the counts of both wheels since a device stamp."""
    after = [c for c in device.counts() if since(mark_us, c[0]) >= 0]
    return after[-1][1] - after[0][1], after[-1][2] - after[0][2]


def newest_us(device: Probe) -> int:
    return device.counts()[-1][0]


def rested_us(device: Probe) -> int:
    """Return the stamp of the last sample with a moving wheel."""
    counts = device.counts()
    end = counts[-1]
    moving = [c for c in counts if abs(c[1] - end[1]) + abs(c[2] - end[2]) > STILL]
    return moving[-1][0] if moving else counts[0][0]


def host_us(device: Probe, stamp_us: int) -> int:
    """Return the latest host time to which a device stamp can correspond."""
    pings = [p for p in (device.ping() for _ in range(5)) if p is not None]
    best = min(pings, key=lambda p: p.round_trip_us)
    return best.back_us + since(best.replied_us, stamp_us)


def check_rested(device: Probe, after_us: int, limit_s: float) -> None:
    device.listen(limit_s + 0.3)
    assert at_rest(device), "the robot still moves"
    took_s = (host_us(device, rested_us(device)) - after_us) / 1e6
    assert took_s <= limit_s, f"at rest after {took_s:.2f} s, {limit_s:.2f} s allowed"


@pytest.mark.slow
def test_it_follows_a_setpoint(device: Probe) -> None:
    ready(device)
    mark = newest_us(device)
    turning(device, 0.5)
    left, right = travel(device, mark)
    assert right > MOVED, f"counter-clockwise: the right wheel counts up, not {right}"
    assert left < -MOVED, f"counter-clockwise: the left wheel counts down, not {left}"
    assert device.until(lambda: at_rest(device), 2.0)
    mark = newest_us(device)
    device.keep_saying(lambda: device.setpoint(0.08, 0.0), 0.4)
    assert min(travel(device, mark)) > MOVED, "forward: both count up"
    assert device.until(lambda: at_rest(device), 2.0)
    device.keep_saying(lambda: device.setpoint(-0.08, 0.0), 0.4)


@pytest.mark.slow
def test_an_expired_setpoint_ramps_to_rest_and_does_not_latch(device: Probe) -> None:
    """Time requests and telemetry continue, but they do not feed the watchdog."""
    ready(device)
    last_us = turning(device, 0.5)
    check_rested(device, last_us, EXPIRY_S + RAMP_S)
    status = device.status()
    assert (status.mode, status.stop_cause) == (Mode.VELOCITY, StopCause.NONE), "a stop is latched"
    assert status.faults & Fault.SETPOINT_EXPIRED, "the device does not report the expiry"
    mark = newest_us(device)
    turning(device, 0.4, -TURN_RAD_S)
    assert abs(travel(device, mark)[0]) > MOVED, "the robot ignores new setpoints"


def test_a_setpoint_lives_for_its_time_to_live(device: Probe) -> None:
    ready(device)
    assert device.status().setpoint_remaining == 0
    device.setpoint(0.0, 0.0, ttl_ms=240)
    left_ms = device.status().setpoint_remaining
    assert 0 < left_ms <= 240
    device.listen(0.3)
    assert device.status().setpoint_remaining == 0


def test_a_time_to_live_is_clamped(device: Probe) -> None:
    ready(device)
    device.setpoint(0.0, 0.0, ttl_ms=255)
    mark = now_us()
    assert device.status().setpoint_remaining <= 250
    device.until(lambda: now_us() - mark > 270_000, 1.0)
    assert device.status().setpoint_remaining == 0


@pytest.mark.parametrize("advance", [0, -1, -100])
def test_the_counter_must_advance(device: Probe, advance: int) -> None:
    ready(device)
    before = device.counters().stale
    device.setpoint(0.0, 0.0, counter=100)
    mark = newest_us(device)
    counter = (100 + advance) % 256
    device.keep_saying(lambda: device.setpoint(0.0, TURN_RAD_S, counter=counter), 0.3)
    device.listen(0.1)
    assert max(map(abs, travel(device, mark))) <= STILL, "a repeated setpoint moved the robot"
    assert (device.counters().stale - before) % 0x10000 >= 5, "drops not counted as stale"


def test_the_counter_may_skip_and_wrap(device: Probe) -> None:
    ready(device)
    mark = newest_us(device)
    counter = 0
    for _ in range(15):
        counter = (counter + 90) % 256
        device.setpoint(0.0, TURN_RAD_S, counter=counter)
        device.listen(0.02)
    assert travel(device, mark)[1] > MOVED


def test_stale_setpoints_are_dropped(device: Probe) -> None:
    """A late backlog of setpoints moves nothing, because the setpoints have expired."""
    ready(device)
    before = device.counters().stale
    mark = newest_us(device)
    device.keep_saying(lambda: device.setpoint(0.0, TURN_RAD_S, late_us=400_000), 0.3)
    device.listen(0.1)
    assert max(map(abs, travel(device, mark))) <= STILL, "a stale setpoint moved the robot"
    assert (device.counters().stale - before) % 0x10000 >= 5


def test_a_late_setpoint_lives_as_much_shorter(device: Probe) -> None:
    ready(device)
    for _ in range(5):
        device.ping()  # the device measures the shortest delay
    device.setpoint(0.0, 0.0, ttl_ms=200, late_us=150_000)
    device.listen(0.1)
    assert device.status().setpoint_remaining == 0, "the delay does not count"


@pytest.mark.parametrize("mode", [Mode.IDLE])
def test_setpoints_of_another_mode_move_nothing(device: Probe, mode: Mode) -> None:
    ready(device)
    assert device.refusal(lambda i: SetMode(i, mode)) is None
    mark = newest_us(device)
    turning(device, 0.3)
    assert max(map(abs, travel(device, mark))) <= STILL


@pytest.mark.slow
def test_a_stop_ends_it(device: Probe) -> None:
    ready(device)
    turning(device, 0.4)
    stop_us = now_us()
    device.stop()
    mark = len(device.received)
    turning(device, 0.2)  # the device obeys no setpoint after the stop
    assert mark
    check_rested(device, stop_us, RAMP_S)
    assert device.status().stop_cause == StopCause.OPERATOR
    here = newest_us(device)
    turning(device, 0.3)
    assert max(map(abs, travel(device, here))) <= STILL, "the robot moves with a stop latched"


@pytest.mark.slow
def test_a_stop_to_all_ends_it(device: Probe) -> None:
    ready(device)
    turning(device, 0.4, -TURN_RAD_S)
    stop_us = device.send(Stop(device.next_id(), StopCause.OPERATOR), node=0)
    check_rested(device, stop_us, RAMP_S)


@pytest.mark.slow
def test_a_silent_host_ends_it_and_latches(device: Probe) -> None:
    ready(device)
    last_us = turning(device, 0.4)
    session, device.session_id = device.session_id, 0
    device.listen(0.8, alive=False)
    assert (host_of_rest(device) - last_us) / 1e6 <= EXPIRY_S + RAMP_S
    device.listen(0.6, alive=False)
    device.session_id = session
    device.handshake()
    assert device.status().stop_cause == StopCause.LINK


def host_of_rest(device: Probe) -> int:
    """Return the host time at which the robot came to rest, from the shortest delay of a frame."""
    lowest = min(since(h.frame.t_us, h.at_us & 0xFFFF_FFFF) for h in device.received)
    return rested_us(device) + lowest


@pytest.mark.slow
def test_another_session_ends_it_and_latches(device: Probe) -> None:
    ready(device)
    turning(device, 0.4)
    gone_us = now_us()
    device.handshake()
    device.refusal(lambda i: SetStreamRate(i, 0x16, 1000))
    device.forget()
    mark = now_us()
    turning(device, 0.3)
    device.listen(0.3)
    assert (host_us(device, rested_us(device)) - gone_us) / 1e6 <= RAMP_S + (mark - gone_us) / 1e6
    status = device.status()
    assert (status.mode, status.stop_cause) == (Mode.IDLE, StopCause.LINK)


def test_the_top_speed_is_never_exceeded(device: Probe) -> None:
    """At a setpoint of ten times the limit, the robot turns as fast as the limit allows."""
    device.handshake()
    device.needs(SetParameter)
    known = {p.name.split()[0]: p for p in every(device)}
    needed = {"max_yaw_rate", "wheel_base", "wheel_diameter", "counts_per_turn"}
    device.needs(needed <= known.keys(), "its parameters do not say how fast it may turn")
    value = {name: value_of(p.kind, p.value) for name, p in known.items()}
    limit = known["max_yaw_rate"]
    allowed = max(value_of(limit.kind, limit.low), 0.6)
    try:
        assert put(device, limit, raw_of(limit.kind, allowed)) is None
        device.refusal(lambda i: SetStreamRate(i, 0x16, 1000))
        device.enter(Mode.VELOCITY)
        device.keep_saying(lambda: device.setpoint(0.0, 6.0), 1.0)
        metres = math.pi * value["wheel_diameter"] / value["counts_per_turn"]
        fastest = max(speeds(device)) * metres * 2 / value["wheel_base"]
        assert fastest == pytest.approx(allowed, rel=0.2), f"{fastest:.2f} rad/s"
    finally:
        put(device, limit, limit.value)


def speeds(device: Probe, over_us: int = 200_000) -> list[float]:
    """Return the right wheel's speeds, counts/s, over each interval of that length."""
    counts = device.counts()
    found = []
    for first in counts:
        later = [c for c in counts if since(first[0], c[0]) >= over_us]
        if later:
            found.append((later[0][2] - first[2]) * 1e6 / since(first[0], later[0][0]))
    return found


def test_a_moving_robot_does_not_reboot(device: Probe) -> None:
    ready(device)
    device.needs(Reboot)
    turning(device, 0.3)
    reason = device.refusal(lambda i: Reboot(i, 0))
    assert reason in {NackReason.OTHER_MODE, NackReason.FAULT, NackReason.UNSUPPORTED}, reason
