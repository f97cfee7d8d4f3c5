"""Resets of every cause, watchdog, brown-out, flash memory and the device's clock."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.motion.robot_model import RobotModel
from protocol.messages.device import Ack, Encoders, Hello, Imu, Status, TimeReply
from protocol.messages.host import SaveParameters, SetParameter, TimeRequest, VelocitySetpoint
from protocol.messages.values import Mode, ParameterKind, ResetCause, StopCause
from protocol.parameter_values import to_raw
from sim_device.body.supply import BROWN_OUT_V, SUPPLY_GOOD_V
from sim_device.device.clock import DeviceClock
from sim_device.device.flash import BYTES_PER_MS, ERASE_MS, Flash
from sim_device.device.modes import DeviceState
from sim_device.device.parameters import table
from sim_device.sweeper import (
    BOOT_US,
    WATCHDOG_US,
    VirtualSweeper,
)
from support.ends import RAMP_US, REST_M_S, sweeper
from support.wire_host import WireHost

pytestmark = pytest.mark.usefixtures("target")

F32 = ParameterKind.F32
NUMBERS = {p.name: i for i, p in enumerate(table(RobotModel(), 1))}


def free(mode: Mode = Mode.VELOCITY) -> WireHost[VirtualSweeper]:
    host = WireHost(sweeper())
    host.join()
    assert host.clear() is None
    assert host.choose(mode) is None
    return host


def drive(host: WireHost[VirtualSweeper], duration_s: float) -> None:
    for k in range(round(duration_s * 50)):
        host.send(VelocitySetpoint(2000, 0, 200, k & 0xFF))
        host.run(0.02)


def speed(host: WireHost[VirtualSweeper]) -> float:
    return abs(host.device.truth.v_m_s)


# ---- resets -------------------------------------------------------------------------------


@pytest.mark.parametrize("cause", ResetCause)
@pytest.mark.parametrize("off_s", [0.0, 0.4])
def test_a_reset_of_any_cause(cause: ResetCause, off_s: float) -> None:
    host = free()
    drive(host, 1.0)
    assert speed(host) > 0.15
    before, counts = host.hello, host.last(Encoders)
    assert counts.left > 1000
    reset_us = host.now_us
    host.device.reset(cause, off_s=off_s)
    host.received.clear()
    silent_s = off_s + BOOT_US / 1e6 - 0.02
    host.run(silent_s)
    assert not host.received, "a booting device sends nothing"
    host.run(0.1)
    hello = host.hello
    assert hello.reset_cause == cause
    assert hello.boot_id != before.boot_id
    assert hello.uid == before.uid
    assert hello.session_id == 0
    (at_us, stamp_us, _), *_ = host.received
    assert at_us == pytest.approx(reset_us + off_s * 1e6 + BOOT_US, abs=10_000)
    assert stamp_us < 10_000, "the device's clock restarts at 0"
    host.join()
    host.run(0.5)
    assert (host.status.mode, host.status.stop_cause) == (Mode.IDLE, StopCause.SESSION_END)
    assert speed(host) < REST_M_S, "the outputs are off during the boot"
    assert host.last(Encoders).left < 1000, "the encoder counters restart at 0"


def test_outputs_are_off_at_once() -> None:
    host = free()
    drive(host, 1.0)
    path_m = host.device.truth.path_m
    host.device.reset(ResetCause.PIN)
    host.run(0.29)
    # The robot coasts from 0.2 m/s, with the motors' time constant of 0.05 s and drag.
    assert host.device.truth.path_m - path_m < 0.2 * 0.12


def test_a_reset_during_a_boot_restarts_it() -> None:
    host = WireHost(sweeper())
    host.device.reset(ResetCause.PIN)
    host.run(0.2)
    host.device.reset(ResetCause.SOFTWARE)
    host.received.clear()
    host.run(0.25)
    assert not host.received
    host.run(0.2)
    assert host.hello.reset_cause == ResetCause.SOFTWARE


# ---- watchdog -----------------------------------------------------------------------------


def test_a_firmware_that_hangs_is_reset_by_the_watchdog() -> None:
    host = free()
    drive(host, 1.0)
    hung_us = host.now_us
    path_m = host.device.truth.path_m
    host.device.hang()
    host.received.clear()
    assert host.run(1.0, lambda: host.device.state is DeviceState.BOOT)
    assert host.now_us - hung_us <= WATCHDOG_US + 20_000
    # Until the reset, the motor drivers keep their duty, so the robot drives on without control.
    driven_m = host.device.truth.path_m - path_m
    assert 0.2 * 0.08 < driven_m < 0.2 * 0.13
    assert not host.received
    host.run(0.5)
    assert host.hello.reset_cause == ResetCause.WATCHDOG
    assert speed(host) < REST_M_S


def test_a_firmware_that_lives_is_never_reset() -> None:
    host = free()
    drive(host, 3.0)
    assert host.hello.reset_cause == ResetCause.POWER_ON
    assert host.device.state is DeviceState.VELOCITY


# ---- brown-out ----------------------------------------------------------------------------


class _Rail:
    """A 5 V rail with a voltage that the test sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, host: WireHost[VirtualSweeper]) -> None:
        self.volts = 5.0
        monkeypatch.setattr(
            type(host.device.plant), "rail_5v_v", property(lambda _plant: self.volts)
        )


