"""Parameters, read and written by a host session as bytes; and the parameter store alone."""

from __future__ import annotations

import dataclasses

import pytest

from bridge.motion.robot_model import RobotModel
from bridge.session.states import CommandEnded, Data
from protocol.messages.device import Ack, ParameterValue, Status
from protocol.messages.host import GetParameter, Reboot, SetMode, SetParameter, Stop
from protocol.messages.values import (
    Fault,
    Mode,
    NackReason,
    ParameterFlag,
    ParameterKind,
    RebootKind,
    StopCause,
)
from protocol.parameter_values import from_raw, to_raw
from sim_device.device.parameters import ParameterStore, TableParameter, table
from support.ends import REST_M_S
from support.ready_device import F32, NUMBERS, U32, ReadyDevice, cruise, f32

# ---- the table ----------------------------------------------------------------------------


def test_every_parameter_can_be_listed() -> None:
    ready = ReadyDevice()
    names = []
    for number in range(len(NUMBERS)):
        assert ready.ask(lambda i, n=number: GetParameter(i, n)) is None  # type: ignore[misc]
        value = ready.received(ParameterValue)[-1]
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
    assert ready.ask(lambda i: GetParameter(i, len(NUMBERS))) is NackReason.UNKNOWN_PARAMETER


def test_the_table_holds_the_robots_own_values_within_their_ranges() -> None:
    model = dataclasses.replace(RobotModel(), wheel_base_m=0.25, counts_per_turn=1440)
    for parameter in table(model, 7):
        assert parameter.low <= parameter.default <= parameter.high, parameter.name
    values = {p.name: p.default for p in table(model, 7)}
    assert (values["node"], values["wheel_base"], values["counts_per_turn"]) == (7, 0.25, 1440)


def test_the_value_comes_before_the_acknowledgement() -> None:
    ready = ReadyDevice()
    ready.get("max_speed")
    kinds = [e for e in ready.host.events if isinstance(e, CommandEnded | Data)]
    order = [
        "ack" if isinstance(e, CommandEnded) else "value"
        for e in kinds
        if isinstance(e, CommandEnded) or isinstance(e.received.message, ParameterValue)
    ]
    assert order == ["value", "ack"]


def test_a_repeated_get_gives_the_value_again() -> None:
    """The acknowledgement may arrive although the value was lost."""
    ready = ReadyDevice()
    for _ in range(2):
        ready.send(GetParameter(900, NUMBERS["max_speed"]))
        ready.ends.run(0.05)
    assert len(ready.received(ParameterValue)) == 2


def test_a_repeated_set_is_carried_out_once() -> None:
    ready = ReadyDevice()
    number, first, second = NUMBERS["max_speed"], ready.spare_id(), ready.spare_id()
    ready.send(SetParameter(first, number, F32, f32(0.2)))
    ready.send(SetParameter(second, number, F32, f32(0.1)))
    ready.send(SetParameter(first, number, F32, f32(0.2)))
    ready.ends.run(0.1)
    assert ready.get("max_speed").value == f32(0.1)


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
def test_invalid_values_are_rejected_and_change_nothing(
    name: str, kind: int, raw: int, reason: NackReason
) -> None:
    ready = ReadyDevice()
    assert ready.ask(lambda i: SetParameter(i, NUMBERS[name], kind, raw)) is reason
    value = ready.get(name)
    assert value.value == value.default
    assert not value.flags & ParameterFlag.CHANGED


def test_an_unknown_parameter_cannot_be_set() -> None:
    ready = ReadyDevice()
    assert ready.ask(lambda i: SetParameter(i, 200, F32, 0)) is NackReason.UNKNOWN_PARAMETER


def test_flags_show_the_state_of_a_value() -> None:
    ready = ReadyDevice()
    assert ready.get("max_speed").flags == 0
    assert ready.get("node").flags == ParameterFlag.READ_ONLY
    assert ready.get("wheel_base").flags == ParameterFlag.NEEDS_REBOOT
    ready.set("max_speed", 0.25)
    assert ready.get("max_speed").flags == ParameterFlag.CHANGED
    assert ready.save() is None
    assert ready.get("max_speed").flags == ParameterFlag.STORED
    ready.set("max_speed", 0.3)
    assert ready.get("max_speed").flags == ParameterFlag.CHANGED, "the stored value differs"


