"""Self-protection of the device: safe state, encoder signs, reflexes, crash record, saving."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from bridge.motion.robot_model import RobotModel
from protocol.can.link import CanLink
from protocol.messages.device import Ack, Hello, Imu, LogText, Nack
from protocol.messages.host import SaveParameters, SetParameter, VelocitySetpoint, WheelDuty
from protocol.messages.values import (
    Fault,
    Mode,
    NackReason,
    ParameterKind,
    ResetCause,
    StopCause,
    fault_labels,
)
from sim_device.device.parameters import table
from sim_device.device.signs import Signs
from sim_device.faults.kinds import parse_fault
from sim_device.rig import Rig
from sim_device.sweeper import VirtualSweeper
from support.ends import OPEN_FLOOR, REST_M_S
from support.sim_body import box, room
from support.wire_host import WireHost

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.floor_plan.floor_plan import FloorPlan

pytestmark = pytest.mark.usefixtures("target")

NUMBERS = {p.name: i for i, p in enumerate(table(RobotModel(), 1))}
SIGNS = Fault.ENCODER_LEFT_REVERSED | Fault.ENCODER_RIGHT_REVERSED | Fault.ENCODERS_SWAPPED
RAMP_S = 0.1
"""Maximum additional time beyond v/a in which |duty| falls to zero, s."""


class LoneDevice(WireHost[VirtualSweeper]):
    """A device that is driven by setpoints. It records the duties in each control period."""

    def __init__(
        self, plan: FloorPlan = OPEN_FLOOR, noise: str = "typical", mode: Mode = Mode.VELOCITY
    ) -> None:
        super().__init__(VirtualSweeper(plan, seed=3, noise=noise))
        self.counter = 0
        self.duties: list[tuple[float, float]] = []
        self.each_step = self._note
        self.join()
        assert self.clear() is None
        assert self.choose(mode) is None

    def _note(self) -> None:
        self.duties.append(self.device.duties)

    def drive(self, duration_s: float, v_m_s: float = 0.2, yaw_rad_s: float = 0.0) -> None:
        for _ in range(round(duration_s * 50)):
            self.setpoint(v_m_s, yaw_rad_s)
            self.run(0.02)

    def setpoint(self, v_m_s: float, yaw_rad_s: float = 0.0) -> None:
        self.counter += 1
        v, yaw = round(v_m_s * 1e4), round(yaw_rad_s * 5e3)
        self.send(VelocitySetpoint(v, yaw, 200, self.counter & 0xFF))

    def duty(self, duration_s: float, left: float, right: float) -> None:
        """Send duties of bring-up mode."""
        for _ in range(round(duration_s * 50)):
            self.counter += 1
            steps = round(left * 1e4), round(right * 1e4)
            self.send(WheelDuty(*steps, 200, self.counter & 0xFF))
            self.run(0.02)

    def set_bool(self, name: str, *, on: bool) -> None:
        kind = ParameterKind.U32
        self._id += 1
        answers = self.send(SetParameter(self._id, NUMBERS[name], kind, int(on)))
        assert any(isinstance(m, Ack) for m in answers)

    @property
    def faults(self) -> Fault:
        return self.device.firmware.faults

    def drivers(self) -> bool:
        return self.device.drivers

    def cause(self) -> StopCause:
        return self.device.firmware.latch.cause

    def standing(self) -> bool:
        truth = self.device.truth
        return abs(truth.v_m_s) < REST_M_S and abs(truth.yaw_rate_rad_s) < REST_M_S


# ---- the safe state -----------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["expiry", "stop", "silence"])
@pytest.mark.parametrize(("v_m_s", "yaw_rad_s"), [(0.3, 0.0), (-0.2, 0.0), (0.0, 1.5), (0.1, 1.0)])
@pytest.mark.parametrize("fault", ["", "encoder_reversed_left", "encoders_swapped"])
def test_duties_only_fall_once_no_speed_is_requested(
    ending: str, v_m_s: float, yaw_rad_s: float, fault: str
) -> None:
    """Encoders fail as braking begins. The duties must fall whatever the encoders report."""
    bench = LoneDevice(noise="none")
    bench.drive(1.0, v_m_s, yaw_rad_s)
    if ending == "stop":
        bench.stop()
    else:
        bench.run(0.19)  # the last setpoint has a time to live of 0.2 s and is 20 ms old
        bench.alive = ending == "expiry"
    if fault:
        setattr(bench.device.sensors.faults, fault, True)
    bench.duties.clear()
    bench.run(1.5)
    fastest_m_s = abs(v_m_s) + abs(yaw_rad_s) * 0.115
    for wheel in (0, 1):
        sizes = [abs(d[wheel]) for d in bench.duties]
        assert all(after <= before for before, after in pairwise(sizes)), "a duty rose"
        zero_s = 0.01 * next(i for i, size in enumerate(sizes) if size == 0.0)
        assert zero_s <= fastest_m_s + RAMP_S + 0.02, (
            "the limit is v/a + 0.1 s after braking begins"
        )
    assert bench.standing()


def test_an_expiry_brakes_and_does_not_latch() -> None:
    bench = LoneDevice()
    bench.drive(1.0)
    bench.run(1.5)
    assert bench.standing()
    assert bench.faults & Fault.SETPOINT_EXPIRED
    assert bench.cause() is StopCause.NONE
    assert bench.drivers(), "the drivers brake, and a setpoint may arrive"
    bench.drive(0.5)
    assert not bench.standing()


@pytest.mark.python_only("reads the integrators")
def test_a_fresh_setpoint_starts_from_zero_integrators() -> None:
    bench = LoneDevice(room((1.0, 1.0, 0.0), walls=box(0.0, 0.0, 2.0, 2.0)))
    bench.drive(6.0, 0.1)  # the robot pushes the wall, so the integrators saturate
    wheels = bench.device.firmware.control.wheels
    assert wheels.left.integral != 0.0
    bench.run(0.3)
    assert wheels.left.integral == wheels.right.integral == 0.0


def test_drivers_are_off_at_rest_in_idle_and_after_a_stop() -> None:
    device = VirtualSweeper(OPEN_FLOOR, seed=3)
    host = WireHost(device)
    host.join()
    host.run(0.5)
    assert not device.drivers, "the drivers are off after a boot"
    assert host.status.faults & Fault.DRIVERS_OFF
    assert fault_labels(host.status.faults) == []
    bench = LoneDevice()
    bench.drive(1.0)
    assert bench.drivers()
    bench.stop()
    assert bench.run(1.0, bench.standing)
    bench.run(0.4)
    assert bench.drivers(), "the drivers brake for 0.5 s"
    bench.run(0.5)
    assert not bench.drivers()
    assert bench.clear(StopCause.OPERATOR) is None
    assert not bench.drivers(), "the latch is cleared, but the mode is idle"
    assert bench.choose(Mode.VELOCITY) is None
    bench.run(0.02)
    assert bench.drivers()
    bench.drive(0.5)
    assert bench.choose(Mode.IDLE) is None
    bench.run(0.02)
    assert bench.drivers(), "a moving robot brakes first"
    bench.run(1.0)
    assert not bench.drivers()


# ---- the signs of the encoders ------------------------------------------------------------

MOTIONS = [(0.2, 0.0), (-0.2, 0.0), (0.0, 1.0), (0.1, 0.6)]


@pytest.mark.parametrize(("v_m_s", "yaw_rad_s"), MOTIONS)
@pytest.mark.parametrize(
    ("fault", "bit"),
    [
        (("encoder_reversed_left",), Fault.ENCODER_LEFT_REVERSED),
        (("encoder_reversed_right",), Fault.ENCODER_RIGHT_REVERSED),
        (("encoders_swapped",), Fault.ENCODERS_SWAPPED),
    ],
)
def test_a_miswired_encoder_ends_at_rest_with_its_name(
    fault: tuple[str, ...], bit: Fault, v_m_s: float, yaw_rad_s: float
) -> None:
    bench = LoneDevice(noise="harsh")
    for name in fault:
        setattr(bench.device.sensors.faults, name, True)
    start = bench.device.truth.pose
    bench.drive(6.0, v_m_s, yaw_rad_s)
    if bit is Fault.ENCODERS_SWAPPED and yaw_rad_s == 0.0 and bench.cause() is StopCause.NONE:
        return  # straight ahead, swapped encoders show no difference and do no harm
    assert bench.cause() is StopCause.HARDWARE
    assert bench.faults & SIGNS == bit
    assert bench.standing()
    assert not bench.drivers()
    label = (bit.name or "").lower()
    assert f"fault: {label}" in ", ".join(bench.lines())
    assert "stopped by itself: encoder" in bench.lines()
    moved_m = start.distance_m(bench.device.truth.pose)
    # With swapped encoders, the robot drives straight ahead until the wheels differ.
    straight = bit is Fault.ENCODERS_SWAPPED and yaw_rad_s == 0.0
    assert moved_m < (0.6 if straight else 0.35), "the robot stops soon"
    assert bench.clear(StopCause.HARDWARE) is NackReason.FAULT, "the fault persists"


def test_both_reversed_are_both_named() -> None:
    bench = LoneDevice()
    faults = bench.device.sensors.faults
    faults.encoder_reversed_left = faults.encoder_reversed_right = True
    bench.drive(3.0)
    assert bench.faults & SIGNS == Fault.ENCODER_LEFT_REVERSED | Fault.ENCODER_RIGHT_REVERSED
    assert bench.cause() is StopCause.HARDWARE


@pytest.mark.parametrize(
    ("fault", "bit"),
    [
        ("encoder_reversed_left", Fault.ENCODER_LEFT_REVERSED),
        ("encoders_swapped", Fault.ENCODERS_SWAPPED),
    ],
)
def test_bring_up_shows_the_fault_and_that_it_is_mended(fault: str, bit: Fault) -> None:
    """In bring-up mode the device does not stop, because a person stands beside the robot."""
    bench = LoneDevice(mode=Mode.BRINGUP)
    setattr(bench.device.sensors.faults, fault, True)
    bench.duty(1.0, 0.35, 0.0)
    assert bench.faults & SIGNS == bit
    assert bench.cause() is StopCause.NONE
    setattr(bench.device.sensors.faults, fault, False)
    bench.duty(1.0, 0.35, 0.0)
    assert not bench.faults & SIGNS


@pytest.mark.parametrize("noise", ["none", "harsh"])
def test_a_sound_robot_is_never_reported_as_miswired(noise: str) -> None:
    """The robot reverses and turns at its acceleration limits, and pushes a wall."""
    bench = LoneDevice(room((1.0, 1.0, 0.0), walls=box(0.0, 0.0, 2.0, 2.0)), noise)
    for _ in range(6):
        bench.drive(0.5, 0.3, 0.0)
        bench.drive(0.5, -0.3, 0.0)
        bench.drive(0.3, 0.0, 2.0)
        bench.drive(0.3, 0.0, -2.0)
        bench.drive(0.3, 0.15, -1.5)
    bench.drive(4.0, 0.2, 0.0)
    assert not bench.faults & SIGNS
    assert bench.cause() is StopCause.NONE


def _turned(speeds: list[float]) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    for speed in speeds:
        yield (0.5, 0.5), (speed, 0.2)


def test_a_short_contradiction_is_ignored() -> None:
    signs = Signs()
    for duties, speeds in _turned([0.2] * 10 + [-0.1] * 24 + [0.2] + [-0.1] * 24):
        signs.tick(duties, speeds)
    assert signs.bits == 0
    for duties, speeds in _turned([-0.1] * 25):
        signs.tick(duties, speeds)
    assert signs.bits == Fault.ENCODER_LEFT_REVERSED


# ---- reflexes -----------------------------------------------------------------------------

EDGE = replace(
    room((1.0, 1.0, 0.0), walls=box(0.0, 0.0, 4.0, 2.0)), cliffs=(box(1.6, 0.0, 4.0, 2.0),)
)
"""A room in which the floor ends 0.6 m ahead of the robot's centre."""
WALL = room((1.0, 1.0, 0.0), walls=box(0.0, 0.0, 1.5, 2.0))


