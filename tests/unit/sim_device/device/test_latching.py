"""The firmware stops the robot if setpoints expire, the host is silent or a session ends."""

from __future__ import annotations

import pytest

from protocol.messages.device import LinkCounters, Status
from protocol.messages.host import ClearStop, HostHello, SetMode, Stop, VelocitySetpoint
from protocol.messages.values import Fault, Mode, ResetCause, StopCause
from protocol.schema.catalogue import CATALOGUE
from support.ends import RAMP_US, REST_M_S, sweeper
from support.lone_device import SESSION, LoneDevice, kinds

pytestmark = pytest.mark.usefixtures("target")


def test_it_drives_on_fresh_setpoints_and_stops_when_they_end() -> None:
    bench = LoneDevice()
    bench.free()
    bench.run(1.0, bench.drive)
    assert bench.speed == pytest.approx(0.2, abs=0.02)
    last = bench.now_us
    moving = [0]

    def look() -> None:
        bench.ping()  # heartbeats continue, but must not extend the setpoint
        if bench.speed > REST_M_S:
            moving[0] = bench.now_us

    bench.run(2.0, look)
    assert last < moving[0] <= last + 250_000 + RAMP_US
    assert not bench.firmware.latch.latched, "an expired setpoint does not latch"
    status = [m for _, m in bench.received if isinstance(m, Status)][-1]
    assert status.faults & Fault.SETPOINT_EXPIRED
    bench.run(0.5, bench.drive)
    assert bench.speed > 0.15, "fresh setpoints of the same session are accepted"
    status = [m for _, m in bench.received if isinstance(m, Status)][-1]
    assert not status.faults & Fault.SETPOINT_EXPIRED


def test_a_silent_host_latches_link() -> None:
    bench = LoneDevice()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.run(0.98)
    assert not bench.firmware.latch.latched
    bench.run(0.05)
    assert bench.firmware.latch.cause is StopCause.LINK
    assert not bench.firmware.negotiated
    assert bench.firmware.mode is Mode.IDLE
    assert kinds(bench.run(1.0)) == ["Hello"], "without a host, the device sends hello"


def test_an_orderly_end_stays_one() -> None:
    bench = LoneDevice()
    bench.free()
    bench.send(Stop(9, StopCause.SESSION_END))
    bench.run(2.0)
    assert bench.firmware.latch.cause is StopCause.SESSION_END


def test_a_new_session_finds_it_latched() -> None:
    bench = LoneDevice()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.send(HostHello(CATALOGUE.hash, SESSION + 1, bench.boot_id, 1, "another"))
    assert bench.firmware.latch.cause is StopCause.LINK
    assert bench.firmware.mode is Mode.IDLE
    bench.run(1.0, bench.drive)
    assert bench.speed < REST_M_S


def test_a_hello_of_the_same_session_changes_nothing() -> None:
    bench = LoneDevice()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.join()
    assert not bench.firmware.latch.latched
    assert bench.firmware.mode is Mode.VELOCITY


def test_setpoints_while_latched_or_idle_are_nothing() -> None:
    bench = LoneDevice()
    bench.join()
    bench.run(0.5, bench.drive)
    bench.send(ClearStop(1, StopCause.SESSION_END))
    bench.run(0.5, bench.drive)  # the latch is cleared, but the mode is idle
    bench.send(SetMode(2, Mode.VELOCITY))
    bench.run(0.5, bench.ping)  # velocity mode, but no new setpoint
    assert bench.speed < REST_M_S
    assert bench.device.truth.path_m < 0.001


@pytest.mark.python_only("sets the mode from inside")
def test_the_latch_alone_holds_the_wheels() -> None:
    """The latch alone must stop the wheels, even if a fault handler does nothing else."""
    bench = LoneDevice()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.firmware.latch.latch(StopCause.HARDWARE)
    bench.run(RAMP_US / 1e6, bench.drive)
    assert bench.firmware.mode is Mode.VELOCITY
    assert bench.speed < REST_M_S
    path = bench.device.truth.path_m
    bench.run(0.5, bench.drive)
    assert bench.device.truth.path_m == pytest.approx(path, abs=1e-4)


def test_a_3_s_stall_and_its_burst_move_nothing() -> None:
    bench = LoneDevice()
    bench.free()
    bench.run(1.0, bench.drive)
    stalled: list[tuple[int, int]] = []
    for _ in range(300):
        bench.now_us += 10_000
        bench.device.step(b"", bench.now_us)
        bench.counter += 1
        stalled.append((bench.now_us, bench.counter))
    start = bench.device.truth.path_m
    assert bench.speed < REST_M_S
    for stamp_us, counter in stalled:
        bench.send(VelocitySetpoint(3000, 0, 250, counter & 0xFF), stamp_us=stamp_us)
    bench.run(1.0)
    assert bench.device.truth.path_m == pytest.approx(start, abs=1e-4)
    assert bench.firmware.latch.cause is StopCause.LINK


def test_a_shorter_stall_is_rejected_by_age_alone() -> None:
    """A stall of 0.9 s ends neither session nor mode. Only their age rejects the setpoints."""
    bench = LoneDevice()
    bench.free()
    bench.run(1.0, bench.drive)
    first = bench.now_us
    bench.run(0.9)
    path = bench.device.truth.path_m
    for k in range(30):  # setpoints from the first 0.6 s of the stall
        bench.counter += 1
        bench.send(
            VelocitySetpoint(3000, 0, 250, bench.counter & 0xFF), stamp_us=first + k * 20_000
        )
    bench.run(0.9)
    assert bench.device.truth.path_m == pytest.approx(path, abs=1e-4)
    counters = [m for _, m in bench.received if isinstance(m, LinkCounters)][-1]
    assert counters.stale == 30
    assert not bench.firmware.latch.latched


@pytest.mark.python_only("sets the clock of the chip")
def test_clocks_that_wrap_stop_nothing() -> None:
    """32-bit microsecond clocks wrap after 71.6 minutes. Here both clocks wrap during the drive."""
    device = sweeper()
    device.skip_to((1 << 32) - 1_500_000)
    bench = LoneDevice(device)
    bench.now_us = (1 << 32) - 1_500_000
    bench.free()
    bench.run(3.0, bench.drive)  # the host's stamps wrap too
    assert bench.speed == pytest.approx(0.2, abs=0.02)
    assert not bench.firmware.latch.latched
    counters = [m for _, m in bench.received if isinstance(m, LinkCounters)][-1]
    assert counters.stale == 0


def test_a_reboot_ends_the_session_and_latches() -> None:
    bench = LoneDevice()
    bench.free()
    bench.run(0.5, bench.drive)
    bench.device.reset(ResetCause.SOFTWARE)
    firmware = bench.device.firmware
    assert firmware.latch.cause is StopCause.SESSION_END
    bench.run(1.0, bench.drive)
    assert not firmware.negotiated
    assert bench.speed < REST_M_S
