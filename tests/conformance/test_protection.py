"""Protection inside the device: motor drivers, encoders, reflexes, clock and crash record.

Some checks need a state that a person or an emulator causes: a bumper held, no floor under the
cliff sensor, an earlier crash. Without that state, the checks report what is missing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from protocol.messages.device import LogText, Range
from protocol.messages.host import ClearStop, SaveParameters, SetMode, SetParameter, SetStreamRate
from protocol.messages.values import (
    Capability,
    Contact,
    Fault,
    Mode,
    NackReason,
    ParameterFlag,
    ResetCause,
    StopCause,
)
from support.probe import now_us, since
from support.probe_parameters import every, get, put, restore, writable

if TYPE_CHECKING:
    from protocol.messages.device import ParameterValue
    from support.probe import Probe

STILL = 4
MOVED = 25
SIGNS = Fault.ENCODER_LEFT_REVERSED | Fault.ENCODER_RIGHT_REVERSED | Fault.ENCODERS_SWAPPED
BUMPERS = Contact.BUMPER_LEFT | Contact.BUMPER_RIGHT
BRAKE_S = 0.5
REST_S = 1.0
"""Maximum time from a slow turn to rest, s, with a status period and the host's pauses."""
CLOCK_S = 4.0
CLOCK_PPM = 3000.0
"""Maximum clock error, ppm. A crystal plus the error of pings stays below it. An internal
oscillator is off by 1 %."""


def ready(device: Probe, mode: Mode = Mode.VELOCITY) -> None:
    """Clear the stop and enter a driving mode, with frequent encoders."""
    device.handshake()
    device.refusal(lambda i: SetStreamRate(i, 0x13, 1000))
    device.enter(mode)
    device.listen(0.3)


def faults(device: Probe) -> Fault:
    return Fault(device.status().faults)


def speed(device: Probe, seconds: float = 0.4) -> float:
    """Return the mean speed of both wheels over the last seconds, counts/s, forward positive."""
    counts = device.counts()
    last = counts[-1]
    first = next(c for c in counts if since(c[0], last[0]) <= seconds * 1e6)
    return 0.5 * (last[1] + last[2] - first[1] - first[2]) * 1e6 / max(1, since(first[0], last[0]))


def contacts(device: Probe) -> Contact:
    found = device.wait_for(Range)
    assert found is not None, "the device sends no range"
    assert isinstance(found.message, Range)
    return Contact(found.message.contacts)


def parameter(device: Probe, name: str) -> ParameterValue:
    device.needs(SetParameter)
    found = [p for p in every(device) if p.name.split()[0] == name]
    device.needs(bool(found), f"it has no parameter {name}")
    return found[0]


@pytest.mark.motion
@pytest.mark.slow
def test_the_drivers_are_disabled_at_rest(device: Probe) -> None:
    """The drivers are disabled in idle, and 0.5 s after a stop has brought the robot to rest."""
    ready(device)
    assert not faults(device) & Fault.DRIVERS_OFF, "disabled in a driving mode"
    device.keep_saying(lambda: device.setpoint(0.0, 0.8), 0.4)
    device.stop()
    assert not faults(device) & Fault.DRIVERS_OFF, "disabled at once, without braking"
    device.listen(REST_S + BRAKE_S)
    assert faults(device) & Fault.DRIVERS_OFF, "the drivers stay enabled after a stop"
    assert device.refusal(lambda i: ClearStop(i, StopCause.OPERATOR)) is None
    assert faults(device) & Fault.DRIVERS_OFF, "the drivers are enabled in idle"
    assert device.refusal(lambda i: SetMode(i, Mode.VELOCITY)) is None
    assert not faults(device) & Fault.DRIVERS_OFF
    assert device.refusal(lambda i: SetMode(i, Mode.IDLE)) is None
    device.listen(REST_S)
    assert faults(device) & Fault.DRIVERS_OFF, "the drivers stay enabled in idle"


@pytest.mark.motion
@pytest.mark.slow
def test_encoders_that_agree_with_their_motors_are_no_fault(device: Probe) -> None:
    """The robot reverses its turn as hard as setpoints allow; the device checks each sign."""
    ready(device)
    for yaw_rad_s in (1.0, -1.0, 1.0, -1.0):
        mark = device.counts()[-1]
        device.keep_saying(lambda y=yaw_rad_s: device.setpoint(0.0, y), 0.6)  # type: ignore[misc]  # bound now
        end = device.counts()[-1]
        assert (end[2] - mark[2]) * yaw_rad_s > 0, "the right wheel counts against the setpoint"
        assert (end[1] - mark[1]) * yaw_rad_s < 0, "the left wheel counts against the setpoint"
        assert not faults(device) & SIGNS, "correct encoders are reported as faulty"
    assert device.status().stop_cause == StopCause.NONE


