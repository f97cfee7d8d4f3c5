"""Each fault bit is set by its fault, is cleared afterwards, and is otherwise not set."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.motion.robot_model import RobotModel
from protocol.messages.device import LogText, PlannerState
from protocol.messages.host import SetParameter, VelocitySetpoint, WheelDuty
from protocol.messages.values import (
    Fault,
    Mode,
    NackReason,
    ParameterKind,
    PlannerPhase,
    StopCause,
)
from protocol.parameter_values import to_raw
from sim_device.device.health import STALL_STOP_S
from sim_device.device.modes import DeviceState
from sim_device.device.onboard import AT_REST_US
from sim_device.device.parameters import table
from sim_device.sensors.rangers import Ranges
from sim_device.sweeper import VirtualSweeper
from support.ends import OPEN_FLOOR, REST_M_S
from support.sim_body import box, room
from support.wire_host import WireHost

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan

NUMBERS = {p.name: i for i, p in enumerate(table(RobotModel(), 1))}
BOTH_ENCODERS = Fault.ENCODER_LEFT | Fault.ENCODER_RIGHT


class LoneDevice(WireHost[VirtualSweeper]):
    """A device that is driven by setpoints."""

    def __init__(
        self, plan: FloorPlan = OPEN_FLOOR, noise: str = "typical", mode: Mode = Mode.VELOCITY
    ) -> None:
        super().__init__(VirtualSweeper(plan, seed=3, noise=noise))
        self.counter = 0
        self.join()
        assert self.clear() is None
        assert self.choose(mode) is None

    def drive(self, duration_s: float, v_m_s: float = 0.2, yaw_rad_s: float = 0.0) -> None:
        for _ in range(round(duration_s * 50)):
            self.counter += 1
            self.send(
                VelocitySetpoint(
                    round(v_m_s * 1e4), round(yaw_rad_s * 5e3), 200, self.counter & 0xFF
                )
            )
            self.run(0.02)

    def rest(self, duration_s: float = 1.0) -> None:
        self.drive(duration_s, 0.0)

    @property
    def faults(self) -> Fault:
        return self.device.firmware.faults

    def stopped_by(self, cause: StopCause) -> bool:
        return self.device.firmware.latch.cause is cause

    def standing(self) -> bool:
        return abs(self.device.truth.v_m_s) < REST_M_S

    def reported(self) -> list[str]:
        return [m.line for m in self.of(LogText) if "fault" in m.line or "by itself" in m.line]


@pytest.mark.parametrize("noise", ["none", "paper", "typical", "harsh"])
def test_a_sound_device_has_none(noise: str) -> None:
    """The robot rests, drives, turns in place, runs into a wall, backs off and turns again."""
    plan = room((1.0, 1.0, 0.0), walls=box(0.0, 0.0, 2.4, 2.4))
    bench = LoneDevice(plan, noise)
    for v_m_s, yaw_rad_s, duration_s in (
        (0.0, 0.0, 3.0),
        (0.2, 0.0, 2.0),
        (0.0, 1.0, 7.0),
        (0.15, 0.5, 3.0),
        (0.02, 0.0, 1.0),
        (-0.1, 0.0, 2.0),
        (0.0, -1.0, 3.0),
        (0.0, 0.0, 2.0),
    ):
        bench.drive(duration_s, v_m_s, yaw_rad_s)
    assert bench.reported() == []
    assert bench.stopped_by(StopCause.NONE)


def test_all_are_named_here() -> None:
    """Every bit has a test below or in the named file; ``setpoint_expired``: test_latching.py."""
    assert [f.name for f in Fault] == [
        "IMU",
        "ENCODER_LEFT",
        "ENCODER_RIGHT",
        "ULTRASONIC",
        "INFRARED",
        "MOTOR_STALL",
        "BATTERY_LOW",
        "SETPOINT_EXPIRED",
        "LIFTED",
        "ENCODER_LEFT_REVERSED",  # this and the next two: test_protection.py
        "ENCODER_RIGHT_REVERSED",
        "ENCODERS_SWAPPED",
        "CLOCK",  # test_protection.py, at the crash record
        "BUMPER",
        "LIMITED",  # test_protection.py, at the reflexes
        "DRIVERS_OFF",  # test_protection.py, at the safe state
    ]


# ---- IMU ----------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", ["none", "typical"])
def test_a_frozen_imu(noise: str) -> None:
    bench = LoneDevice(noise=noise)
    bench.rest(2.5)
    bench.drive(1.0)
    bench.device.sensors.faults.imu_frozen = True
    bench.drive(1.5, 0.0, 1.0)
    assert bench.faults & Fault.IMU
    assert bench.stopped_by(StopCause.NONE), "a host may drive the robot without a gyro"
    assert bench.choose(Mode.ONBOARD) is NackReason.FAULT, "the device's planner needs a gyro"
    bench.device.sensors.faults.imu_frozen = False
    bench.drive(0.5, 0.0, 1.0)
    assert not bench.faults & Fault.IMU
    assert bench.reported()[0] == "fault: imu"
    bench.rest(0.5)
    assert bench.reported()[-1] == "fault gone: imu"


@pytest.mark.parametrize(("bias_deg_s", "faulty"), [(15.0, False), (30.0, True), (-30.0, True)])
def test_a_rate_at_rest_beyond_the_data_sheets(bias_deg_s: float, faulty: bool) -> None:  # noqa: FBT001 - a table
    bench = LoneDevice()
    bench.device.sensors.faults.gyro_bias_deg_s = (0.0, 0.0, bias_deg_s)
    bench.rest(1.5)
    assert bool(bench.faults & Fault.IMU) is faulty
    bench.device.sensors.faults.gyro_bias_deg_s = (0.0, 0.0, 0.0)
    bench.rest(0.5)
    assert not bench.faults & Fault.IMU


def test_an_implausible_gravity_sets_the_imu_fault() -> None:
    bench = LoneDevice()
    bench.device.sensors.faults.accel_bias_g = (0.0, 0.0, -0.5)
    bench.rest(2.5)
    assert bench.faults & Fault.IMU


def test_planning_for_itself_it_stops_without_a_gyro() -> None:
    bench = LoneDevice(mode=Mode.IDLE)
    bench.start_plan_again()
    bench.run(AT_REST_US / 1e6 + 2.0)
    assert not bench.standing()
    bench.device.sensors.faults.imu_frozen = True
    assert bench.run(60.0, lambda: bench.device.state is DeviceState.STOPPED)
    bench.run(1.0)
    assert bench.stopped_by(StopCause.HARDWARE)
    assert bench.standing()
    assert PlannerPhase(bench.last(PlannerState).phase) is PlannerPhase.ABORTED
    assert "stopped by itself: no heading" in bench.reported()


# ---- wheels -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("knob", "bit"),
    [("left", Fault.ENCODER_LEFT), ("right", Fault.ENCODER_RIGHT)],
)
def test_an_encoder_that_is_silent(knob: str, bit: Fault) -> None:
    """A wheel without counts has no speed control, so it must not turn."""
    bench = LoneDevice()
    bench.drive(1.0)
    setattr(bench.device.sensors.faults, f"encoder_dropout_{knob}", 1.0)
    bench.drive(2.5)
    assert bench.faults & BOTH_ENCODERS == bit
    assert not bench.faults & Fault.MOTOR_STALL
    assert bench.stopped_by(StopCause.HARDWARE)
    assert bench.standing()
    assert bench.clear(StopCause.HARDWARE) is NackReason.FAULT, "the fault persists"
    setattr(bench.device.sensors.faults, f"encoder_dropout_{knob}", 0.0)
    assert bench.faults & bit, "at rest, new counts are not observed yet"


@pytest.mark.parametrize("knob", ["stuck_left", "stuck_right"])
def test_a_wheel_that_is_stuck(knob: str) -> None:
    bench = LoneDevice()
    bench.drive(1.0)
    setattr(bench.device.plant.faults, knob, True)
    bench.drive(STALL_STOP_S - 0.3)
    assert bench.faults & Fault.MOTOR_STALL
    assert not bench.faults & BOTH_ENCODERS
    assert bench.stopped_by(StopCause.NONE)
    bench.drive(0.8)
    assert bench.stopped_by(StopCause.HARDWARE), "the stop protects the motor"
    bench.run(0.5)
    assert "stopped by itself: motor stalled" in bench.reported()
    assert not bench.faults & Fault.MOTOR_STALL, "at rest no motor stalls"
    setattr(bench.device.plant.faults, knob, False)
    assert bench.clear(StopCause.HARDWARE) is None
    assert bench.choose(Mode.VELOCITY) is None
    bench.drive(2.0)
    assert not bench.standing()
    assert not bench.faults & Fault.MOTOR_STALL


# ---- lifted -------------------------------------------------------------------------------


def lift(bench: LoneDevice, *, up: bool) -> None:
    bench.device.plant.faults.lifted = up
    bench.device.sensors.faults.lifted = up


def test_a_robot_that_is_lifted_stops_its_wheels() -> None:
    bench = LoneDevice()
    bench.drive(1.0)
    lift(bench, up=True)
    bench.drive(1.0)
    assert bench.faults & Fault.LIFTED
    assert bench.stopped_by(StopCause.HARDWARE)
    assert bench.clear(StopCause.HARDWARE) is NackReason.FAULT
    lift(bench, up=False)
    bench.rest(1.0)
    assert not bench.faults & Fault.LIFTED
    assert bench.clear(StopCause.HARDWARE) is None
    assert bench.choose(Mode.VELOCITY) is None
    assert bench.device.truth.left_rad_s == 0.0


def test_lifted_it_is_not_set_off_and_in_bringup_it_is() -> None:
    bench = LoneDevice(mode=Mode.IDLE)
    lift(bench, up=True)
    bench.run(1.0)
    assert bench.faults & Fault.LIFTED
    assert bench.stopped_by(StopCause.NONE), "a robot at rest need not stop"
    assert bench.choose(Mode.VELOCITY) is NackReason.FAULT
    assert bench.choose(Mode.ONBOARD) is NackReason.FAULT
    assert bench.choose(Mode.BRINGUP) is None, "bring-up tests the wheels in the air"
    for k in range(50):
        bench.send(WheelDuty(4000, 4000, 200, k))
        bench.run(0.02)
    assert bench.device.truth.left_rad_s > 1.0
    assert bench.stopped_by(StopCause.NONE)


# ---- rangers ------------------------------------------------------------------------------


def test_an_ultrasonic_that_is_blind() -> None:
    bench = LoneDevice(room((1.0, 1.2, 0.0), walls=box(0.0, 0.0, 2.4, 2.4)))
    bench.device.sensors.faults.ultrasonic_blind = True
    for blow in range(2):
        assert not bench.faults & Fault.ULTRASONIC, blow
        bench.drive(7.0, 0.2)
        bench.drive(2.0, -0.1)
    assert bench.faults & Fault.ULTRASONIC
    assert bench.stopped_by(StopCause.NONE)
    bench.device.sensors.faults.ultrasonic_blind = False
    bench.drive(1.0, -0.1)
    assert not bench.faults & Fault.ULTRASONIC


def test_an_ultrasonic_that_lies() -> None:
    bench = LoneDevice()
    bench.device.sensors.faults.ultrasonic_constant_m = 1.5
    bench.drive(3.5, 0.2)
    assert bench.faults & Fault.ULTRASONIC
    bench.device.sensors.faults.ultrasonic_constant_m = None
    bench.drive(0.5, 0.2)
    assert not bench.faults & Fault.ULTRASONIC


def test_an_infrared_that_is_stuck() -> None:
    bench = LoneDevice()
    sensors = bench.device.sensors
    whole, sensors.ranges = sensors.ranges, lambda: Ranges(None, 0.12, None, 0)  # type: ignore[method-assign]
    bench.rest(1.0)
    assert not bench.faults & Fault.INFRARED, "a wall beside the robot gives the same range"
    bench.drive(2.0, 0.0, 1.0)
    assert bench.faults & Fault.INFRARED
    sensors.ranges = whole  # type: ignore[method-assign]
    bench.drive(0.5, 0.0, 1.0)
    assert not bench.faults & Fault.INFRARED


# ---- battery ------------------------------------------------------------------------------


def set_volts(bench: LoneDevice, name: str, volts: float) -> None:
    raw = to_raw(ParameterKind.F32, volts)
    assert bench.ask(lambda i: SetParameter(i, NUMBERS[name], ParameterKind.F32, raw)) is None


def test_a_battery_that_is_low_is_reported_and_one_that_is_empty_ends_the_drive() -> None:
    bench = LoneDevice()
    bench.drive(1.0)
    set_volts(bench, "battery_low", 20.0)
    bench.drive(1.0)
    assert bench.faults & Fault.BATTERY_LOW
    assert bench.stopped_by(StopCause.NONE)
    set_volts(bench, "battery_empty", 20.0)
    bench.drive(0.7)
    assert bench.stopped_by(StopCause.NONE), "a voltage drop of less than a second is ignored"
    bench.drive(1.0)
    assert bench.stopped_by(StopCause.HARDWARE)
    assert bench.clear(StopCause.HARDWARE) is NackReason.FAULT
    set_volts(bench, "battery_empty", 12.0)
    bench.run(0.5)
    assert bench.clear(StopCause.HARDWARE) is None
    bench.run(0.3)
    assert "stopped by itself: battery empty" in bench.reported()
