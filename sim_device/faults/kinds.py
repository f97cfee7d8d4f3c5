"""All kinds of faults by name; parser, help and documentation use this list.

Plug-ins can add kinds. Each entry point of the group ``sweepctl.faults`` is a :class:`FaultKind`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import sweepctl_plugins
from sim_device.faults.body_kinds import BODY_KINDS
from sim_device.faults.spec import FaultKind, FaultSpec, FaultSpecError, Number, parse_spec
from sim_device.faults.wire_kinds import WIRE_KINDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_device.faults.knobs import Knobs
    from sim_device.faults.spec import Value

OWN_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {kind.name: kind for kind in (*WIRE_KINDS, *BODY_KINDS)}
)
"""The project's own kinds by name, as listed in the documentation."""


def _plugged() -> dict[str, FaultKind]:
    """Return the valid kinds of plug-ins."""
    found: dict[str, FaultKind] = {}
    for plugin, kind in sweepctl_plugins.usable("faults"):
        wrong = _wrong(kind, {**OWN_KINDS, **found})
        if wrong:
            sweepctl_plugins.disable(f"{plugin} {wrong}")
        else:
            found[kind.name] = replace(kind, turn=partial(_guarded, str(plugin), kind))
    return found


def _wrong(kind: object, taken: Mapping[str, FaultKind]) -> str:
    """Return the reason why an object is not a valid kind of fault, or an empty text."""
    if not isinstance(kind, FaultKind):
        return "is no FaultKind"
    if kind.name in taken:
        return f"has the name {kind.name!r}, which is taken"
    if kind.turn is None:
        return "needs a function turn"
    try:
        parse_spec(kind.example, {kind.name: kind})
    except FaultSpecError as error:
        return f"has a wrong example: {error.reason}"
    return ""


def _guarded(plugin: str, kind: FaultKind, knobs: Knobs, values: Mapping[str, Value]) -> None:
    """Apply a plug-in's fault; a kind that has raised an exception has no further effect."""
    if kind.turn is None or kind.name in _BROKEN:
        return
    try:
        kind.turn(knobs, values)
    except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
        _BROKEN.add(kind.name)
        sweepctl_plugins.disable(f"{plugin} raised {type(error).__name__}: {error}")


_BROKEN: set[str] = set()
"""Names of the plug-in kinds that have raised an exception."""
KINDS: Mapping[str, FaultKind] = MappingProxyType({**OWN_KINDS, **_plugged()})
"""All kinds by name: the project's own kinds and the kinds of plug-ins."""


def parse_fault(text: str) -> FaultSpec:
    """Parse a fault with its start time.

    Raises:
        FaultSpecError: the kind is unknown, or a time or a value is invalid.

    """
    return parse_spec(text, KINDS)


def parse_fault_now(text: str) -> FaultSpec:
    """Parse a fault with an optional start time; without a time it starts at once.

    Raises:
        FaultSpecError: the kind is unknown, or a time or a value is invalid.

    """
    return parse_spec(text, KINDS, timed=False)


def as_dict(kind: FaultKind) -> dict[str, Any]:
    """Return a kind as a dictionary, for JSON output."""
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