def test_a_rail_that_falls_switches_it_off_until_it_is_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    host = free()
    rail = _Rail(monkeypatch, host)
    drive(host, 1.0)
    rail.volts = BROWN_OUT_V + 0.05
    drive(host, 0.2)
    assert host.status.mode == Mode.VELOCITY
    rail.volts = BROWN_OUT_V - 0.05
    host.run(0.02)
    assert host.device.state is DeviceState.OFF
    host.received.clear()
    rail.volts = SUPPLY_GOOD_V - 0.05
    host.run(2.0)
    assert host.device.state is DeviceState.OFF, "the device stays off between the thresholds"
    assert speed(host) < REST_M_S
    rail.volts = 5.0
    back_us = host.now_us
    assert host.run(1.0, lambda: host.device.state is DeviceState.STOPPED)
    assert host.now_us - back_us == pytest.approx(BOOT_US, abs=30_000)
    host.run(0.02)
    assert host.hello.reset_cause == ResetCause.BROWN_OUT


def test_a_rail_that_falls_again_while_it_boots(monkeypatch: pytest.MonkeyPatch) -> None:
    host = WireHost(sweeper())
    rail = _Rail(monkeypatch, host)
    host.run(0.1)
    host.received.clear()
    for _ in range(5):
        rail.volts = 3.0
        host.run(0.1)
        assert host.device.state is DeviceState.OFF
        rail.volts = 5.0
        host.run(0.25)
    assert not host.received
    host.run(0.2)
    assert host.device.state is DeviceState.STOPPED


def test_a_flat_battery_switches_it_off_and_a_full_one_on() -> None:
    """The plant's battery model determines the voltage of the rail."""
    host = free()
    drive(host, 1.0)
    host.device.plant.set_charge(0.0)
    assert host.run(5.0, lambda: host.device.state is DeviceState.OFF)
    host.run(5.0)
    assert host.device.state is DeviceState.OFF
    assert speed(host) < REST_M_S
    host.device.plant.set_charge(1.0)
    assert host.run(1.0, lambda: host.device.state is DeviceState.STOPPED)
    host.run(0.02)
    assert host.hello.reset_cause == ResetCause.BROWN_OUT


# ---- parameters in flash ------------------------------------------------------------------


def set_speed(host: WireHost[VirtualSweeper], value: float) -> None:
    raw = to_raw(F32, value)
    answers = host.send(SetParameter(6, NUMBERS["max_speed"], F32, raw))
    assert any(isinstance(m, Ack) for m in answers)


