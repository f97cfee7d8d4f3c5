"""Documentation of every command: examples, completion, and the generated reference."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING, NamedTuple

import click
import pytest

from support.cli import sweepctl
from support.root import ROOT
from tools.cli.main import cli
from tools.dev.command_help import PATH, reference

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def commands(
    group: click.Group, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        yield (*path, name), command
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))


ALL = dict(commands(cli))


def test_the_reference_is_fresh() -> None:
    text = "run `python -m tools.dev.command_help`"
    assert PATH.read_text(encoding="utf-8") == reference(), text


def test_the_reference_links_to_sections_that_it_has() -> None:
    text = reference()
    links = set(re.findall(r"\]\(#([a-z0-9-]+)\)", text))
    found = re.findall(r"^##+ (.+)$", text, re.MULTILINE)
    headings = {heading.lower().replace(" ", "-") for heading in found}
    assert links
    assert links <= headings


PAGE = PATH.read_text(encoding="utf-8")
SECTIONS = {
    tuple(head.split()[1:]): text
    for head, text in re.findall(r"^##+ (sweepctl .+)\n((?:(?!^##).*\n?)*)", PAGE, re.MULTILINE)
}
"""Sections of the page: the words of a command and the text below them."""
OPTION = re.compile(r"^\| ((?:`-[^|]+?`(?:, )?)+)(?: `[^`]+`)? \| (.+) \|$", re.MULTILINE)


def options_on_page(path: tuple[str, ...]) -> dict[str, str]:
    """Return the page's text for each option name."""
    return {
        name: meaning
        for names, meaning in OPTION.findall(SECTIONS[path])
        for name in re.findall(r"`(-[\w-]+)`", names)
    }


def offered(path: tuple[str, ...]) -> set[str]:
    """Return the names of the options that the command itself lists."""
    printed = sweepctl(*path, "--help").out.partition("\nOptions:\n")[2]
    heads = re.findall(r"^  (-.+?)(?:  |$)", printed, re.MULTILINE)
    names = {name for head in heads for name in re.findall(r"(?<![\w-])--?[a-z][\w-]*", head)}
    return names - {"-h", "--help"}


def test_the_page_has_every_command_that_help_names() -> None:
    found: set[tuple[str, ...]] = set()
    groups: list[tuple[str, ...]] = [()]
    while groups:
        path = groups.pop()
        printed = sweepctl(*path, "--help").out
        for block in re.findall(
            r"^(?:Commands|[A-Z][\w ,]+):\n((?:  .*\n|\n)+)", printed, re.MULTILINE
        ):
            for word in re.findall(r"^  ([a-z][\w-]*)(?:  |$)", block, re.MULTILINE):
                inner = (*path, word)
                found.add(inner)
                if "COMMAND [ARGS]..." in sweepctl(*inner, "--help").out:
                    groups.append(inner)
    assert len(found) > 20
    assert found == set(SECTIONS)


@pytest.mark.parametrize("path", SECTIONS, ids=" ".join)
def test_the_page_has_every_option_that_help_names(path: tuple[str, ...]) -> None:
    assert set(options_on_page(path)) == offered(path)


class Range(NamedTuple):
    """Range of an option's values on the page."""

    path: tuple[str, ...]
    name: str
    low: str
    high: str


RANGES = [
    Range(path, name, low, high)
    for path in SECTIONS
    for name, meaning in options_on_page(path).items()
    for low, high in re.findall(r"Range: (-?[\d.e+-]+) to (-?[\d.e+-]+)\.(?: |$)", meaning)
]


def beyond(end: str, by: int) -> str:
    """Return the end of a range plus ``by``."""
    return str(int(end) + by if re.fullmatch(r"-?\d+", end) else float(end) + by)


@pytest.mark.parametrize("option", RANGES, ids=lambda o: " ".join((*o.path, o.name)))
def test_the_ranges_on_the_page_are_those_of_the_command(option: Range) -> None:
    """Both ends of a range are accepted; a value beyond is rejected by the option's name."""
    for value in (beyond(option.low, -1), beyond(option.high, 1)):
        assert option.name in rejections(option.path, option.name, value), value
    for value in (option.low, option.high):
        assert rejections(option.path, option.name, value) == [], value


def _ports(command: click.Command) -> list[str]:
    """Return a port for a command that looks up its port before it parses the options."""
    eager = [p for p in command.params if isinstance(p, click.Argument) and p.is_eager]
    return ["/dev/none"] if eager else []