def over(bench: LoneDevice) -> float:
    """Return the distance of the foremost cliff sensor beyond the edge of the floor, m."""
    return bench.device.truth.pose.x_m + 0.15 - 1.6


def test_at_a_cliff_the_robot_only_reverses_and_turns() -> None:
    bench = LoneDevice(EDGE, "none")
    bench.drive(4.0)
    # The host keeps sending setpoints ahead, so the device stops by itself after a second.
    assert over(bench) < 0.05
    assert bench.cause() is StopCause.HARDWARE
    assert "stopped by itself: no floor ahead" in bench.lines()
    assert bench.clear(StopCause.HARDWARE) is None, "the robot may reverse"
    assert bench.choose(Mode.VELOCITY) is None
    heading = bench.device.truth.heading_rad
    bench.drive(0.5, 0.0, 1.0)
    assert bench.device.truth.heading_rad - heading > 0.2, "the robot may turn"
    bench.drive(0.5, 0.0, -1.0)
    bench.drive(2.0, -0.1)
    assert over(bench) < -0.1
    assert bench.cause() is StopCause.NONE


@pytest.mark.parametrize("mode", [Mode.VELOCITY, Mode.BRINGUP])
def test_the_limit_is_seen_at_once(mode: Mode) -> None:
    bench = LoneDevice(EDGE, "none", mode)
    if mode is Mode.BRINGUP:
        bench.duty(3.0, 0.4, 0.4)
        assert not bench.faults & Fault.LIMITED, "bring-up mode has no reflexes"
        return
    bench.setpoint(0.2)
    seen: list[bool] = []

    def look() -> bool:
        bench.setpoint(0.2)
        if bench.device.sensors.cliff():
            seen.append(bool(bench.faults & Fault.LIMITED))
        return len(seen) > 3

    assert bench.run(6.0, look)
    assert seen[1:] == [True] * len(seen[1:]), "set from the next control period on"
    assert bench.cause() is StopCause.NONE, "a reflex does not latch"


