"""Execution of each command by the firmware, and the reasons for rejections.

The command log handles repeated commands with its stored replies. So every command in this module
is new.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from protocol.messages.device import Sync
from protocol.messages.host import (
    ClearStop,
    GetParameter,
    PlannerCommand,
    Reboot,
    SaveParameters,
    SetKey,
    SetMode,
    SetParameter,
    SetStreamRate,
)
from protocol.messages.values import Mode, NackReason, PlannerAction, RebootKind
from sim_device.device.modes import SET_EVENT, Event

if TYPE_CHECKING:
    from protocol.schema.message import Message, MessageSpec
    from sim_device.device.control import Control
    from sim_device.device.keyring import Keyring
    from sim_device.device.parameters import ParameterStore
    from sim_device.device.streams import Schedule

RATE_MAX = 10_000
"""Maximum rate of a stream, tenths of a hertz, from the declaration of ``set_stream_rate``. A rate
above the control rate means one message per control period."""
SYNC_RATE_MIN = 40
"""Minimum rate of the sync message, tenths of a hertz: 4 Hz. On CAN a receiver can extend a stamp
only within 0.5 s after a sync. At 4 Hz this holds even if one sync is lost."""


class Commanded(Protocol):
    """Interface of the firmware that the commands use."""

    negotiated: bool
    """True if a session is open and schema negotiation is complete."""
    control: Control
    parameters: ParameterStore
    schedule: Schedule
    keyring: Keyring
    reboot_wanted: RebootKind | None

    @property
    def mode(self) -> Mode:
        """The device's mode."""

    @property
    def saving(self) -> bool:
        """True while the flash is written."""

    def begin_save(self) -> None:
        """Start to write the parameters to the flash."""

    def stream_spec(self, type_id: int) -> MessageSpec | None:
        """Return the declaration of a stream that this firmware sends, or None."""


Act = Callable[["Commanded", Any], NackReason | None]


def carry_out(firmware: Commanded, command: Message) -> NackReason | None:
    """Execute the command, or return the reason of the rejection."""
    if not firmware.negotiated:
        return NackReason.NO_SESSION
    act = _ACTS.get(type(command))
    return NackReason.UNKNOWN_COMMAND if act is None else act(firmware, command)


def _clear(firmware: Commanded, command: ClearStop) -> NackReason | None:
    return firmware.control.clear(command.cause)


def _choose(firmware: Commanded, command: SetMode) -> NackReason | None:
    event = SET_EVENT.get(command.mode)
    return NackReason.BAD_VALUE if event is None else firmware.control.fire(event)


def _plan(firmware: Commanded, command: PlannerCommand) -> NackReason | None:
    control = firmware.control
    match command.action:
        case PlannerAction.START:
            return control.start(command.planner)
        case PlannerAction.PAUSE:
            return control.fire(Event.PAUSE)
        case PlannerAction.RESUME:
            return control.fire(Event.RESUME)
        case PlannerAction.ABORT:
            return control.fire(Event.ABORT)
        case _:
            return NackReason.BAD_VALUE


def _get(firmware: Commanded, command: GetParameter) -> NackReason | None:
    known = firmware.parameters.describe(command.parameter) is not None
    return None if known else NackReason.UNKNOWN_PARAMETER


def _set(firmware: Commanded, command: SetParameter) -> NackReason | None:
    reason = firmware.parameters.set(command.parameter, command.kind, command.value)
    if reason is None:
        firmware.control.apply_parameters()
    return reason


def _save(firmware: Commanded, _command: SaveParameters) -> NackReason | None:
    # While the robot drives, only the control loop may use the flash bus.
    if firmware.mode is not Mode.IDLE:
        return NackReason.OTHER_MODE
    firmware.begin_save()
    return None


def _rate(firmware: Commanded, command: SetStreamRate) -> NackReason | None:
    spec = firmware.stream_spec(command.stream_type)
    if spec is None or command.rate > RATE_MAX:
        return NackReason.BAD_VALUE
    if command.stream_type not in firmware.schedule:
        return NackReason.UNSUPPORTED
    if spec.cls is Sync and command.rate < SYNC_RATE_MIN:
        return NackReason.BAD_VALUE
    firmware.schedule.set_rate(command.stream_type, command.rate)
    return None


def _reboot(firmware: Commanded, command: Reboot) -> NackReason | None:
    if command.kind not in {RebootKind.NORMAL, RebootKind.FACTORY_RESET}:
        return NackReason.BAD_VALUE
    if firmware.mode is not Mode.IDLE or firmware.saving:
        return NackReason.OTHER_MODE
    if firmware.control.wheels.moving:
        return NackReason.FAULT
    firmware.reboot_wanted = RebootKind(command.kind)
    return None


def _key(firmware: Commanded, command: SetKey) -> NackReason | None:
    # The flash must not be written while the robot may move.
    if firmware.mode is not Mode.IDLE:
        return NackReason.OTHER_MODE
    return firmware.keyring.change(command)


_ACTS: dict[type[Message], Act] = {
    ClearStop: _clear,
    SetMode: _choose,
    PlannerCommand: _plan,
    GetParameter: _get,
    SetParameter: _set,
    SaveParameters: _save,
    SetStreamRate: _rate,
    Reboot: _reboot,
    SetKey: _key,
}
COMMANDS = tuple(_ACTS)
