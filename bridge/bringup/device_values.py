"""A device's parameters, asked for at a desk."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.errors import DeviceLostError, ParameterError
from bridge.session.parameters import Parameter, closest
from protocol.messages import GetParameter, ParameterValue, SaveParameters, SetParameter
from protocol.values import ParameterKind

if TYPE_CHECKING:
    from bridge.bringup.desk import Desk

_TRIES = 3
"""A value may be lost where its acknowledgement is not."""


def list_parameters(desk: Desk) -> list[Parameter]:
    """Every parameter, by number.

    Raises:
        CommandRejectedError: the device has none.
        DeviceLostError: it did not answer.

    """
    first, count = _parameter(desk, 0)
    return [first, *(_parameter(desk, number)[0] for number in range(1, count))]


def set_parameter(desk: Desk, name: str, value: float) -> Parameter:
    """Change one until the next boot; gives what the device has then.

    Raises:
        ParameterError: no such parameter, or it does not take the value.
        CommandRejectedError: the device refused.
        DeviceLostError: it did not answer.

    """
    known = {p.name: p for p in list_parameters(desk)}
    if name not in known:
        raise ParameterError(closest(name, sorted(known)))
    found = known[name]
    kind = ParameterKind[found.kind.upper()]
    desk.ask(f"set {name}", SetParameter, found.number, kind, found.raw(value))
    return _parameter(desk, found.number)[0]


def save_parameters(desk: Desk) -> None:
    """Make the present values the next boot's.

    Raises:
        CommandRejectedError: the device refused.
        DeviceLostError: it did not answer.

    """
    desk.ask("save parameters", SaveParameters)


def _parameter(desk: Desk, number: int) -> tuple[Parameter, int]:
    """One of them, and how many there are."""
    for _ in range(_TRIES):
        desk.newest.pop(ParameterValue, None)
        desk.ask(f"get parameter {number}", GetParameter, number)
        value = desk.latest(ParameterValue)
        if value is not None and value.parameter == number:
            return Parameter.from_message(value), value.parameter_count
    raise DeviceLostError(f"the device did not tell parameter {number}")
