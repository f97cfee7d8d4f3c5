"""The plug-in interface is unchanged, and docs/plugins.md lists it.

A change of this interface breaks installed plug-ins. Append a parameter or field with a default, or
wait for a major version.
"""

from __future__ import annotations

import dataclasses
import enum
import importlib
import inspect
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from sim_device.faults.knobs import Knobs, WireKnobs
from support.root import ROOT

PAGE = ROOT / "docs" / "plugins.md"
PUBLIC: dict[str, dict[str, list[str]]] = tomllib.loads(
    Path(__file__).with_name("plugin_interface.toml").read_text(encoding="utf-8")
)
"""Public names by module, each with its parameters or fields in their order."""


def shape(thing: Any) -> list[str]:  # noqa: ANN401 - any object of a module
    """Return the part of an object that plug-ins can see."""
    if dataclasses.is_dataclass(thing):
        return [field.name for field in dataclasses.fields(thing)]
    if isinstance(thing, type):
        if issubclass(thing, enum.Enum):
            return [member.name for member in thing]
        if hasattr(thing, "_fields"):
            return list(thing._fields)
        return [name for name in vars(thing) if not name.startswith("_")]
    return list(inspect.signature(thing).parameters) if callable(thing) else ["value"]


HANDED_IN = (Knobs, WireKnobs)
"""Classes whose objects a plug-in only receives, so the order of their fields may change."""
NAMES = [(module, name) for module, names in PUBLIC.items() for name in names]


@pytest.mark.parametrize(("module", "name"), NAMES, ids=lambda value: value)
def test_a_public_name_is_as_it_was_and_at_most_longer(module: str, name: str) -> None:
    thing = getattr(importlib.import_module(module), name)
    then, now = PUBLIC[module][name], shape(thing)
    assert sorted(part for part in now if part in then) == sorted(then), now
    is_record = isinstance(thing, type) and (
        dataclasses.is_dataclass(thing) or hasattr(thing, "_fields")
    )
    if is_record or inspect.isfunction(thing):
        if thing not in HANDED_IN:
            assert now[: len(then)] == then, "new parts are appended"
        parameters = inspect.signature(thing).parameters
        added = [
            p for p in now if p not in then and parameters[p].default is inspect.Parameter.empty
        ]
        assert added == [], "appended parts have a default"


def test_the_page_lists_exactly_the_public_names() -> None:
    rows = re.findall(
        r"^\| `([a-z_.]+)` \| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
    listed = {module: set(re.findall(r"`(\w+)`", names)) for module, names in rows if "." in module}
    listed = {
        module: names for module, names in listed.items() if not module.startswith("sweepctl")
    }
    assert listed == {module: set(names) for module, names in PUBLIC.items()}


def test_the_page_warns_of_the_rights_of_a_plug_in() -> None:
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert "runs with all rights of the user" in text
