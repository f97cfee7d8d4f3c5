"""The JSON Schemas in docs/schemas, and the part of JSON Schema that they use.

:func:`problems` is stricter than the standard in one point: a key that an object's schema does not
name is an error, unless the schema has ``additionalProperties``. So every new key must be
described.
"""

from __future__ import annotations

import json
from functools import cache
from typing import TYPE_CHECKING, Any

import click

from support.root import ROOT
from tools.cli.main import cli

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

FOLDER = ROOT / "docs" / "schemas"
ANY = "*"
"""Command name of the failure schema, because any command may print a failure."""
_NOTES = frozenset({"$schema", "$defs", "title", "description", "x-commands"})
_KEYWORDS = _NOTES | {
    *("$ref", "anyOf", "type", "enum", "const", "properties", "required", "additionalProperties"),
    "items",
}
_TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "null": (type(None),),
}


@cache
def schemas() -> dict[str, dict[str, Any]]:
    """Return the schemas by file name."""
    return {
        path.stem: json.loads(path.read_text("utf-8")) for path in sorted(FOLDER.glob("*.json"))
    }


def schema_of(command: str) -> dict[str, Any] | None:
    """Return the schema of a command's output; None if the command has none."""
    found = [s for s in schemas().values() if command in s["x-commands"]]
    assert len(found) <= 1, f"{command}: several schemas"
    return found[0] if found else None


def commands(group: click.Group = cli, path: str = "") -> Iterator[tuple[str, click.Command]]:
    """Yield each command of the project, with its name as the user types it."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, f"{path}{name} ")
        else:
            yield f"{path}{name}", command


def command_of(arguments: Sequence[str]) -> str | None:
    """Return the command and subcommand of a command line; None if it is no command of sweepctl."""
    name = next((word for word in arguments if not word.startswith("-")), "")
    command = cli.get_command(click.Context(cli), name)
    if not isinstance(command, click.Group):
        callback = None if command is None else command.callback
        return name if callback is not None and callback.__module__.startswith("tools.") else None
    after = list(arguments)[list(arguments).index(name) + 1 :]
    named = after[0] if after and after[0] in command.commands else "list"
    return f"{name} {named}"


def output_problems(command: str, value: object) -> list[str]:
    """Return the errors in a command's output, by the command's schema or by the failure schema."""
    schema, failure = schema_of(command), schemas()["error"]
    if not list(problems(value, failure, failure)):
        return []
    if schema is None:
        return [f"{command}: no schema in {FOLDER}"]
    return [f"{command}: {text}" for text in problems(value, schema, schema)]


def check_output(arguments: Sequence[str], out: str) -> None:
    """Check the output of a command with ``--json``.

    Raises:
        AssertionError: the output is not one object that matches the command's schema.

    """
    command = command_of(arguments)
    if command is not None:
        found = output_problems(command, json.loads(out))
        assert not found, found


def problems(
    value: object, schema: dict[str, Any], root: dict[str, Any], at: str = "$"
) -> Iterator[str]:
    """Yield the errors in a value, compared with a schema."""
    unknown = schema.keys() - _KEYWORDS
    assert not unknown, f"{at}: the check does not know {sorted(unknown)}"
    if "$ref" in schema:
        name = schema["$ref"].removeprefix("#/$defs/")
        yield from problems(value, root["$defs"][name], root, at)
        return
    if "anyOf" in schema:
        each = [list(problems(value, one, root, at)) for one in schema["anyOf"]]
        if all(each):
            yield min(each, key=len)[0]
        return
    if "const" in schema and value != schema["const"]:
        yield f"{at}: {value!r} is not {schema['const']!r}"
    if "enum" in schema and value not in schema["enum"]:
        yield f"{at}: {value!r} is not one of {schema['enum']}"
    if "type" in schema and not _is_of(value, schema["type"]):
        yield f"{at}: {value!r} is not {schema['type']}"
    elif isinstance(value, dict):
        yield from _object_problems(value, schema, root, at)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from problems(item, schema.get("items", {}), root, f"{at}[{index}]")


def _object_problems(
    value: dict[str, Any], schema: dict[str, Any], root: dict[str, Any], at: str
) -> Iterator[str]:
    known, more = schema.get("properties", {}), schema.get("additionalProperties", False)
    for name in schema.get("required", ()):
        if name not in value:
            yield f"{at}: {name} is missing"
    for name, inner in value.items():
        if name in known:
            yield from problems(inner, known[name], root, f"{at}.{name}")
        elif more is False:
            yield f"{at}: {name} is not described"
        elif isinstance(more, dict):
            yield from problems(inner, more, root, f"{at}.{name}")


def _is_of(value: object, kinds: str | list[str]) -> bool:
    names = [kinds] if isinstance(kinds, str) else kinds
    if isinstance(value, bool):  # bool is an int in Python, but not in JSON
        return "boolean" in names
    return any(isinstance(value, _TYPES[name]) for name in names)
