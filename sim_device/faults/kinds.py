"""All kinds of faults by name: the only list that parsing, help and docs use.

Plug-ins add kinds as entry points of the group ``sweepctl.faults``, each a :class:`FaultKind`.
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
"""The project's own kinds, which the documentation lists."""


def _plugged() -> dict[str, FaultKind]:
    """Return the kinds of plug-ins, without the invalid ones."""
    found: dict[str, FaultKind] = {}
    for plugin, kind in sweepctl_plugins.usable("faults"):
        wrong = _wrong(kind, {**OWN_KINDS, **found})
        if wrong:
            sweepctl_plugins.disable(f"{plugin} {wrong}")
        else:
            found[kind.name] = replace(kind, turn=partial(_guarded, str(plugin), kind))
    return found


def _wrong(kind: object, taken: Mapping[str, FaultKind]) -> str:
    """Return why an object cannot be a kind of fault, or an empty text."""
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
    """Apply a plug-in's fault; a kind that has raised has no further effect."""
    if kind.turn is None or kind.name in _BROKEN:
        return
    try:
        kind.turn(knobs, values)
    except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
        _BROKEN.add(kind.name)
        sweepctl_plugins.disable(f"{plugin} raised {type(error).__name__}: {error}")


_BROKEN: set[str] = set()
"""Kinds of plug-ins that have raised."""
KINDS: Mapping[str, FaultKind] = MappingProxyType({**OWN_KINDS, **_plugged()})
"""All kinds by name: the project's own and those of plug-ins."""


def parse_fault(text: str) -> FaultSpec:
    """Read a fault with its time.

    Raises:
        FaultSpecError: the kind is unknown, or a time or a value is invalid.

    """
    return parse_spec(text, KINDS)


def parse_fault_now(text: str) -> FaultSpec:
    """Read a fault with an optional time; without one it starts at once.

    Raises:
        FaultSpecError: as for :func:`parse_fault`.

    """
    return parse_spec(text, KINDS, timed=False)


def as_dict(kind: FaultKind) -> dict[str, Any]:
    """Return a kind as a dictionary for programs."""
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
