"""Reboots that a host session requests, and the data that persists across a reboot."""

from __future__ import annotations

import pytest

from bridge.session.states import Data, SessionReady
from protocol.messages.host import Reboot, SetMode
from protocol.messages.values import (
    Mode,
    NackReason,
    ParameterFlag,
    RebootKind,
    ResetCause,
    StopCause,
)
from sim_device.sweeper import BOOT_US
from support.ends import HOST_BOOT_US
from support.ready_device import ReadyDevice, cruise, f32

pytestmark = pytest.mark.usefixtures("target")


def test_a_reboot_is_acknowledged_then_done_then_the_handshake_repeats() -> None:
    ready = ReadyDevice()
    before = ready.ends.device.firmware.identity
    assert ready.reboot() is None
    first, second = ready.host.of(SessionReady)
    assert second.rebooted
    assert second.hello.boot_id not in {0, first.hello.boot_id}
    assert second.hello.reset_cause == ResetCause.SOFTWARE
    assert second.hello.uid == first.hello.uid
    assert ready.ends.device.firmware.latch.cause is StopCause.SESSION_END
    assert ready.ends.device.firmware.identity.boot_id != before.boot_id


def test_boot_ids_follow_the_seed() -> None:
    def ids(seed: int) -> list[int]:
        ready = ReadyDevice(seed)
        ready.reboot()
        ready.reboot()
        return [a.hello.boot_id for a in ready.host.of(SessionReady)]

    assert ids(3) == ids(3)
    assert len({*ids(3), *ids(4)}) == 6


def test_a_boot_takes_time_and_restarts_the_clock() -> None:
    ready = ReadyDevice()
    ready.ends.run(2.0)
    asked_us = ready.ends.now_us
    known = len(ready.host.events)
    ready.ask(lambda i: Reboot(i, RebootKind.NORMAL))
    ready.ends.run(1.0)
    received = [
        (event.arrived_ns // 1000 - HOST_BOOT_US, event.received.frame.t_us)
        for event in ready.host.events[known:]
        if isinstance(event, Data)
    ]
    assert not [at for at, _ in received if asked_us + 40_000 < at < asked_us + BOOT_US]
    anew = [(at, t_us) for at, t_us in received if at >= asked_us + BOOT_US]
    assert len(anew) > 50
    for at, t_us in anew:
        assert t_us <= at - asked_us - BOOT_US


def test_saved_parameters_survive_a_reboot_and_others_do_not() -> None:
    ready = ReadyDevice()
    ready.set("max_speed", 0.25)
    ready.save()
    ready.set("cruise_speed", 0.15)
    ready.reboot()
    assert ready.get("max_speed").value == f32(0.25)
    assert ready.get("max_speed").flags == ParameterFlag.STORED
    assert ready.get("cruise_speed").value == f32(0.20)


def test_a_factory_reset_erases_them() -> None:
    ready = ReadyDevice()
    ready.set("max_speed", 0.25)
    ready.save()
    assert ready.reboot(RebootKind.FACTORY_RESET) is None
    value = ready.get("max_speed")
    assert value.value == value.default == f32(0.3)
    assert value.flags == 0


@pytest.mark.parametrize("kind", [2, 3])
def test_a_boot_that_there_is_not(kind: int) -> None:
    ready = ReadyDevice()
    firmware = ready.ends.device.firmware
    assert ready.ask(lambda i: Reboot(i, kind)) is NackReason.BAD_VALUE
    ready.ends.run(1.0)
    assert ready.ends.device.firmware is firmware


def test_a_reboot_is_rejected_while_it_drives_or_rolls() -> None:
    ready = ReadyDevice()
    ready.free()
    ready.drive(1.0, cruise)
    assert ready.ask(lambda i: Reboot(i, RebootKind.NORMAL)) is NackReason.OTHER_MODE
    first, second = ready.spare_id(), ready.spare_id()
    ready.send(SetMode(first, Mode.IDLE))
    ready.send(Reboot(second, RebootKind.NORMAL))  # at the same time, while the robot still moves
    ready.ends.run(0.1)
    nacks = [d.received.message for d in ready.host.of(Data) if d.received.spec.name == "nack"]
    assert [(m.command_id, m.reason) for m in nacks[-1:]] == [(second, NackReason.FAULT)]  # type: ignore[attr-defined]
    ready.ends.run(1.0)
    assert ready.reboot() is None