def test_parameters_need_a_session() -> None:
    ready = ReadyDevice()
    ready.host.session.close()
    ready.ends.run(1.5)  # the device ends the session
    booted = ready.ends.device.firmware
    assert not booted.negotiated
    ready.send(SetParameter(1, NUMBERS["max_speed"], F32, f32(0.1)))
    ready.ends.run(0.05)
    assert booted.parameters.value("max_speed") == 0.3


# ---- effect -------------------------------------------------------------------------------


def test_a_limit_counts_at_once() -> None:
    ready = ReadyDevice()
    ready.free()
    ready.drive(1.5, cruise)
    assert ready.speed == pytest.approx(0.3, abs=0.02)
    assert ready.set("max_speed", 0.1) is None
    ready.drive(1.5, cruise)
    assert ready.speed == pytest.approx(0.1, abs=0.02)


def test_a_gentler_stop_takes_longer() -> None:
    def stopping_m(deceleration: float) -> float:
        ready = ReadyDevice()
        assert ready.set("stop_deceleration", deceleration) is None
        ready.free()
        ready.drive(2.0, cruise)
        start = ready.ends.device.truth.path_m
        assert ready.ask(lambda i: Stop(i, StopCause.OPERATOR)) is None
        ready.ends.run(2.0)
        assert ready.speed < REST_M_S
        return ready.ends.device.truth.path_m - start

    brisk, gentle = stopping_m(1.0), stopping_m(0.3)
    assert gentle - brisk == pytest.approx(0.09 * (1 / 0.3 - 1) / 2, rel=0.3)


def test_battery_low_uses_the_parameter() -> None:
    ready = ReadyDevice()
    ready.ends.run(0.5)
    assert not ready.ends.device.firmware.faults & Fault.BATTERY_LOW
    assert ready.set("battery_low", 20.0) is None
    ready.ends.run(0.5)
    status = ready.received(Status)[-1]
    assert isinstance(status, Status)
    assert status.faults & Fault.BATTERY_LOW


def test_geometry_counts_from_the_next_boot_on() -> None:
    """A device with doubled wheel diameters drives at half the speed."""
    ready = ReadyDevice()
    assert ready.set("wheel_diameter", 0.13) is None
    assert ready.save() is None
    ready.free()
    ready.drive(1.5, cruise)
    assert ready.speed == pytest.approx(0.3, abs=0.02)
    assert ready.ask(lambda i: Stop(i, StopCause.SESSION_END)) is None
    ready.ends.run(1.0)
    assert ready.reboot() is None
    ready.free()
    ready.drive(1.5, cruise)
    assert ready.speed == pytest.approx(0.15, abs=0.02)


def test_saving_waits_until_it_cannot_drive() -> None:
    ready = ReadyDevice()
    ready.free()
    assert ready.save() is NackReason.OTHER_MODE
    assert ready.ask(lambda i: SetMode(i, Mode.IDLE)) is None
    assert ready.save() is None


# ---- the parameter store alone ------------------------------------------------------------

SOME = (
    TableParameter("signed", "count", F32, -5, -10, 10),
    TableParameter("switch", "bits", U32, 1, 0, 1),
)


def test_signed_and_switched_values() -> None:
    store = ParameterStore(SOME, {})
    assert store.value("signed") == -5
    for value in (-10, 0, 10):
        assert store.set(0, F32, to_raw(F32, value)) is None
        assert store.value("signed") == value
    for value in (-11, 11):
        assert store.set(0, F32, to_raw(F32, value)) is NackReason.BAD_VALUE
    assert store.set(1, U32, 0) is None
    assert store.set(1, U32, 2) is NackReason.BAD_VALUE
    assert store.set(1, F32, 1) is NackReason.BAD_VALUE


def test_a_stored_value_out_of_range_is_ignored() -> None:
    """Such a value can come from another version of the firmware."""
    store = ParameterStore(SOME, {"signed": to_raw(F32, 99), "gone": 1, "switch": 0})
    assert store.value("signed") == -5
    assert store.value("switch") == 0


def test_a_default_is_itself_and_not_its_32_bits() -> None:
    store = ParameterStore(table(RobotModel(), 1), {})
    assert store.applied_to(RobotModel()) == RobotModel()


def test_a_reboot_is_acknowledged_first() -> None:
    ready = ReadyDevice()
    ready.send(Reboot(77, RebootKind.NORMAL))
    ready.ends.run(0.1)
    acks = [d.received.message for d in ready.host.of(Data) if d.received.spec.cls is Ack]
    assert acks[-1] == Ack(77, 0x0E)