def test_a_cliff_is_no_reason_to_latch_for_a_host_that_reverses() -> None:
    bench = LoneDevice(EDGE, "none")
    for _ in range(4):
        assert bench.run(0.0) is False
        while not bench.device.sensors.cliff():
            bench.drive(0.02, 0.28)
        bench.drive(0.08, 0.28)  # the host's latency
        bench.drive(1.6, -0.1)
        assert over(bench) < 0.0
    assert bench.cause() is StopCause.NONE


@pytest.mark.parametrize("on", [True, False])
def test_reflexes_are_parameters(on: bool) -> None:  # noqa: FBT001 - the columns of a table
    bench = LoneDevice(EDGE, "none")
    bench.set_bool("cliff_reflex", on=on)
    bench.drive(3.0)
    assert (over(bench) < 0.05) is on
    bench = LoneDevice(WALL, "none")
    bench.set_bool("bumper_reflex", on=on)
    bench.drive(2.5)
    assert bool(bench.faults & Fault.LIMITED) is on


def test_with_a_bumper_pressed_it_creeps_and_turns() -> None:
    bench = LoneDevice(OPEN_FLOOR, "none")
    bench.drive(0.5)
    bench.device.sensors.faults.bumper_stuck_left = True
    bench.drive(1.0, 0.2, 0.5)
    truth = bench.device.truth
    assert truth.v_m_s == pytest.approx(0.05, abs=0.01)
    assert truth.yaw_rate_rad_s == pytest.approx(0.5, abs=0.05)
    assert bench.faults & Fault.LIMITED
    bench.drive(1.0, -0.2, 0.0)
    assert bench.device.truth.v_m_s == pytest.approx(-0.2, abs=0.02)
    assert not bench.faults & Fault.LIMITED, "reversing is not limited"
    assert not bench.faults & Fault.BUMPER
    bench.drive(10.0, 0.02, 0.3)
    assert bench.faults & Fault.BUMPER, "the switch is closed for 10 s without an obstacle"
    bench.device.sensors.faults.bumper_stuck_left = False
    bench.drive(0.2, 0.0)
    assert not bench.faults & Fault.BUMPER