@pytest.mark.motion
@pytest.mark.slow
def test_at_a_cliff_it_does_not_go_ahead(device: Probe) -> None:
    device.handshake()
    device.needs(Capability.CLIFF)
    device.needs(bool(contacts(device) & Contact.CLIFF), "the cliff sensor sees the floor")
    assert parameter(device, "cliff_reflex").value == 1, "it is off by default"
    ready(device)
    mark = device.counts()[-1]
    device.keep_saying(lambda: device.setpoint(0.1, 0.0), 0.5)
    end = device.counts()[-1]
    assert end[1] + end[2] - mark[1] - mark[2] <= 2 * STILL, "it drives ahead over a cliff"
    status = device.status()
    assert status.faults & Fault.LIMITED, "it does not report that it limits the speed"
    assert status.stop_cause == StopCause.NONE, "the stop latches at once"
    device.keep_saying(lambda: device.setpoint(0.0, 0.8), 0.4)
    turned = device.counts()[-1]
    assert turned[2] - end[2] > MOVED, "the robot does not turn"
    device.keep_saying(lambda: device.setpoint(0.0, -0.8), 0.4)
    device.keep_saying(lambda: device.setpoint(0.1, 0.0), 1.4)
    status = device.status()
    assert status.stop_cause == StopCause.HARDWARE, "no stop after 1 s of setpoints ahead"
    device.free()


@pytest.mark.motion
@pytest.mark.slow
def test_with_a_bumper_pressed_it_creeps(device: Probe) -> None:
    device.handshake()
    device.needs(Capability.BUMPER)
    device.needs(bool(contacts(device) & BUMPERS), "no bumper is held pressed")
    assert parameter(device, "bumper_reflex").value == 1, "it is off by default"
    ready(device)
    device.keep_saying(lambda: device.setpoint(0.1, 0.0), 1.0)
    pressed = speed(device)
    assert device.status().faults & Fault.LIMITED, "it does not report that it limits the speed"
    device.keep_saying(lambda: device.setpoint(-0.1, 0.0), 1.0)
    free = speed(device)
    assert free < 0.0
    assert 0.0 < pressed < -0.7 * free, "more than half the speed of the setpoint"


def test_a_save_is_acknowledged_once_it_stands(device: Probe) -> None:
    device.handshake()
    device.needs(SaveParameters)
    before = writable(every(device))[0]
    raw = before.high if before.value != before.high else before.low
    try:
        assert put(device, before, raw) is None
        reason = device.refusal(SaveParameters)
        device.needs(reason is not NackReason.UNSUPPORTED, "it saves nothing")
        assert reason is None, f"the save was rejected: {reason}"
        stored = get(device, before.parameter).flags & ParameterFlag.STORED
        assert stored, "acknowledged before the value is stored"
    finally:
        restore(device, [before])


@pytest.mark.slow
def test_its_clock_is_a_crystals_or_it_reports_that_it_is_not(device: Probe) -> None:
    device.handshake()
    first = device.ping()
    began_us = now_us()
    device.until(lambda: now_us() - began_us > CLOCK_S * 1e6, CLOCK_S + 1.0)
    last = device.ping()
    assert first is not None
    assert last is not None
    ours_us = 0.5 * (last.sent_us + last.back_us - first.sent_us - first.back_us)
    uncertain_us = 0.5 * (last.round_trip_us + first.round_trip_us)
    theirs_us = since(first.reached_us, last.reached_us)
    apart_us = abs(theirs_us - ours_us) - uncertain_us
    reported = bool(faults(device) & Fault.CLOCK)
    assert reported or apart_us <= CLOCK_PPM * CLOCK_S, f"{apart_us / CLOCK_S:.0f} ppm off"


def test_a_crash_comes_with_its_record(device: Probe) -> None:
    """The log line after the hello has program counter, link register, CFSR and uptime."""
    hello = device.handshake()
    device.needs(hello.reset_cause == ResetCause.CRASH, "its last reset was no crash")
    device.until(lambda: bool(device.of(LogText)), 1.0)
    device.listen(0.5)
    lines = [m.line for m in device.of(LogText) if m.line.startswith("crash")]
    assert lines, "no record of the crash is sent"
    assert all(word in lines[0] for word in ("pc 0x", "lr 0x", "cfsr 0x", " ms")), lines[0]
