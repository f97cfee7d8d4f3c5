"""The example in each command's help works as printed."""

from __future__ import annotations

import shlex
import shutil
from typing import TYPE_CHECKING

import click
import pytest

from support.cli import short_runs, sweepctl
from tools.cli.main import cli

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

ROOM = '{"walls": [[0, 0], [3, 0], [3, 2], [0, 2]], "start": [1, 1, 0]}'
MAP = (
    "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
)
LOGS = ("clean.mcap", "cut.mcap", "before.mcap", "after.mcap", "runs/demo-simulated.mcap")
"""Logs that the examples read."""
NEEDS_ROBOT = frozenset(
    {
        *("bringup", "connect", "doctor", "drive", "fleet", "key", "monitor", "reboot", "stop"),
        *("calibrate", "calibrate gyro", "calibrate odometry", "calibrate range"),
        *("param", "param diff", "param get", "param list"),
        *("param reset", "param save", "param set"),
    }
)
"""Commands whose examples need a robot on /dev/ttyUSB0."""
PARSED_ONLY = {
    "emulate": "runs until it is ended",
    "experiment": "takes minutes",
    "fault": "needs the control socket of an emulator",
    "ports": "opens the ports of this machine",
    "replay": "runs until it is ended",
    "view": "opens a window",
}
"""Commands whose examples are not run, with the reason."""


def examples(group: click.Group, path: tuple[str, ...] = ()) -> Iterator[tuple[str, list[str]]]:
    """Yield each command with the words of its example after ``sweepctl``."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        inner = (*path, name)
        line = (command.epilog or "").removeprefix("Example:  ")
        line = line.removeprefix('eval "$(').removesuffix(')"')
        yield " ".join(inner), shlex.split(line)[1:]
        if isinstance(command, click.Group):
            yield from examples(command, inner)


ALL = dict(examples(cli))
RUN = sorted(set(ALL) - NEEDS_ROBOT - set(PARSED_ONLY))


@pytest.fixture(name="folder")
def folder_with_logs(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Path:
    log = short_runs(tmp_path_factory)[0].log
    for name in LOGS:
        copy = tmp_path / name
        copy.parent.mkdir(exist_ok=True)
        shutil.copy(log, copy)
    monkeypatch.chdir(tmp_path)
    assert sweepctl("robot", "new", "my-robot.toml").status == 0
    (tmp_path / "my-room.json").write_text(ROOM)
    cells = bytes(254 if 3 <= x < 77 and 3 <= y < 57 else 0 for y in range(60) for x in range(80))
    (tmp_path / "map.pgm").write_bytes(b"P5 80 60 255\n" + cells)
    (tmp_path / "map.yaml").write_text(MAP)
    return tmp_path


def test_each_example_is_run_or_has_a_reason_not_to() -> None:
    assert NEEDS_ROBOT | set(PARSED_ONLY) < set(ALL)
    assert {"simulate", "info", "report", "export", "recover", "diff", "generate"} <= set(RUN)
    for name in NEEDS_ROBOT:
        assert "/dev/ttyUSB0" in ALL[name], name


@pytest.mark.parametrize("name", RUN)
def test_an_example_without_hardware_runs(folder: Path, name: str) -> None:
    if ALL[name][:2] == ["robot", "new"]:
        (folder / "my-robot.toml").unlink()
    before = {path for path in folder.rglob("*") if path.is_file()}
    done = sweepctl(*ALL[name])
    assert done.status == 0, done.err
    written = {path for path in folder.rglob("*") if path.is_file()} - before
    assert written or done.out or "valid" in done.err


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", ALL)
def test_an_example_is_parsed_to_its_last_word(name: str) -> None:
    command: click.Command = cli
    words = ALL[name]
    # The context has the command's settings, because click stores the help option at its first use.
    context = click.Context(cli, **cli.context_settings)
    while isinstance(command, click.Group):
        found = command.get_command(context, words[0])
        assert found is not None
        command, words = found, words[1:]
    parsed = command.make_context(name, words, parent=context)
    given = {
        param.name
        for param in command.params
        if param.name
        and parsed.get_parameter_source(param.name) is click.core.ParameterSource.COMMANDLINE
    }
    assert given, "no argument and no option"
