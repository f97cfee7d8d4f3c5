"""Parameters, stream rates, reboot and bring-up, asked for by a real session over bytes."""

from __future__ import annotations

import dataclasses
import struct
from typing import TYPE_CHECKING

import pytest

from bridge.motion.robot_model import RobotModel
from bridge.session_events import Agreed, CommandEnded, Data, State
from protocol.catalogue import CATALOGUE
from protocol.messages import (
    Ack,
    ClearStop,
    GetParameter,
    Hello,
    Imu,
    LinkCounters,
    LogText,
    ParameterValue,
    Power,
    Reboot,
    SaveParameters,
    SetMode,
    SetParameter,
    SetStreamRate,
    Status,
    Stop,
    Sync,
    VelocitySetpoint,
    WheelDuty,
)
from protocol.values import (
    Fault,
    Mode,
    NackReason,
    ParameterFlag,
    ParameterKind,
    RebootKind,
    ResetCause,
    StopCause,
)
from sim_device.device import BOOT_US
from sim_device.parameters import Parameter, ParameterStore, from_raw, table, to_raw
from support.ends import HOST_BOOT_US, RAMP_US, REST_M_S, Ends, SessionEnd, session_end, sweeper

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.message import Message

F32, U32, I32, BOOL = (
    ParameterKind.F32,
    ParameterKind.U32,
    ParameterKind.I32,
    ParameterKind.BOOL,
)
NUMBERS = {p.name: i for i, p in enumerate(table(RobotModel(), 1))}


def f32(value: float) -> int:
    raw: int = struct.unpack("<I", struct.pack("<f", value))[0]
    return raw


