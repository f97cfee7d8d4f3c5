"""What the firmware does with each command, and why it refuses.

Everything here has come through the command log: it is new, and the answer is remembered.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.messages import (
    ClearStop,
    GetParameter,
    PlannerCommand,
    Reboot,
    SaveParameters,
    SetMode,
    SetParameter,
    SetStreamRate,
    Sync,
)
from protocol.values import LogLevel, Mode, NackReason, RebootKind, StopCause, label

if TYPE_CHECKING:
    from protocol.message import Message
    from sim_device.firmware import Firmware

COMMANDS = (
    ClearStop,
    SetMode,
    PlannerCommand,
    GetParameter,
    SetParameter,
    SaveParameters,
    SetStreamRate,
    Reboot,
)
RATE_MAX = 10_000
"""Tenths of a hertz, as declared; what is above the tick's rate is sent at each tick."""
SYNC_RATE_MIN = 40
"""4 Hz: a stamp on CAN can be extended for 0.5 s after a sync, and one may be lost."""


def carry_out(firmware: Firmware, command: Message) -> NackReason | None:  # noqa: PLR0911 - a line each
    """Do it, or give the refusal's reason."""
    if not firmware.agreed:
        return NackReason.NO_SESSION
    match command:
        case ClearStop():
            return _clear(firmware, command)
        case SetMode():
            return _choose(firmware, command)
        case GetParameter():
            known = firmware.parameters.describe(command.parameter) is not None
            return None if known else NackReason.UNKNOWN_PARAMETER
        case SetParameter():
            return _set(firmware, command)
        case SaveParameters():
            return _save(firmware)
        case SetStreamRate():
            return _rate(firmware, command)
        case Reboot():
            return _reboot(firmware, command)
        case PlannerCommand():
            return NackReason.UNSUPPORTED  # no planner on board
        case _:
            return NackReason.UNKNOWN_COMMAND


def _clear(firmware: Firmware, command: ClearStop) -> NackReason | None:
    if not firmware.latch.latched:
        return None
    if not firmware.latch.clear(command.cause):
        return NackReason.OTHER_CAUSE
    firmware.log(LogLevel.INFO, f"stop cleared: {label(StopCause, command.cause)}")
    return None


def _choose(firmware: Firmware, command: SetMode) -> NackReason | None:
    if command.mode == Mode.ONBOARD:
        return NackReason.UNSUPPORTED
    if command.mode not in {Mode.IDLE, Mode.VELOCITY, Mode.BRINGUP}:
        return NackReason.BAD_VALUE
    if command.mode != Mode.IDLE and firmware.latch.latched:
        return NackReason.STOP_LATCHED
    firmware.enter(Mode(command.mode))
    return None


def _set(firmware: Firmware, command: SetParameter) -> NackReason | None:
    reason = firmware.parameters.set(command.parameter, command.kind, command.value)
    if reason is None:
        firmware.apply_parameters()
    return reason


def _save(firmware: Firmware) -> NackReason | None:
    # Erasing flash holds the processor for a quarter of a second: never while it may drive.
    if firmware.mode is not Mode.IDLE:
        return NackReason.OTHER_MODE
    firmware.parameters.save()
    firmware.log(LogLevel.INFO, "parameters saved")
    return None


def _rate(firmware: Firmware, command: SetStreamRate) -> NackReason | None:
    spec = firmware.stream_spec(command.stream_type)
    if spec is None or command.rate > RATE_MAX:
        return NackReason.BAD_VALUE
    if command.stream_type not in firmware.schedule:
        return NackReason.UNSUPPORTED
    if spec.cls is Sync and command.rate < SYNC_RATE_MIN:
        return NackReason.BAD_VALUE
    firmware.schedule.set_rate(command.stream_type, command.rate)
    return None


def _reboot(firmware: Firmware, command: Reboot) -> NackReason | None:
    if command.kind == RebootKind.BOOTLOADER:
        return NackReason.UNSUPPORTED
    if command.kind not in {RebootKind.NORMAL, RebootKind.FACTORY_RESET}:
        return NackReason.BAD_VALUE
    if firmware.mode is not Mode.IDLE:
        return NackReason.OTHER_MODE
    if firmware.wheels.moving:
        return NackReason.FAULT
    firmware.reboot_wanted = RebootKind(command.kind)
    return None
