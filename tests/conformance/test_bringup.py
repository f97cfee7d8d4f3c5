"""Bring-up mode: the host sets wheel duties directly, limited in size and time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from protocol.messages.host import SetMode, SetStreamRate, WheelDuty
from protocol.messages.values import Mode, NackReason, StopCause
from support.probe import since

if TYPE_CHECKING:
    from support.probe import Probe

pytestmark = pytest.mark.motion

STILL = 4
MOVED = 25
DUTY = 0.3


def ready(device: Probe, mode: Mode = Mode.BRINGUP) -> None:
    device.handshake()
    device.needs(WheelDuty)
    device.refusal(lambda i: SetStreamRate(i, 0x16, 1000))
    device.free()
    reason = device.refusal(lambda i: SetMode(i, mode))
    without = reason in {NackReason.UNSUPPORTED, NackReason.BAD_VALUE}
    device.needs(not without, "it has no bring-up mode")
    assert reason is None
    device.listen(0.3)


def travel(device: Probe, since_us: int) -> tuple[int, int]:
    after = [c for c in device.counts() if since(since_us, c[0]) >= 0]
    return after[-1][1] - after[0][1], after[-1][2] - after[0][2]


def spin(device: Probe, left: float, right: float, seconds: float) -> tuple[int, int]:
    """Hold the duties for some seconds; return the counts of both wheels in that time."""
    mark = device.counts()[-1][0]
    device.keep_saying(lambda: device.duty(left, right), seconds)
    return travel(device, mark)


@pytest.mark.slow
def test_each_duty_turns_its_wheel_in_its_direction(device: Probe) -> None:
    ready(device)
    left, right = spin(device, -DUTY, DUTY, 0.4)
    assert left < -MOVED
    assert right > MOVED
    device.listen(0.6)
    left, right = spin(device, DUTY, -DUTY, 0.4)
    assert left > MOVED
    assert right < -MOVED


@pytest.mark.slow
def test_a_duty_expires_and_does_not_latch(device: Probe) -> None:
    ready(device)
    spin(device, -DUTY, DUTY, 0.3)
    device.listen(0.9)
    mark = device.counts()[-1][0]
    device.listen(0.2)
    assert max(map(abs, travel(device, mark))) <= STILL, "the wheels turn 0.9 s after the last duty"
    status = device.status()
    assert (status.mode, status.stop_cause) == (Mode.BRINGUP, StopCause.NONE)


@pytest.mark.slow
def test_duties_are_capped(device: Probe) -> None:
    """Full and half duty turn a wheel at the same speed."""
    ready(device)
    speeds = []
    for duty in (0.5, 1.0):
        spin(device, -duty, duty, 0.5)
        mark = device.counts()[-1][0]
        device.keep_saying(lambda d=duty: device.duty(-d, d), 0.5)  # type: ignore[misc]  # bound now
        counts = [c for c in device.counts() if since(mark, c[0]) >= 0]
        speeds.append((counts[-1][2] - counts[0][2]) / since(counts[0][0], counts[-1][0]))
        device.listen(0.8)
    assert speeds[0] > 0
    assert speeds[1] < speeds[0] * 1.2, f"twice the duty gives {speeds[1] / speeds[0]:.2f} times"


def test_duties_of_another_mode_move_nothing(device: Probe) -> None:
    ready(device)
    assert device.refusal(lambda i: SetMode(i, Mode.VELOCITY)) is None
    left, right = spin(device, -DUTY, DUTY, 0.3)
    assert max(abs(left), abs(right)) <= STILL, "duties obeyed in velocity mode"
    assert device.refusal(lambda i: SetMode(i, Mode.BRINGUP)) is None
    mark = device.counts()[-1][0]
    device.keep_saying(lambda: device.setpoint(0.0, 0.8), 0.3)
    assert max(map(abs, travel(device, mark))) <= STILL, "setpoints obeyed in bring-up mode"


@pytest.mark.slow
def test_a_stop_ends_it(device: Probe) -> None:
    ready(device)
    spin(device, -DUTY, DUTY, 0.3)
    device.stop()
    device.keep_saying(lambda: device.duty(-DUTY, DUTY), 0.6)
    left, right = spin(device, -DUTY, DUTY, 0.2)
    assert max(abs(left), abs(right)) <= STILL
    status = device.status()
    assert (status.mode, status.stop_cause) == (Mode.IDLE, StopCause.OPERATOR)