class Desk:
    """A session that has agreed with a device, asking for things and waiting for the answer."""

    def __init__(self, seed: int = 1) -> None:
        self.host = session_end()
        self.ends = Ends(self.host, sweeper(seed=seed))
        self.settle()
        self.counter = 0

    def settle(self) -> None:
        assert self.ends.run(4.0, lambda: self.host.session.state is State.READY)

    def ask(self, make: Callable[[int], Message]) -> NackReason | None:
        """Send a command until it is answered; the refusal's reason, or None."""
        session = self.host.session
        type_id = CATALOGUE.by_class[type(make(0))].type_id
        before = len(self.host.of(CommandEnded))
        session.commands.issue(make, type_id, self.ends.host_ns // 1000)
        assert self.ends.run(2.0, lambda: len(self.host.of(CommandEnded)) > before)
        outcome = self.host.of(CommandEnded)[-1].outcome
        assert not outcome.timed_out
        return None if outcome.reason is None else NackReason(outcome.reason)

    def heard(self, kind: type[Message]) -> list[Message]:
        return [d.received.message for d in self.host.of(Data) if d.received.spec.cls is kind]

    def get(self, name: str) -> ParameterValue:
        assert self.ask(lambda i: GetParameter(i, NUMBERS[name])) is None
        value = self.heard(ParameterValue)[-1]
        assert isinstance(value, ParameterValue)
        assert value.parameter == NUMBERS[name]
        return value

    def set(self, name: str, value: float, kind: int = F32) -> NackReason | None:
        raw = f32(value) if kind == F32 else int(value)
        return self.ask(lambda i: SetParameter(i, NUMBERS[name], kind, raw))

    def save(self) -> NackReason | None:
        return self.ask(SaveParameters)

    def reboot(self, kind: int = RebootKind.NORMAL) -> NackReason | None:
        reason = self.ask(lambda i: Reboot(i, kind))
        if reason is None:
            known = len(self.host.of(Agreed))
            assert self.ends.run(4.0, lambda: len(self.host.of(Agreed)) > known)
        return reason

    def rate(self, type_id: int, tenths: int) -> NackReason | None:
        return self.ask(lambda i: SetStreamRate(i, type_id, tenths))

    def count(self, kind: type[Message], duration_s: float) -> int:
        before = len(self.heard(kind))
        self.ends.run(duration_s)
        return len(self.heard(kind)) - before

    def free(self, mode: Mode = Mode.VELOCITY) -> None:
        cause = self.ends.device.firmware.latch.cause
        assert self.ask(lambda i: ClearStop(i, cause)) is None
        assert self.ask(lambda i: SetMode(i, mode)) is None

    def drive(self, duration_s: float, make: Callable[[int], Message]) -> None:
        """Repeat a cyclic message at 50 Hz."""
        for _ in range(round(duration_s * 50)):
            self.counter = (self.counter + 1) & 0xFF
            self.send(make(self.counter))
            self.ends.run(0.02)

    def send(self, message: Message, *, stamp_ns: int | None = None) -> None:
        """Outside of what a session offers: any message, of any age."""
        at_ns = self.ends.host_ns if stamp_ns is None else stamp_ns
        self.host.session.link.send(message, at_ns // 1000, node=1)
        self.ends.to_device.push(self.host.session.data_to_send(), self.ends.now_us)

    @property
    def speed(self) -> float:
        return abs(self.ends.device.truth.v_m_s)


# ---- the table ----------------------------------------------------------------------------


def test_every_parameter_can_be_listed() -> None:
    desk = Desk()
    names = []
    for number in range(len(NUMBERS)):
        assert desk.ask(lambda i, n=number: GetParameter(i, n)) is None  # type: ignore[misc]
        value = desk.heard(ParameterValue)[-1]
        assert isinstance(value, ParameterValue)
        assert (value.parameter, value.parameter_count) == (number, len(NUMBERS))
        assert value.value == value.default
        kind = ParameterKind(value.kind)
        low, at, high = (from_raw(kind, r) for r in (value.low, value.value, value.high))
        assert low <= at <= high
        names.append(value.name)
    assert names[0] == "node id"
    assert "wheel_diameter m" in names
    assert "stop_deceleration m/s2" in names
    assert desk.ask(lambda i: GetParameter(i, len(NUMBERS))) is NackReason.UNKNOWN_PARAMETER


def test_the_table_holds_the_robots_own_values_within_their_ranges() -> None:
    model = dataclasses.replace(RobotModel(), wheel_base_m=0.25, counts_per_turn=1440)
    for parameter in table(model, 7):
        assert parameter.low <= parameter.default <= parameter.high, parameter.name
    values = {p.name: p.default for p in table(model, 7)}
    assert (values["node"], values["wheel_base"], values["counts_per_turn"]) == (7, 0.25, 1440)


def test_the_value_comes_before_the_acknowledgement() -> None:
    desk = Desk()
    desk.get("max_speed")
    kinds = [e for e in desk.host.events if isinstance(e, CommandEnded | Data)]
    order = [
        "ack" if isinstance(e, CommandEnded) else "value"
        for e in kinds
        if isinstance(e, CommandEnded) or isinstance(e.received.message, ParameterValue)
    ]
    assert order == ["value", "ack"]


def test_a_repeated_get_gives_the_value_again() -> None:
    """The acknowledgement may come through where the value was lost."""
    desk = Desk()
    for _ in range(2):
        desk.send(GetParameter(900, NUMBERS["max_speed"]))
        desk.ends.run(0.05)
    assert len(desk.heard(ParameterValue)) == 2


def test_a_repeated_set_is_carried_out_once() -> None:
    desk = Desk()
    number = NUMBERS["max_speed"]
    desk.send(SetParameter(900, number, F32, f32(0.2)))
    desk.send(SetParameter(901, number, F32, f32(0.1)))
    desk.send(SetParameter(900, number, F32, f32(0.2)))
    desk.ends.run(0.1)
    assert desk.get("max_speed").value == f32(0.1)


@pytest.mark.parametrize(
    ("name", "kind", "raw", "reason"),
    [
        ("max_speed", U32, 1, NackReason.BAD_VALUE),
        ("max_speed", F32, f32(2.1), NackReason.BAD_VALUE),
        ("max_speed", F32, f32(-0.1), NackReason.BAD_VALUE),
        ("max_speed", F32, 0x7FC0_0000, NackReason.BAD_VALUE),  # not a number
        ("max_speed", F32, 0x7F80_0000, NackReason.BAD_VALUE),  # infinity
        ("max_speed", 9, f32(0.2), NackReason.BAD_VALUE),
        ("counts_per_turn", U32, 3, NackReason.BAD_VALUE),
        ("node", U32, 2, NackReason.READ_ONLY),
    ],
)
def test_what_cannot_be_set_is_refused_and_changes_nothing(
    name: str, kind: int, raw: int, reason: NackReason
) -> None:
    desk = Desk()
    assert desk.ask(lambda i: SetParameter(i, NUMBERS[name], kind, raw)) is reason
    value = desk.get(name)
    assert value.value == value.default
    assert not value.flags & ParameterFlag.CHANGED


def test_an_unknown_parameter_cannot_be_set() -> None:
    desk = Desk()
    assert desk.ask(lambda i: SetParameter(i, 200, F32, 0)) is NackReason.UNKNOWN_PARAMETER


def test_flags_say_what_has_become_of_a_value() -> None:
    desk = Desk()
    assert desk.get("max_speed").flags == 0
    assert desk.get("node").flags == ParameterFlag.READ_ONLY
    assert desk.get("wheel_base").flags == ParameterFlag.NEEDS_REBOOT
    desk.set("max_speed", 0.25)
    assert desk.get("max_speed").flags == ParameterFlag.CHANGED
    assert desk.save() is None
    assert desk.get("max_speed").flags == ParameterFlag.STORED
    desk.set("max_speed", 0.3)
    assert desk.get("max_speed").flags == ParameterFlag.CHANGED, "the stored one is another"


def test_parameters_need_a_session() -> None:
    desk = Desk()
    desk.host.session.close()
    desk.ends.run(1.5)  # the device gives its host up
    booted = desk.ends.device.firmware
    assert not booted.agreed
    desk.send(SetParameter(1, NUMBERS["max_speed"], F32, f32(0.1)))
    desk.ends.run(0.05)
    assert booted.parameters.value("max_speed") == 0.3


# ---- effect -------------------------------------------------------------------------------


def cruise(counter: int) -> VelocitySetpoint:
    return VelocitySetpoint(3000, 0, 200, counter)


def test_a_limit_counts_at_once() -> None:
    desk = Desk()
    desk.free()
    desk.drive(1.5, cruise)
    assert desk.speed == pytest.approx(0.3, abs=0.02)
    assert desk.set("max_speed", 0.1) is None
    desk.drive(1.5, cruise)
    assert desk.speed == pytest.approx(0.1, abs=0.02)


def test_a_gentler_stop_takes_longer() -> None:
    def stopping_m(deceleration: float) -> float:
        desk = Desk()
        assert desk.set("stop_deceleration", deceleration) is None
        desk.free()
        desk.drive(2.0, cruise)
        start = desk.ends.device.truth.path_m
        assert desk.ask(lambda i: Stop(i, StopCause.OPERATOR)) is None
        desk.ends.run(2.0)
        assert desk.speed < REST_M_S
        return desk.ends.device.truth.path_m - start

    brisk, gentle = stopping_m(1.0), stopping_m(0.3)
    assert gentle - brisk == pytest.approx(0.09 * (1 / 0.3 - 1) / 2, rel=0.3)


def test_battery_low_is_judged_by_the_parameter() -> None:
    desk = Desk()
    desk.ends.run(0.5)
    assert not desk.ends.device.firmware.faults & Fault.BATTERY_LOW
    assert desk.set("battery_low", 20.0) is None
    desk.ends.run(0.5)
    status = desk.heard(Status)[-1]
    assert isinstance(status, Status)
    assert status.faults & Fault.BATTERY_LOW


def test_geometry_counts_from_the_next_boot_on() -> None:
    """A device that takes its wheels for twice as large drives at half the speed."""
    desk = Desk()
    assert desk.set("wheel_diameter", 0.13) is None
    assert desk.save() is None
    desk.free()
    desk.drive(1.5, cruise)
    assert desk.speed == pytest.approx(0.3, abs=0.02)
    assert desk.ask(lambda i: Stop(i, StopCause.SESSION_END)) is None
    desk.ends.run(1.0)
    assert desk.reboot() is None
    desk.free()
    desk.drive(1.5, cruise)
    assert desk.speed == pytest.approx(0.15, abs=0.02)


def test_saving_waits_until_it_cannot_drive() -> None:
    desk = Desk()
    desk.free()
    assert desk.save() is NackReason.OTHER_MODE
    assert desk.ask(lambda i: SetMode(i, Mode.IDLE)) is None
    assert desk.save() is None


# ---- reboot -------------------------------------------------------------------------------


def test_a_reboot_is_acknowledged_then_done_and_agreed_on_again() -> None:
    desk = Desk()
    before = desk.ends.device.firmware.identity
    assert desk.reboot() is None
    first, second = desk.host.of(Agreed)
    assert second.rebooted
    assert second.hello.boot_id not in {0, first.hello.boot_id}
    assert second.hello.reset_cause == ResetCause.SOFTWARE
    assert second.hello.uid == first.hello.uid
    assert desk.ends.device.firmware.latch.cause is StopCause.SESSION_END
    assert desk.ends.device.firmware.identity.boot_id != before.boot_id


def test_boot_ids_follow_the_seed() -> None:
    def ids(seed: int) -> list[int]:
        desk = Desk(seed)
        desk.reboot()
        desk.reboot()
        return [a.hello.boot_id for a in desk.host.of(Agreed)]

    assert ids(3) == ids(3)
    assert len({*ids(3), *ids(4)}) == 6


def test_a_boot_takes_its_time_and_its_clock_begins_anew() -> None:
    desk = Desk()
    desk.ends.run(2.0)
    asked_us = desk.ends.now_us
    known = len(desk.host.events)
    desk.ask(lambda i: Reboot(i, RebootKind.NORMAL))
    desk.ends.run(1.0)
    heard = [
        (event.arrived_ns // 1000 - HOST_BOOT_US, event.received.frame.t_us)
        for event in desk.host.events[known:]
        if isinstance(event, Data)
    ]
    assert not [at for at, _ in heard if asked_us + 40_000 < at < asked_us + BOOT_US]
    anew = [(at, t_us) for at, t_us in heard if at >= asked_us + BOOT_US]
    assert len(anew) > 50
    for at, t_us in anew:
        assert t_us <= at - asked_us - BOOT_US


def test_saved_parameters_survive_a_reboot_and_others_do_not() -> None:
    desk = Desk()
    desk.set("max_speed", 0.25)
    desk.save()
    desk.set("cruise_speed", 0.15)
    desk.reboot()
    assert desk.get("max_speed").value == f32(0.25)
    assert desk.get("max_speed").flags == ParameterFlag.STORED
    assert desk.get("cruise_speed").value == f32(0.20)


def test_a_factory_reset_forgets_them() -> None:
    desk = Desk()
    desk.set("max_speed", 0.25)
    desk.save()
    assert desk.reboot(RebootKind.FACTORY_RESET) is None
    value = desk.get("max_speed")
    assert value.value == value.default == f32(0.3)
    assert value.flags == 0


@pytest.mark.parametrize(
    ("kind", "reason"), [(2, NackReason.UNSUPPORTED), (3, NackReason.BAD_VALUE)]
)
def test_a_boot_that_there_is_not(kind: int, reason: NackReason) -> None:
    desk = Desk()
    firmware = desk.ends.device.firmware
    assert desk.ask(lambda i: Reboot(i, kind)) is reason
    desk.ends.run(1.0)
    assert desk.ends.device.firmware is firmware


def test_a_reboot_is_refused_while_it_drives_or_rolls() -> None:
    desk = Desk()
    desk.free()
    desk.drive(1.0, cruise)
    assert desk.ask(lambda i: Reboot(i, RebootKind.NORMAL)) is NackReason.OTHER_MODE
    desk.send(SetMode(800, Mode.IDLE))
    desk.send(Reboot(801, RebootKind.NORMAL))  # in the same breath: it still rolls
    desk.ends.run(0.1)
    nacks = [d.received.message for d in desk.host.of(Data) if d.received.spec.name == "nack"]
    assert [(m.command_id, m.reason) for m in nacks[-1:]] == [(801, NackReason.FAULT)]  # type: ignore[attr-defined]
    desk.ends.run(1.0)
    assert desk.reboot() is None


# ---- stream rates -------------------------------------------------------------------------

IMU, POWER, SYNC = (CATALOGUE.by_class[c].type_id for c in (Imu, Power, Sync))


@pytest.mark.parametrize(
    ("tenths", "expected"), [(0, 0), (1, 0), (125, 25), (500, 100), (1000, 200), (10_000, 200)]
)
def test_a_stream_comes_at_the_rate_asked_for(tenths: int, expected: int) -> None:
    desk = Desk()
    assert desk.rate(IMU, tenths) is None
    assert desk.count(Imu, 2.0) == pytest.approx(expected, abs=1)


def test_other_streams_keep_theirs() -> None:
    desk = Desk()
    desk.rate(POWER, 0)
    assert desk.count(Imu, 1.0) == pytest.approx(100, abs=1)


def test_rates_end_with_the_session() -> None:
    desk = Desk()
    desk.rate(IMU, 0)
    assert desk.count(Imu, 1.0) == 0
    desk.ends.restart_host(session_end())
    host = desk.ends.host
    assert isinstance(host, SessionEnd)
    desk.host = host
    desk.settle()
    assert desk.count(Imu, 1.0) == pytest.approx(100, abs=1)


def test_a_stream_that_was_off_can_be_had_again() -> None:
    desk = Desk()
    desk.rate(POWER, 0)
    assert desk.count(Power, 1.0) == 0
    assert desk.rate(POWER, 100) is None
    assert desk.count(Power, 1.0) == pytest.approx(10, abs=1)


def test_the_supply_is_looked_after_whoever_listens() -> None:
    desk = Desk()
    desk.rate(POWER, 0)
    desk.set("battery_low", 20.0)
    desk.ends.run(0.5)
    assert desk.ends.device.firmware.faults & Fault.BATTERY_LOW


@pytest.mark.parametrize(
    ("kind", "tenths", "reason"),
    [
        (Hello, 10, NackReason.BAD_VALUE),
        (LogText, 10, NackReason.BAD_VALUE),
        (VelocitySetpoint, 10, NackReason.BAD_VALUE),
        (Imu, 10_001, NackReason.BAD_VALUE),
        (Sync, 0, NackReason.BAD_VALUE),
    ],
)
def test_rates_that_cannot_be(kind: type[Message], tenths: int, reason: NackReason) -> None:
    desk = Desk()
    assert desk.rate(CATALOGUE.by_class[kind].type_id, tenths) is reason


def test_a_type_that_is_nothing_has_no_rate() -> None:
    assert Desk().rate(0x7D, 10) is NackReason.BAD_VALUE


# ---- bring-up -----------------------------------------------------------------------------


def forward(duty: float) -> Callable[[int], WheelDuty]:
    return lambda counter: WheelDuty(round(duty * 1e4), round(duty * 1e4), 200, counter)


def test_bringup_is_refused_while_latched() -> None:
    desk = Desk()
    assert desk.ask(lambda i: SetMode(i, Mode.BRINGUP)) is NackReason.STOP_LATCHED
    desk.drive(0.5, forward(0.3))
    assert desk.ends.device.truth.path_m < 0.001


def test_duties_turn_the_wheels_in_bringup_and_nowhere_else() -> None:
    desk = Desk()
    desk.free(Mode.VELOCITY)
    desk.drive(0.5, forward(0.4))
    assert desk.ends.device.truth.path_m < 0.001
    desk.ask(lambda i: SetMode(i, Mode.BRINGUP))
    desk.drive(0.5, cruise)
    assert desk.ends.device.truth.path_m < 0.001
    desk.drive(1.0, forward(0.4))
    assert desk.speed > 0.05


def test_duties_are_capped() -> None:
    def reached(duty: float) -> float:
        desk = Desk()
        desk.free(Mode.BRINGUP)
        desk.drive(1.5, forward(duty))
        return desk.speed

    assert reached(1.0) == pytest.approx(reached(0.5), rel=1e-3)
    assert reached(0.3) < 0.8 * reached(0.5)


def test_each_wheel_has_its_own_duty() -> None:
    desk = Desk()
    desk.free(Mode.BRINGUP)
    desk.drive(1.0, lambda c: WheelDuty(-3000, 3000, 200, c))
    assert desk.ends.device.truth.yaw_rate_rad_s > 0.3
    assert desk.speed < 0.02


def test_the_motors_are_off_once_the_time_to_live_is_over() -> None:
    desk = Desk()
    desk.free(Mode.BRINGUP)
    desk.drive(1.0, forward(0.4))
    last_us = desk.ends.now_us
    desk.ends.run(1.5)
    assert last_us < desk.ends.moving_us <= last_us + 250_000 + RAMP_US
    status = desk.heard(Status)[-1]
    assert isinstance(status, Status)
    assert status.faults & Fault.SETPOINT_EXPIRED
    assert status.mode == Mode.BRINGUP, "expiry does not latch"
    desk.drive(0.5, forward(0.4))
    assert desk.speed > 0.05


def test_stale_and_repeated_duties_are_refused() -> None:
    desk = Desk()
    desk.free(Mode.BRINGUP)
    long_ago = desk.ends.host_ns - 400_000_000
    desk.send(WheelDuty(4000, 4000, 250, 1))
    desk.ends.run(1.0)
    travelled = desk.ends.device.truth.path_m
    for _ in range(20):
        desk.send(WheelDuty(4000, 4000, 250, 1))  # the counter stands still
        desk.ends.run(0.02)
    for counter in range(2, 12):
        desk.send(WheelDuty(4000, 4000, 250, counter), stamp_ns=long_ago)
        desk.ends.run(0.02)
    assert desk.ends.device.truth.path_m == pytest.approx(travelled, abs=1e-4)
    desk.ends.run(1.0)
    counters = desk.heard(LinkCounters)[-1]
    assert isinstance(counters, LinkCounters)
    assert counters.stale == 30


def test_a_stop_ends_bringup() -> None:
    desk = Desk()
    desk.free(Mode.BRINGUP)
    desk.drive(0.5, forward(0.4))
    assert desk.ask(lambda i: Stop(i, StopCause.OPERATOR)) is None
    stopped_us = desk.ends.now_us
    desk.drive(1.0, forward(0.4))
    assert desk.ends.moving_us <= stopped_us + RAMP_US
    assert desk.ends.device.firmware.mode is Mode.IDLE


def test_a_host_that_falls_silent_ends_bringup() -> None:
    desk = Desk()
    desk.free(Mode.BRINGUP)
    desk.drive(0.5, forward(0.4))
    desk.ends.host_alive = False
    desk.ends.run(1.5)
    assert desk.ends.device.firmware.latch.cause is StopCause.LINK
    assert desk.speed < REST_M_S


# ---- the store by itself ------------------------------------------------------------------

SOME = (
    Parameter("signed", "count", I32, -5, -10, 10),
    Parameter("switch", "bits", BOOL, 1, 0, 1),
)


def test_signed_and_switched_values() -> None:
    store = ParameterStore(SOME, {})
    assert store.value("signed") == -5
    for value in (-10, 0, 10):
        assert store.set(0, I32, to_raw(I32, value)) is None
        assert store.value("signed") == value
    for value in (-11, 11):
        assert store.set(0, I32, to_raw(I32, value)) is NackReason.BAD_VALUE
    assert store.set(1, BOOL, 0) is None
    assert store.set(1, BOOL, 2) is NackReason.BAD_VALUE
    assert store.set(1, U32, 1) is NackReason.BAD_VALUE


def test_what_is_stored_and_no_longer_fits_is_passed_over() -> None:
    """A store written by another version of the firmware."""
    store = ParameterStore(SOME, {"signed": to_raw(I32, 99), "gone": 1, "switch": 0})
    assert store.value("signed") == -5
    assert store.value("switch") == 0


def test_a_default_is_itself_and_not_its_32_bits() -> None:
    store = ParameterStore(table(RobotModel(), 1), {})
    assert store.applied_to(RobotModel()) == RobotModel()


def test_ack_is_what_a_reboot_leaves_behind() -> None:
    desk = Desk()
    desk.send(Reboot(77, RebootKind.NORMAL))
    desk.ends.run(0.1)
    acks = [d.received.message for d in desk.host.of(Data) if d.received.spec.cls is Ack]
    assert acks[-1] == Ack(77, 0x0E)