def test_a_wall_that_presses_a_bumper_is_no_fault() -> None:
    bench = LoneDevice(WALL)
    bench.drive(3.0, 0.2)
    bench.drive(14.0, 0.02)
    assert not bench.faults & Fault.BUMPER


@pytest.mark.parametrize("noise", ["typical", "harsh"])
@pytest.mark.parametrize("seed", range(4))
def test_a_cliff_is_not_reported_as_lifted(noise: str, seed: int) -> None:
    """Vibration and accelerometer bias do not count as a jolt."""
    bench = LoneDevice(EDGE, noise)
    del seed
    for _ in range(5):
        bench.drive(1.2, 0.28)
        assert not bench.faults & Fault.LIFTED
        bench.drive(2.5, -0.15)
    assert bench.cause() is StopCause.NONE


@pytest.mark.parametrize("noise", ["none", "typical", "harsh"])
def test_being_lifted_is_still_noticed(noise: str) -> None:
    bench = LoneDevice(OPEN_FLOOR, noise)
    bench.drive(2.0)
    faults, plant = bench.device.sensors.faults, bench.device.plant.faults
    faults.lifted = plant.lifted = True
    bench.drive(0.6)
    assert bench.faults & Fault.LIFTED
    assert bench.cause() is StopCause.HARDWARE


# ---- crash, crystal, saves, converters ----------------------------------------------------