@pytest.mark.python_only("watches the pages of the model")
def test_a_save_is_answered_when_it_is_done_and_not_before() -> None:
    host = WireHost(sweeper())
    host.join()
    set_speed(host, 0.25)
    asked_us = host.now_us
    assert not [m for m in host.send(SaveParameters(7)) if isinstance(m, Ack)]
    host.received.clear()
    assert not host.send(SaveParameters(7)), "a repeated command is not answered during the save"
    assert host.run(1.0, lambda: bool(host.of(Ack)))
    assert ERASE_MS <= (host.now_us - asked_us) / 1000 <= ERASE_MS + 30
    assert host.of(Ack) == [Ack(7, 0x72)]
    assert [m for m in host.send(SaveParameters(7)) if isinstance(m, Ack)], (
        "a repeated command is answered after the save"
    )
    host.device.reset(ResetCause.PIN)
    assert host.device.firmware.parameters.value("max_speed") == pytest.approx(0.25)


@pytest.mark.python_only("watches the pages of the model")
@pytest.mark.parametrize("after_ms", [0, 10, 100, 240, 250])
def test_a_brown_out_during_a_save_keeps_the_old_values(after_ms: int) -> None:
    host = WireHost(sweeper())
    host.join()
    set_speed(host, 0.25)
    host.send(SaveParameters(7))
    host.run(0.4)
    host.send(SetParameter(8, NUMBERS["max_speed"], F32, to_raw(F32, 0.1)))
    host.send(SaveParameters(9))
    host.run(after_ms / 1000)
    done = Ack(9, 0x72) in host.of(Ack)
    host.device.reset(ResetCause.BROWN_OUT, off_s=0.1)
    assert host.device.firmware.parameters.value("max_speed") == pytest.approx(
        0.1 if done else 0.25
    )
    assert not done


images = st.dictionaries(st.text("abcde", min_size=1), st.integers(0, 0xFFFF_FFFF), max_size=6)


