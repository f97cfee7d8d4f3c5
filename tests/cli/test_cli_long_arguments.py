"""Every command reports an extremely long value of any option or argument in one line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
import pytest

from support.cli import sweepctl
from tools.cli.main import cli

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.slow

VALUES = {
    "a word": "a" * 100_000,
    "3000 digits": "9" * 3000,
    "more digits than int() takes": "-" + "9" * 5000,
    "a deep path": "a/" * 50_000,
    "a name too long for a file": "b" * 300,
    "control characters": "no\x1b]0;such\x07\n\u202ething",
    "no UTF-8": "no\udcffsuch\udcfething",
}
WHOLE = {"room": "case-1"}
"""Valid values of the other required arguments, so that only the tested value is rejected."""
LISTED = {("ports", "named")}
"""Arguments for which any name is valid and is shown as given."""


def leaves(
    command: click.Command, words: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    if not isinstance(command, click.Group):
        yield words, command
        return
    context = click.Context(command)
    for name in command.list_commands(context):
        below = command.get_command(context, name)
        assert below is not None
        yield from leaves(below, (*words, name))


COMMANDS = dict(leaves(cli))


def given(parameter: click.Parameter, value: str) -> list[str]:
    count = max(1, parameter.nargs)
    if not isinstance(parameter, click.Option):
        return ["--", *[value] * count] if value.startswith("-") else [value] * count
    option = parameter.opts[-1]
    return [f"{option}={value}"] if count == 1 else [option, *[value] * count]


def others(command: click.Command, tested: click.Parameter) -> list[str]:
    """Return values for the other required arguments; no port and no file has these names."""
    words = []
    for parameter in command.params:
        if parameter is not tested and parameter.required:
            value = WHOLE.get(parameter.name or "", "/nowhere/at-all")
            if isinstance(parameter.type, click.Choice):
                value = parameter.type.choices[0]
            words += given(parameter, value)
    return words


@pytest.mark.parametrize("words", list(COMMANDS), ids=" ".join)
def test_any_long_value_is_reported_in_one_short_line(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command = COMMANDS[words]
    short = ["--max-time", "1"] if words == ("simulate",) else []
    for parameter in command.params:
        is_flag = isinstance(parameter, click.Option) and (parameter.is_flag or parameter.count)
        if is_flag or (words[0], parameter.name) in LISTED:
            continue
        for name, value in VALUES.items():
            is_path = isinstance(parameter.type, click.Path)
            if is_path and value.startswith("no"):  # a valid name
                continue
            done = sweepctl(*words, *short, *others(command, parameter), *given(parameter, value))
            what = f"{parameter.name}, {name}: {done.status} {done.err[:300]!r}"
            lines = done.err.splitlines()
            assert len(lines) == 1, what
            assert len(lines[0]) < 2000, what
            assert lines[0].isprintable(), what
            assert list(tmp_path.rglob("*.mcap")) == [], what
            assert lines[0].startswith("sweepctl: "), what
            assert done.status in {1, 2, 3}, what
            if not isinstance(parameter.type, click.Path | click.types.StringParamType):
                assert done.status == 2, what
