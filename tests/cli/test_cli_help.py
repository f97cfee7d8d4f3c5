"""The help texts of the commands."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import metadata
from typing import TYPE_CHECKING

import click
import pytest

from support.cli import sweepctl
from support.root import ROOT
from tools.cli.main import cli
from tools.dev.command_help import PATH
from tools.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator

COMMANDS = ("connect", "emulate", "simulate", "view", "info")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_shows_an_example(command: str) -> None:
    for option in ("--help", "-h"):
        done = sweepctl(command, option)
        assert (done.status, done.err) == (0, "")
        assert f"Example:  sweepctl {command} " in done.out
        assert f"Usage: sweepctl {command}" in done.out


@pytest.mark.parametrize("command", COMMANDS)
def test_the_example_is_one(command: str) -> None:
    """The example names only options that the command has."""
    text = sweepctl(command, "--help").out
    example = text.split("Example:", 1)[1].split()
    assert example[:2] == ["sweepctl", command]
    for option in (word for word in example if word.startswith("-")):
        assert f"{option} " in text.split("Example:", 1)[0]


def test_help_names_every_command_with_an_example() -> None:
    done = sweepctl("--help")
    assert done.status == 0
    assert "Example:  sweepctl simulate" in done.out
    for command in COMMANDS:
        assert f"\n  {command} " in done.out


def test_no_command_is_help_and_wrong_usage() -> None:
    done = sweepctl()
    assert done.status == 2
    assert "Usage: sweepctl" in done.err
    assert done.out == ""


def test_version() -> None:
    done = sweepctl("--version")
    assert done.status == 0
    assert done.out.strip() == f"sweepctl, version {VERSION}"


def helps(group: click.Group, context: click.Context) -> Iterator[tuple[str, str]]:
    """Yield every command's path with its help as printed."""
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        inner = click.Context(command, info_name=name, parent=context, **group.context_settings)
        yield inner.command_path, command.get_help(inner)
        if isinstance(command, click.Group):
            yield from helps(command, inner)


def test_no_help_text_has_a_mark_that_is_for_click() -> None:
    found = dict(helps(cli, click.Context(cli, info_name="sweepctl")))
    assert len(found) > 25
    for path, text in found.items():
        assert "\\" not in text, path
        assert not re.search(r"[^\n\x20-\x7e\xa0-\uffff]", text), path


def test_a_list_in_a_help_text_keeps_its_lines() -> None:
    found = dict(helps(cli, click.Context(cli, info_name="sweepctl")))
    assert "\n  dbc    CAN database, for" in found["sweepctl generate"]
    assert "\n  zsh:   sweepctl completion zsh >" in found["sweepctl completion"]


def test_the_reference_page_has_no_control_character_and_no_stray_backslash() -> None:
    text = PATH.read_text(encoding="utf-8")
    assert not re.search(r"[^\n\x20-\x7e\xa0-\uffff]", text)
    escaped = set(re.findall(r"\\(.)", re.sub(r"`[^`\n]+`", "", text)))
    assert escaped <= set("|<*["), "backslashes beyond those of Markdown"
    assert "\n    dbc    CAN database, for cantools" in text


def test_the_packaged_version_is_that_one() -> None:
    assert metadata.version("sweepctl") == VERSION


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from tools.cli.main import run; run(['--help']); "
        "print([m for m in ('numpy', 'scipy', 'mcap', 'serial', 'rerun', 'matplotlib') "
        "if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stderr.strip() == "[]"