@given(images, images, st.integers(0, 400))
def test_flash_holds_the_old_or_the_new_image_after_any_interruption(
    old: dict[str, int], new: dict[str, int], cut_bytes: int
) -> None:
    flash = Flash()
    flash.begin(old)
    while not flash.advance(10):
        pass
    flash.begin(new)
    page = 1
    whole = False
    flash.advance(ERASE_MS)
    for _ in range(cut_bytes // BYTES_PER_MS + 1):
        whole = whole or flash.advance(1)
    flash.power_lost()
    if not whole:
        flash.pages[page] = flash.pages[page][:cut_bytes]
    assert flash.load() == (new if whole else old)
    flash.begin(new)
    while not flash.advance(10):
        pass
    assert flash.load() == new


@given(images, images, st.data())
def test_a_spoilt_page_is_never_read(
    old: dict[str, int], new: dict[str, int], data: st.DataObject
) -> None:
    flash = Flash()
    for image in (old, new):
        flash.begin(image)
        while not flash.advance(50):
            pass
    page = flash.pages[1]
    at = data.draw(st.integers(0, len(page) - 1))
    flip = data.draw(st.integers(1, 255))
    flash.pages[1] = page[:at] + bytes((page[at] ^ flip,)) + page[at + 1 :]
    assert flash.load() == old


def test_saves_alternate_between_the_pages_forever() -> None:
    flash = Flash()
    assert flash.load() == {}
    for k in range(20):
        flash.begin({"k": k})
        while not flash.advance(10):
            pass
        assert flash.load() == {"k": k}
    flash.erase()
    assert flash.load() == {}


# ---- the clock ----------------------------------------------------------------------------


@pytest.mark.parametrize("ppm", [-20_000.0, -200.0, 0.0, 80.0, 20_000.0])
def test_uptime_runs_at_its_own_rate(ppm: float) -> None:
    clock = DeviceClock()
    clock.boot(1_000_000)
    clock.drift_ppm = ppm
    # After 100 s of true time.
    assert clock.uptime_us(101_000_000) == pytest.approx(100e6 * (1 + ppm * 1e-6), abs=1.5)
    for uptime_us in (1, 9_999, 10_000, 123_456_789):
        true_us = clock.true_us(uptime_us)
        assert clock.uptime_us(true_us) == pytest.approx(uptime_us, abs=1.1)
        assert clock.uptime_us(true_us) >= uptime_us - 1


def test_a_change_of_drift_is_no_jump() -> None:
    clock = DeviceClock()
    clock.uptime_us(50_000_000)
    clock.drift_ppm = 1_000.0
    assert clock.uptime_us(50_000_000) == 50_000_000
    assert clock.uptime_us(60_000_000) == 60_010_000


@pytest.mark.parametrize("ppm", [-5_000.0, 5_000.0])
def test_a_drifting_device_keeps_its_periods_by_its_own_clock(ppm: float) -> None:
    host = WireHost(sweeper())
    host.join()
    host.device.clock.drift_ppm = ppm
    host.run(1.0)
    host.received.clear()
    host.run(20.0)
    samples = [(at, t) for at, t, m in host.received if isinstance(m, Encoders)]
    assert len(samples) == pytest.approx(1000 * (1 + ppm * 1e-6), abs=1.5)
    (first, t_first), (last, t_last) = samples[0], samples[-1]
    assert (t_last - t_first) / (last - first) == pytest.approx(1 + ppm * 1e-6, abs=2e-6)
    assert {b - a for (_, a), (_, b) in pairwise(samples)} <= set(range(19_998, 20_003))
    # The plant runs in true time.
    assert host.device.plant.tick_ms == pytest.approx(host.now_us / 1000, abs=11)


@pytest.mark.parametrize("ppm", [-20_000.0, 20_000.0])
def test_a_setpoint_expires_after_its_time_to_live_of_the_devices_clock(ppm: float) -> None:
    host = free()
    host.device.clock.drift_ppm = ppm
    drive(host, 1.0)
    host.received.clear()
    host.run(0.5)
    ends = next(at for at, _, m in host.received if isinstance(m, Status) and m.faults)
    last_us = host.now_us - 500_000 - 20_000
    # The limits allow for the time to live of 200 ms, clock drift and a status period.
    assert 150_000 < ends - last_us < 200_000 * (1 - ppm * 1e-6) + 120_000
    assert host.run(1.0, lambda: speed(host) < REST_M_S)
    assert host.now_us - last_us < 200_000 + RAMP_US + 520_000


@pytest.mark.python_only("the chip has one counter")
def test_stamps_jump_and_deadlines_do_not() -> None:
    host = free()
    drive(host, 1.0)
    host.send(VelocitySetpoint(2000, 0, 200, 200))
    last_us = host.now_us
    host.device.clock.jump_us(-10_000_000)  # a longer jump than the uptime
    moving_us = 0

    def look() -> None:
        nonlocal moving_us
        if speed(host) > REST_M_S:
            moving_us = host.now_us

    host.each_step = look
    host.received.clear()
    host.run(2.0)
    assert last_us < moving_us <= last_us + 200_000 + RAMP_US, (
        "the jump of 10 s does not delay the expiry"
    )
    stamps = [t for _, t, m in host.received if isinstance(m, Imu)]
    assert stamps
    assert all((t + 10_000_000) % 2**32 <= host.now_us for t in stamps)
    replies = [m for m in host.send(TimeRequest(1)) if isinstance(m, TimeReply)]
    assert [(m.received_us + 10_000_000) % 2**32 for m in replies] == [host.now_us]


def test_a_jump_ends_with_the_boot_and_a_drift_does_not() -> None:
    host = WireHost(sweeper())
    host.device.clock.jump_us(5_000_000)
    host.device.clock.drift_ppm = 100.0
    host.device.reset(ResetCause.PIN)
    host.run(0.5)
    assert host.device.clock.offset_us == 0
    assert host.device.clock.drift_ppm == 100.0
    stamps = [t for _, t, m in host.received if isinstance(m, Hello)]
    assert stamps[-1] < 10_000
