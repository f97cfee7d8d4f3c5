"""Parameters: read, set within their ranges, saved, and restored."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from protocol.messages.device import Hello
from protocol.messages.host import GetParameter, Reboot, SaveParameters, SetParameter
from protocol.messages.values import (
    NackReason,
    ParameterFlag,
    ParameterKind,
    RebootKind,
    ResetCause,
)
from support.probe_parameters import every, get, other_value, put, restore, value_of, writable

if TYPE_CHECKING:
    from protocol.messages.device import ParameterValue
    from support.probe import Probe

REBOOT_S = 15.0
"""Maximum time from the acknowledgement to the first hello, s."""


def one_to_set(device: Probe) -> ParameterValue:
    found = writable(every(device))
    device.needs(bool(found), "no parameter can be set")
    return found[0]


def reboot(device: Probe, kind: int) -> Hello:
    """Reboot the device and repeat the handshake; return the first hello without a session."""
    before = device.hello
    assert before is not None
    reason: NackReason | None = None
    for _ in range(30):
        reason = device.refusal(lambda i: Reboot(i, kind))
        if reason is not NackReason.FAULT:  # the robot is still stopping after the previous check
            break
        device.listen(0.1)
    device.needs(reason is not NackReason.UNSUPPORTED, f"no {RebootKind(kind).name.lower()}")
    assert reason is None, f"rejected: {reason}"
    device.session_id = 0
    mark = len(device.received)
    found = device.wait_for(
        Hello, REBOOT_S, mark=mark, such=lambda h: h.boot_id != before.boot_id, alive=False
    )
    assert found is not None, f"no hello of a new boot within {REBOOT_S} s"
    device.link.forget_sequence()
    device.handshake()
    assert isinstance(found.message, Hello)
    return found.message


def test_the_list_is_whole(device: Probe) -> None:
    device.handshake()
    found = every(device)
    assert [p.parameter for p in found] == list(range(found[0].parameter_count))
    names = [p.name.partition(" ")[0] for p in found]
    assert len(set(names)) == len(names), "two parameters of one name"
    for p in found:
        assert p.name.partition(" ")[2], f"{p.name!r} is not a name, a space and a unit"
        assert p.kind in set(ParameterKind), p.name
        low, high = value_of(p.kind, p.low), value_of(p.kind, p.high)
        for raw in (p.value, p.default):
            assert low <= value_of(p.kind, raw) <= high, f"{p.name}: {value_of(p.kind, raw)}"
        assert p.parameter_count == len(found)


def test_a_value_is_set_and_read_back(device: Probe) -> None:
    device.handshake()
    for parameter in writable(every(device)):
        wanted = other_value(parameter)
        try:
            assert put(device, parameter, wanted) is None, parameter.name
            now = get(device, parameter.parameter)
            assert now.value == wanted, parameter.name
            assert now.flags & ParameterFlag.CHANGED, f"{parameter.name}: not marked as changed"
        finally:
            assert put(device, parameter, parameter.value) is None
        assert get(device, parameter.parameter) == parameter, "not restored"


def test_a_repeated_set_does_not_undo_a_later_one(device: Probe) -> None:
    device.handshake()
    parameter = one_to_set(device)
    first, number, kind = other_value(parameter), parameter.parameter, parameter.kind
    command_id = device.next_id()
    command = SetParameter(command_id, number, kind, first)
    device.reply_to(command)
    assert put(device, parameter, parameter.value) is None
    device.reply_to(command)
    assert get(device, number).value == parameter.value, "the command was executed twice"


def test_out_of_range_values_are_rejected(device: Probe) -> None:
    device.handshake()
    for p in writable(every(device)):
        wrong: list[int] = []
        if p.kind == ParameterKind.F32:
            wrong += [0x7FC0_0000, 0x7F80_0000, 0xFF80_0000]  # not a number, infinities
            wrong.append(p.high + 1 if value_of(p.kind, p.high) >= 0 else p.high - 1)
        else:
            wrong += [raw for raw, end in ((p.low - 1, p.low), (p.high + 1, p.high)) if end]
        for raw in wrong:
            reason = put(device, p, raw & 0xFFFF_FFFF)
            value = value_of(p.kind, raw & 0xFFFF_FFFF)
            assert reason is NackReason.BAD_VALUE, f"{p.name} = {value}: {reason}"
        assert get(device, p.parameter) == p, f"{p.name}: rejected, but changed"
        assert not math.isnan(value_of(p.kind, p.value))


def test_another_kind_is_rejected(device: Probe) -> None:
    device.handshake()
    p = one_to_set(device)
    for kind in set(ParameterKind) - {p.kind}:
        reason = device.refusal(lambda i, k=kind: SetParameter(i, p.parameter, k, p.value))  # type: ignore[misc]  # bound now
        assert reason is NackReason.BAD_VALUE, f"{p.name} as {kind.name}: {reason}"


def test_missing_objects_are_rejected(device: Probe) -> None:
    device.handshake()
    count = every(device)[0].parameter_count
    for number in {count, 255}:

        def read(command_id: int, number: int = number) -> GetParameter:
            return GetParameter(command_id, number)

        def write(command_id: int, number: int = number) -> SetParameter:
            return SetParameter(command_id, number, 0, 0)

        assert device.refusal(read) is NackReason.UNKNOWN_PARAMETER
        assert device.refusal(write) is NackReason.UNKNOWN_PARAMETER


def test_read_only_parameters_do_not_change(device: Probe) -> None:
    device.handshake()
    found = [p for p in every(device) if p.flags & ParameterFlag.READ_ONLY]
    device.needs(bool(found), "every parameter can be set")
    for p in found:
        assert put(device, p, p.value) is NackReason.READ_ONLY, p.name


@pytest.mark.slow
def test_a_reboot_is_a_new_boot(device: Probe) -> None:
    device.handshake()
    device.free()
    before = device.hello
    hello = reboot(device, RebootKind.NORMAL)
    assert before is not None
    assert hello.reset_cause == ResetCause.SOFTWARE
    assert hello.session_id == 0, "a session before the handshake"
    assert hello.boot_id != 0
    assert hello.uid == before.uid
    assert hello.catalogue_hash == before.catalogue_hash
    status = device.status()
    assert (status.mode, status.stop_cause) == (0, 1), "not idle with session_end latched"


@pytest.mark.slow
def test_saved_values_survive_a_reboot_and_others_do_not(device: Probe) -> None:
    device.handshake()
    found = writable(every(device))
    device.needs(len(found) > 1, "fewer than two parameters can be set")
    saved, unsaved = sorted(found, key=needs_reboot)[:2]
    wanted = other_value(saved)
    try:
        assert put(device, saved, wanted) is None
        assert device.refusal(SaveParameters) is None
        kept = get(device, saved.parameter)
        assert kept.flags & ParameterFlag.STORED, "saved, but not marked as stored"
        assert not kept.flags & ParameterFlag.CHANGED
        assert put(device, unsaved, other_value(unsaved)) is None
        reboot(device, RebootKind.NORMAL)
        assert get(device, saved.parameter).value == wanted, "a saved value is lost"
        assert get(device, unsaved.parameter).value == unsaved.value, "unsaved value kept"
    finally:
        restore_and_reboot(device, found)


@pytest.mark.slow
def test_a_factory_reset_erases_saved_values(device: Probe) -> None:
    """The check always restores and saves the device's own values."""
    device.handshake()
    found = writable(every(device))
    device.needs(bool(found), "no parameter can be set")
    try:
        assert put(device, found[0], other_value(found[0])) is None
        assert device.refusal(SaveParameters) is None
        reboot(device, RebootKind.FACTORY_RESET)
        for parameter in writable(every(device)):
            assert parameter.value == parameter.default, f"{parameter.name} is kept"
    finally:
        restore_and_reboot(device, found)


def needs_reboot(parameter: ParameterValue) -> bool:
    return bool(parameter.flags & ParameterFlag.NEEDS_REBOOT)


def restore_and_reboot(device: Probe, found: list[ParameterValue]) -> None:
    """Restore the device's own values, save them, and reboot if a value needs it."""
    device.handshake()
    restore(device, found)
    if any(needs_reboot(p) for p in found):
        reboot(device, RebootKind.NORMAL)
    assert [p.value for p in writable(every(device))] == [p.value for p in found]
