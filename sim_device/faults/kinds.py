"""All kinds of faults by name: the one list that parsing, help and docs come from."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from sim_device.faults.body_kinds import BODY_KINDS
from sim_device.faults.spec import FaultSpec, Number, parse_spec
from sim_device.faults.wire_kinds import WIRE_KINDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_device.faults.spec import FaultKind

KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {kind.name: kind for kind in (*WIRE_KINDS, *BODY_KINDS)}
)


def parse_fault(text: str) -> FaultSpec:
    """Read a fault with its time.

    Raises:
        FaultSpecError: it names no kind, or a time or a value that cannot be.

    """
    return parse_spec(text, KINDS)


def parse_fault_now(text: str) -> FaultSpec:
    """Read a fault that may do without a time: it then begins at once.

    Raises:
        FaultSpecError: as for :func:`parse_fault`.

    """
    return parse_spec(text, KINDS, timed=False)


def as_dict(kind: FaultKind) -> dict[str, Any]:
    """A kind for programs."""
    return {
        "kind": kind.name,
        "meaning": kind.meaning,
        "lasting": kind.lasting,
        "arguments": [
            {
                "name": a.name,
                "meaning": a.meaning,
                "default": a.default,
                **(
                    {"unit": a.unit, "low": a.low, "high": a.high}
                    if isinstance(a, Number)
                    else {"choices": list(a.choices)}
                ),
            }
            for a in kind.arguments
        ],
        "example": kind.example,
    }
