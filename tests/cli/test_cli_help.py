"""What the command says of itself."""

from __future__ import annotations

import subprocess
import sys
from importlib import metadata

import pytest

from support.cli import ROOT, sweepctl
from tools.version import VERSION

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
    """It names no option that the command does not have."""
    text = sweepctl(command, "--help").out
    example = text.split("Example:", 1)[1].split()
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


def test_the_packaged_version_is_that_one() -> None:
    assert metadata.version("sweepctl") == VERSION


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from tools.sweepctl import run; run(['--help']); "
        "print([m for m in ('numpy', 'scipy', 'mcap', 'serial', 'rerun', 'matplotlib') "
        "if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stderr.strip() == "[]"