def test_a_crash_is_reported_to_the_next_host() -> None:
    bench = LoneDevice()
    bench.drive(1.0)
    bench.device.crash()
    assert not bench.drivers()
    bench.run(1.0)
    bench.received.clear()
    bench.join(0x77)
    bench.run(0.5)
    assert bench.last(Hello).reset_cause == ResetCause.CRASH
    (line,) = [m for m in bench.of(LogText) if m.line.startswith("crash")]
    assert line.line == "crash after 1010 ms: pc 0x08004d2a, lr 0x08004c91, cfsr 0x00010000"
    bench.device.reset(ResetCause.PIN)
    bench.run(1.0)
    bench.received.clear()
    bench.join(0x78)
    bench.run(0.5)
    assert not [m for m in bench.of(LogText) if m.line.startswith("crash")]


def test_without_a_crystal_it_reports_a_fault_and_stays_off_a_can_bus() -> None:
    bench = LoneDevice()
    bench.device.fail_crystal(5_000.0)
    bench.run(1.0)
    bench.join(0x77)
    bench.run(0.5)
    assert bench.status.faults & Fault.CLOCK
    assert "fault: clock" in bench.lines()
    assert bench.last(Hello).reset_cause == ResetCause.CRASH
    device = VirtualSweeper(OPEN_FLOOR, seed=3, link=CanLink)
    assert any(device.step(b"", t) for t in range(0, 2_000_000, 10_000))
    device.fail_crystal(0.0)
    assert not any(device.step(b"", t) for t in range(2_000_000, 5_000_000, 10_000))


@pytest.mark.python_only("wears the pages of the model out")
@pytest.mark.parametrize("worn", [False, True])
def test_a_save_is_acknowledged_if_it_reads_back(worn: bool) -> None:  # noqa: FBT001 - a table
    bench = LoneDevice(mode=Mode.IDLE)
    bench.device.flash.worn = worn
    lines: list[str] = []
    for _ in range(2):
        bench.received.clear()
        bench.send(SaveParameters(0x500))
        bench.run(0.5)
        (reply,) = [m for m in bench.of(Ack) + bench.of(Nack) if m.command_id == 0x500]
        assert isinstance(reply, Nack) is worn, "a repeated command gets the same answer"
        if isinstance(reply, Nack):
            assert reply.reason == NackReason.NOT_SAVED
        lines += bench.lines()
    assert any("not saved" in line for line in lines) is worn


def test_a_stuck_bus_gives_no_samples_and_is_a_fault() -> None:
    bench = LoneDevice()
    bench.drive(2.5)
    bench.device.sensors.faults.i2c_stuck = True
    bench.received.clear()
    bench.drive(1.0)
    assert bench.of(Imu) == []
    assert bench.faults & Fault.IMU
    bench.device.sensors.faults.i2c_stuck = False
    bench.drive(0.5)
    assert not bench.faults & Fault.IMU


@pytest.mark.parametrize("share", [-0.01, 0.0, 0.01])
def test_an_imu_with_its_own_clock(share: float) -> None:
    """A slower IMU sometimes has no new sample; a faster IMU sometimes overwrites a sample."""
    bench = LoneDevice()
    bench.device.sensors.faults.imu_clock = share
    bench.run(1.0)
    bench.received.clear()
    bench.run(10.0)
    assert len(bench.of(Imu)) == pytest.approx(1000 * (1 + min(share, 0.0)), abs=2)
    assert not bench.faults & Fault.IMU


def test_a_frozen_converter_repeats_itself() -> None:
    bench = LoneDevice()
    bench.drive(1.0)
    sensors = bench.device.sensors
    before = sensors.power()
    sensors.faults.adc_frozen = True
    bench.drive(1.0, 0.0, 1.0)
    assert sensors.power() == before
    sensors.faults.adc_frozen = False
    assert sensors.power() != before


def test_the_faults_of_the_emulator_reach_the_device() -> None:
    specs = [
        parse_fault(text)
        for text in (
            "encoder-reversed@0:side=both",
            "encoder-swapped@0",
            "i2c-stuck@0",
            "imu-clock@0:percent=-1",
            "adc-frozen@0",
        )
    ]
    rig = Rig(VirtualSweeper(OPEN_FLOOR, seed=3), faults=specs)
    rig.step(b"", 50_000)
    faults = rig.device.sensors.faults
    assert faults.encoder_reversed_left
    assert faults.encoder_reversed_right
    assert faults.encoders_swapped
    assert faults.i2c_stuck
    assert faults.adc_frozen
    assert math.isclose(faults.imu_clock, -0.01)
