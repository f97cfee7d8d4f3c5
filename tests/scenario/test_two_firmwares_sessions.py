"""Both firmwares in rare cases of random sessions: every command in every state, and faults."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest

from protocol.messages.device import Ack, Nack, ParameterValue, Power, TimeReply
from protocol.messages.host import (
    ClearStop,
    Describe,
    GetParameter,
    HostHello,
    PlannerCommand,
    Reboot,
    SaveParameters,
    SetMode,
    SetParameter,
    SetStreamRate,
    Stop,
    TimeRequest,
    VelocitySetpoint,
    WheelDuty,
)
from protocol.messages.values import (
    Fault,
    Mode,
    OnboardPlanner,
    PlannerAction,
    RebootKind,
    StopCause,
)
from protocol.schema.catalogue import CATALOGUE
from protocol.uart.framing import Frame, UartParser
from support.core_build import script_board
from support.random_scripts import Writer, f32
from support.script_format import Boot, LoseSupply, Readings, Step
from support.scripted_model import compare

if TYPE_CHECKING:
    from protocol.schema.message import Message

pytestmark = pytest.mark.slow

STOPPED, IDLE, VELOCITY, BRINGUP, ONBOARD, RUNNING, PAUSED = range(7)
"""States as numbered in ``modes.h``."""
START = PlannerCommand(0, PlannerAction.START, OnboardPlanner.PAPER)
WAYS: dict[int, list[Message]] = {
    STOPPED: [Stop(0, StopCause.OPERATOR)],
    IDLE: [],
    VELOCITY: [SetMode(0, Mode.VELOCITY)],
    BRINGUP: [SetMode(0, Mode.BRINGUP)],
    ONBOARD: [SetMode(0, Mode.ONBOARD)],
    RUNNING: [SetMode(0, Mode.ONBOARD), START],
    PAUSED: [SetMode(0, Mode.ONBOARD), START, PlannerCommand(0, PlannerAction.PAUSE, 0)],
}
"""Messages that lead from the idle state to each state."""
COMMANDS: list[Message] = [
    *(ClearStop(0, cause) for cause in range(7)),
    *(SetMode(0, mode) for mode in range(5)),
    *(PlannerCommand(0, action, OnboardPlanner.PAPER) for action in range(5)),
    PlannerCommand(0, PlannerAction.START, 9),
    Stop(0, StopCause.SUPERVISE),
    HostHello(0, 99, Boot().boot_id, 1, "another"),
]
LIFTED = Readings(imu=(0, 0, 20_000, 0, 0, 0, 0), contacts=4)


def replaced(message: Message, command_id: int) -> Message:
    """Return the message with a new id, if it has one."""
    if isinstance(message, HostHello):
        return message
    return type(message)(command_id, *tuple(message)[1:])  # type: ignore[call-arg]  # its own


class Numbered(Writer):
    """Gives each command a new id."""

    def __init__(self) -> None:
        super().__init__()
        self._id = 0

    def command(self, message: Message) -> None:
        self._id += 1
        self.inform(replaced(message, self._id))

    def go(self, state: int) -> None:
        """Change from any state, possibly with a latched stop, to this state."""
        self.inform(HostHello(0, 7, Boot().boot_id, 1, "test"))
        self.command(Stop(0, StopCause.OPERATOR))
        for cause in (StopCause.OPERATOR, StopCause.HARDWARE):
            self.command(ClearStop(0, cause))
        for message in WAYS[state]:
            self.command(message)


@pytest.mark.parametrize("state", sorted(WAYS))
def test_every_command_in_every_state(state: int) -> None:
    writer = Numbered()
    reached = []
    for command in COMMANDS:
        writer.go(state)
        reached.append(len(writer.acts))
        writer.command(command)
        writer.wait(20_000)
    reported = compare(writer.acts)
    steps = {len([a for a in writer.acts[:i] if not isinstance(a, Readings)]) for i in reached}
    assert {reported[i - 1].state for i in steps} == {state}


def test_the_graver_of_two_stops_that_coincide_is_latched() -> None:
    causes = [*range(8), 200]
    writer = Numbered()
    expected = []
    for first in causes:
        for second in causes:
            writer.go(IDLE)
            writer.command(Stop(0, first))
            writer.command(Stop(0, second))
            expected.append((len(writer.acts), first, second))
    reported = compare(writer.acts)
    steps = [n for n, act in enumerate(writer.acts, 1) if isinstance(act, Step)]
    for acts, first, second in expected:
        named = [c if 0 < c <= max(StopCause) else StopCause.OPERATOR for c in (first, second)]
        assert reported[steps.index(acts)].stop_cause == max(named), (first, second)


def test_a_strangers_stop_makes_no_setpoint_stale() -> None:
    """The stop of another host has a stamp of another clock.

    The host clears this stop and drives on in its session.
    """
    writer = Writer()
    writer.begin()
    writer.drive(900, 0, 3)
    for first_id, age_us in ((1010, 3_000_000), (1020, -3_000_000)):
        writer.inform(Stop(1, StopCause.OPERATOR), age_us=age_us)
        writer.inform(ClearStop(first_id, StopCause.OPERATOR), SetMode(first_id + 1, Mode.VELOCITY))
        writer.drive(900, 0, 3)
    reported = compare(writer.acts)
    assert (reported[-1].state, reported[-1].stale, reported[-1].setpoint.first) == (
        VELOCITY,
        0,
        900,
    )


@pytest.mark.parametrize("state", sorted(WAYS))
def test_every_command_for_all_devices_is_ignored_in_every_state(state: int) -> None:
    """Exceptions are a stop and a hello: node 0 then addresses this one device."""
    commands = [c for c in COMMANDS if not isinstance(c, Stop | HostHello)]
    commands += [GetParameter(0, SPEED), SetParameter(0, SPEED, 2, NEW), SaveParameters(0)]
    commands += [SetStreamRate(0, 0x13, 0), Reboot(0, RebootKind.NORMAL)]
    writer = Numbered()
    writer.go(state)
    reached = len(writer.acts)
    for i in range(40):
        writer.inform(VelocitySetpoint(900, 0, 200, i), WheelDuty(900, 900, 200, i), node=0)
        if i < len(commands):
            writer.inform(replaced(commands[i], 500 + i), node=0)
        writer.inform(TimeRequest(i), node=0)  # the one of these that keeps the session alive
    reported = compare(writer.acts)[reached - 1 :]
    assert {(t.state, t.parameters[SPEED], t.reboots) for t in reported} == {
        (state, reported[0].parameters[SPEED], 0)
    }
    assert not any(t.setpoint.first or t.duty.first for t in reported)
    parser = UartParser()
    wrote = [f for t in reported for f in parser.feed(t.wrote) if isinstance(f, Frame)]
    answered = {CATALOGUE.by_type[f.type_id].cls for f in wrote}
    assert TimeReply in answered
    assert not answered & {Ack, Nack, ParameterValue}


@pytest.mark.parametrize("state", [VELOCITY, ONBOARD, RUNNING, PAUSED, BRINGUP, IDLE])
def test_every_command_while_it_is_lifted(state: int) -> None:
    """The floor disappears in each state: motion stops, and nothing can start in the air."""
    writer = Numbered()
    for command in COMMANDS:
        writer.read(Readings())
        writer.wait(110_000)
        writer.go(state)
        writer.read(LIFTED)
        writer.wait(150_000)
        writer.command(command)
        writer.command(SetMode(0, Mode.VELOCITY))
        writer.wait(20_000)
    reported = compare(writer.acts)
    assert any(t.faults & Fault.LIFTED for t in reported)
    guarded = state not in {BRINGUP, IDLE}
    assert any(t.stop_cause == StopCause.HARDWARE for t in reported) == guarded


@pytest.mark.parametrize(("current_ma", "fault"), [(1_500, "MOTOR_STALL"), (87, "ENCODER_LEFT")])
def test_a_wheel_that_does_not_turn(current_ma: int, fault: str) -> None:
    writer = Writer()
    writer.read(Readings(motors_ma=(current_ma, 63)))
    writer.begin()
    count = 0
    for i in range(190):
        count += 30
        writer.read(Readings(encoders=(0, count), motors_ma=(current_ma, 63)))
        writer.inform(VelocitySetpoint(2000, 0, 200, i & 0xFF), after_us=20_000)
    reported = compare(writer.acts)
    assert any(t.faults & Fault[fault] for t in reported)
    assert reported[-1].stop_cause == StopCause.HARDWARE


@pytest.mark.parametrize(
    "imu",
    [
        (0, 0, 16384, 0, 0, 0, 3000),  # a rate while the wheels stand
        (0, 0, 9000, 0, 0, 0, 0),  # half a gravity
        (7, 0, 16384, 0, 0, 0, 0),  # repeats
    ],
)
def test_an_implausible_gyro(imu: tuple[int, int, int, int, int, int, int]) -> None:
    """Onboard it stops the plan. With a host it is only reported."""
    writer = Numbered()
    lively = [(i % 3, 0, 16384 + i % 2, 0, 0, 0, i % 4) for i in range(250)]
    for reading in lively:
        writer.read(Readings(imu=reading))
        writer.wait(10_000)
    writer.go(RUNNING)
    writer.read(Readings(imu=imu))
    writer.wait(900_000)
    reported = compare(writer.acts)
    assert reported[-1].faults & Fault.IMU
    assert (reported[-1].state, reported[-1].stop_cause) == (STOPPED, StopCause.HARDWARE)


def test_a_battery_that_runs_empty() -> None:
    writer = Numbered()
    writer.go(VELOCITY)
    for millivolts in (13_000, 12_700, 11_950, 13_100):
        writer.read(Readings(battery_mv=millivolts))
        for _ in range(3):
            writer.wait(400_000)
            writer.inform(Describe(1, 1))
    reported = compare(writer.acts)
    assert any(t.faults & Fault.BATTERY_LOW for t in reported)
    assert reported[-1].stop_cause == StopCause.HARDWARE


def test_a_short_sag_at_a_high_rate_of_the_stream_is_no_empty_battery() -> None:
    writer = Numbered()
    writer.go(VELOCITY)
    writer.inform(SetStreamRate(900, CATALOGUE.by_class[Power].type_id, 1000))
    writer.wait(100_000)
    writer.read(Readings(battery_mv=11_500))
    writer.wait(500_000)
    writer.read(Readings())
    writer.wait(200_000)
    reported = compare(writer.acts)
    assert reported[-1].stop_cause == StopCause.NONE


def test_rangers_that_lie() -> None:
    """The ultrasonic is constant during a drive, or an infrared is constant during a turn."""
    writer = Writer()
    writer.begin()
    left = right = 0
    for i in range(200):
        ahead, turn = (40, 0) if i < 100 else (0, 25)
        left, right = left + ahead - turn, right + ahead + turn
        yaw = turn * 2 * 131 * 2
        writer.read(
            Readings((left, right), (0, 0, 16384, 0, 0, 0, yaw), 703, (811, 1217), i == 150)
        )
        writer.inform(VelocitySetpoint(1500, 0, 200, i & 0xFF), after_us=20_000)
    faults = 0
    for reported in compare(writer.acts):
        faults |= reported.faults
    assert faults & Fault.ULTRASONIC
    assert faults & Fault.INFRARED


def test_an_older_host_leaves_out_last_fields() -> None:
    """Its describe message has announced this; a longer or shorter payload is rejected."""
    writer = Writer()
    writer.begin()
    for type_id, fields in ((0x02, 3), (0x06, 1), (0x09, 2), (0x71, 3), (0x0D, 2)):
        writer.inform(Describe(type_id, fields))
    for payload in (b"\x10\x00", b"\x11\x00\x01", b"\x12", b"\x13\0\1\0\0\0\0\0\0"):
        for type_id in (0x02, 0x06, 0x09, 0x71, 0x0D):
            writer.frame(1, type_id, payload)
            writer.wait(50_000)
    compare(writer.acts)


NAMES = [
    b"\xff\xfe",
    b"\xe2\x82",
    b"\xf0\x9f\xa7\xb9 broom",
    b"\xed\xa0\x80",
    b"a\xc3\xa9\xc3" * 30,
    b"x" * 228,
    b"\xf4\x90\x80\x80",
]


@pytest.mark.parametrize("name", NAMES)
def test_any_name_of_a_host_is_logged_as_utf8(name: bytes) -> None:
    writer = Writer()
    writer.hello(name)
    writer.wait(300_000)
    compare(writer.acts)


# ---- parameters that outlive a boot ------------------------------------------------------

SPEED, NEW = 4, f32(0.25)


def _saved(periods: int, *, again: bool) -> tuple[int, int]:
    """Return the top speed after and before a boot a number of periods into a save."""
    writer = Writer()
    writer.begin()
    writer.inform(SetMode(1, Mode.IDLE))
    if again:
        writer.inform(SetParameter(2, SPEED, 2, f32(0.2)), SaveParameters(3))
        writer.wait(400_000)
    writer.acts.append(LoseSupply(periods))
    writer.inform(SetParameter(4, SPEED, 2, NEW), SaveParameters(5))
    writer.wait(500_000)
    reported = script_board().run(writer.acts)
    return reported[-1].parameters[SPEED], reported[-1].reboots


@pytest.mark.parametrize("again", [False, True])
def test_a_supply_lost_while_saving_leaves_the_old_values_or_the_new(again: bool) -> None:  # noqa: FBT001 - of a test
    old = f32(0.2) if again else f32(0.3)
    found = [_saved(periods, again=again)[0] for periods in range(1, 40)]
    assert set(found) == {old, NEW}
    assert found == sorted(found, key=(old, NEW).index), "once it stands, it stays"


def test_saved_values_survive_a_reboot_but_no_factory_reset() -> None:
    writer = Writer()
    writer.begin()
    writer.inform(SetMode(1, Mode.IDLE))
    writer.inform(SetParameter(2, SPEED, 2, NEW), SetParameter(3, 8, 2, f32(13.0)))
    writer.inform(SaveParameters(4))
    writer.wait(400_000)
    writer.inform(SetParameter(5, 8, 2, f32(14.0)), Reboot(6, RebootKind.NORMAL))
    writer.wait(50_000)
    kept = len(writer.acts)
    writer.reboots = 1
    writer.begin(8)
    writer.inform(SetMode(1, Mode.IDLE), GetParameter(2, SPEED), GetParameter(3, 8))
    writer.inform(Reboot(4, RebootKind.FACTORY_RESET))
    writer.wait(50_000)
    reported = compare(writer.acts)
    after = reported[kept - 2].parameters
    assert (after[SPEED], after[8]) == (NEW, f32(13.0))
    assert reported[-1].parameters == reported[0].parameters
    assert reported[-1].reboots == 2


VELOCITY_SETPOINT, STOP, FLAG_AUTHENTICATED = 0x02, 0x01, 1


def test_a_tagged_frame_is_rejected_without_a_key_except_a_stop() -> None:
    writer = Numbered()
    writer.go(VELOCITY)
    for counter in range(1, 5):
        payload = struct.pack("<hhBB", 2000, 0, 200, counter)
        writer.frame(1, VELOCITY_SETPOINT, payload, FLAG_AUTHENTICATED)
        writer.frame(1, VELOCITY_SETPOINT, payload + bytes(12), FLAG_AUTHENTICATED)
    writer.wait(30_000)
    driven = len([act for act in writer.acts if isinstance(act, Step)])
    writer.frame(1, STOP, struct.pack("<HB", 900, StopCause.HARDWARE), FLAG_AUTHENTICATED)
    writer.wait(30_000)
    reported = compare(writer.acts)
    assert {step.motors for step in reported[:driven]} == {(0, 0)}
    assert reported[-1].stop_cause == StopCause.HARDWARE


@pytest.mark.parametrize("can", [False, True], ids=["uart", "can"])
def test_questions_about_a_hello_cannot_lock_hosts_out(*, can: bool) -> None:
    for fields in range(5):
        writer = Writer(can=can)
        writer.inform(Describe(0x04, fields))
        writer.begin()
        reported = compare(writer.acts, can=can)
        assert reported[-1].negotiated
        assert reported[-1].session_id == 7
