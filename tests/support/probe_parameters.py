"""Helpers for conformance checks: read and set a device's parameters through a ``Probe``.

They also convert values to and from the 32 bits of a parameter.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from protocol.messages.device import ParameterValue
from protocol.messages.host import GetParameter, SaveParameters, SetParameter
from protocol.messages.values import NackReason, ParameterFlag, ParameterKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from support.probe import Probe


def get(device: Probe, number: int) -> ParameterValue:
    """Read one parameter; its value comes before the acknowledgement."""
    mark = len(device.received)
    reason = device.refusal(lambda i: GetParameter(i, number))
    assert reason is None, f"parameter {number}: {reason}"
    values = [v for v in device.of(ParameterValue, mark) if v.parameter == number]
    assert values, f"parameter {number}: acknowledged without its value"
    return values[-1]


def every(device: Probe) -> list[ParameterValue]:
    """Read all parameters in order. Skip the test if the device has none."""
    device.needs(GetParameter)
    first = device.refusal(lambda i: GetParameter(i, 0))
    without = first in {NackReason.UNKNOWN_COMMAND, NackReason.UNSUPPORTED}
    device.needs(not without, "it has no parameters")
    count = get(device, 0).parameter_count
    return [get(device, number) for number in range(count)]


def put(device: Probe, parameter: ParameterValue, raw: int) -> NackReason | None:
    """Set one parameter; return the reason of a rejection, or None."""
    return device.refusal(lambda i: SetParameter(i, parameter.parameter, parameter.kind, raw))


def restore(device: Probe, own: Sequence[ParameterValue]) -> None:
    """Restore the device's own values and save them, unless the device saves nothing."""
    rejected = [p for p in own if put(device, p, p.value) is not None]
    saved = device.refusal(SaveParameters) in {None, NackReason.UNSUPPORTED}
    lines = "\n".join(f"  {p.name.partition(' ')[0]} = {value_of(p.kind, p.value)}" for p in own)
    assert saved, f"the device's own values were not saved again:\n{lines}"
    assert not rejected, f"the device's own values were not restored:\n{lines}"


def value_of(kind: int, raw: int) -> float:
    """Return the value of 32 bits."""
    match kind:
        case ParameterKind.F32:
            number: float = struct.unpack("<f", struct.pack("<I", raw))[0]
        case _:
            number = raw
    return number


def raw_of(kind: int, value: float) -> int:
    """Return the 32 bits of a value."""
    if kind == ParameterKind.F32:
        raw: int = struct.unpack("<I", struct.pack("<f", value))[0]
        return raw
    return int(value) & 0xFFFF_FFFF


def writable(parameters: list[ParameterValue]) -> list[ParameterValue]:
    """Return the parameters that can be set."""
    return [p for p in parameters if not p.flags & ParameterFlag.READ_ONLY]


def other_value(parameter: ParameterValue) -> int:
    """Return a value in the parameter's range that is neither the present value nor the default."""
    low = value_of(parameter.kind, parameter.low)
    high = value_of(parameter.kind, parameter.high)
    for share in (0.25, 0.3, 0.35):
        raw = raw_of(parameter.kind, low + share * (high - low))
        if raw not in {parameter.value, parameter.default}:
            return raw
    return parameter.high if parameter.value != parameter.high else parameter.low