def rejections(path: tuple[str, ...], name: str, value: str) -> list[str]:
    """Return the options that the parser rejects; the command does not run."""
    try:
        ALL[path].make_context(path[-1], [name, value, *_ports(ALL[path])])
    except click.MissingParameter:
        return []
    except click.BadParameter as error:
        return error.param.opts if error.param is not None else []
    return []


@pytest.mark.parametrize("path", ALL, ids=" ".join)
def test_every_command_has_an_example_of_itself(path: tuple[str, ...]) -> None:
    epilog = ALL[path].epilog or ""
    assert epilog.startswith("Example:  "), path
    assert f"sweepctl {' '.join(path)} " in epilog
    options = {o for p in ALL[path].params for o in (*p.opts, *p.secondary_opts)}
    if not isinstance(ALL[path], click.Group):
        used = re.findall(r"(?<=\s)--[a-z-]+", epilog)
        assert set(used) <= options | {"--help"}, path


@pytest.mark.parametrize("path", ALL, ids=" ".join)
def test_every_option_is_explained(path: tuple[str, ...]) -> None:
    command = ALL[path]
    assert command.help, path
    unexplained = [
        option.opts[0]
        for option in command.params
        if isinstance(option, click.Option) and not option.help and option.opts != ["--node"]
    ]
    assert unexplained == [], path


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_ask_the_command(shell: str) -> None:
    done = sweepctl("completion", shell)
    assert (done.status, done.err) == (0, "")
    assert f"_SWEEPCTL_COMPLETE={shell}_complete" in done.out
    assert sweepctl("completion", "tcsh").status == 2


def completed(words: str, tmp_path: Path) -> list[str]:
    """Return bash's completions of the last word."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "_SWEEPCTL_COMPLETE": "bash_complete",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split(" ")) - 1),
    }
    code = "import sys; sys.argv[0] = 'sweepctl'; from tools.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    return [line.split(",", 1)[1] for line in done.stdout.splitlines()]


def test_commands_options_and_names_are_completed(tmp_path: Path) -> None:
    assert completed("sweepctl mon", tmp_path) == ["monitor"]
    assert completed("sweepctl param s", tmp_path) == ["save", "set"]
    assert "--clear-stop" in completed("sweepctl drive --c", tmp_path)
    assert completed("sweepctl monitor /dev/x enc", tmp_path) == ["encoders"]
    assert completed("sweepctl bringup can:s", tmp_path) == [
        "can:socketcan:can0",
        "can:slcan:/dev/ttyACM0",
    ]


def test_rooms_robot_files_parameters_and_faults_are_completed(tmp_path: Path) -> None:
    for name in ("cabin.json", "cargo.toml", "cave.txt", ".hidden.json"):
        (tmp_path / name).write_text("")
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "mine.toml").write_text("")
    rooms = ["case-1", "case-2", "cabin.json", "cases/"]
    assert completed("sweepctl simulate ca", tmp_path) == rooms
    assert completed("sweepctl emulate ca", tmp_path) == rooms
    assert completed("sweepctl connect /dev/x --room ca", tmp_path) == rooms
    for command in ("simulate case-1", "connect /dev/x", "calibrate gyro /dev/x"):
        assert completed(f"sweepctl {command} --robot ca", tmp_path) == ["cargo.toml", "cases/"]
    assert completed("sweepctl param diff /dev/x cases/", tmp_path) == ["cases/mine.toml"]
    assert completed("sweepctl param get /dev/x wheel_b", tmp_path) == ["wheel_base"]
    assert completed("sweepctl param set /dev/x gyro", tmp_path) == ["gyro_bias"]
    for command in ("emulate --fault", "simulate case-1 --fault", "fault x.ctl", "fault x --clear"):
        assert completed(f"sweepctl {command} unpl", tmp_path) == ["unplug"]
    assert completed("sweepctl stop can:s", tmp_path) == completed(
        "sweepctl connect can:s", tmp_path
    )


def test_bash_takes_the_script(tmp_path: Path) -> None:
    bash = shutil.which("bash")
    assert bash is not None
    script = tmp_path / "sweepctl.bash"
    script.write_text(sweepctl("completion", "bash").out)
    done = subprocess.run(
        [bash, "-c", f"source {script} && complete -p sweepctl"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "sweepctl_completion" in done.stdout
