"""Generator of docs/commands.md, the reference of the command line, from the click commands.

``python -m tools.dev.command_help`` writes it; a test checks that it is current.
"""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tools.cli.console import write_line

if TYPE_CHECKING:
    from collections.abc import Iterator

PATH = Path(__file__).resolve().parents[2] / "docs" / "commands.md"
_HEAD = """\
# Commands

<!-- Written by `python -m tools.dev.command_help`; a test holds it fresh. -->

    sweepctl COMMAND [OPTIONS] ARGUMENTS

`sweepctl COMMAND --help` shows the same in short. Messages go to stderr, results to stdout; with
`--json` stdout has exactly one JSON object. Terminals get colours and the dashboard; pipes and dumb
terminals get plain lines. Control, bidirectional and invisible characters in names and texts from
outside are printed as escapes (`\\x1b`), and words of more than 400 characters are shortened. A
command with an open port never waits for the reader of its output: lines that do not fit are
dropped and counted. At the end it waits at most 0.6 s for such a reader.

## What is common

**PORT** is a device path (`/dev/ttyUSB0`, better `/dev/serial/by-id/…`), `socket://HOST:PORT`,
`rfc2217://HOST:PORT`, or `can:INTERFACE:CHANNEL` for a CAN bus (`can:socketcan:can0`,
`can:slcan:/dev/ttyACM0`, `can:udp_multicast:239.74.163.2`), or the name of a robot in a
[configuration file](configuration.md), which also sets defaults.

**What moves the robot**: `connect` with `--plan` or `--supervise` or by its keys, `drive`,
`bringup` (wheels off the floor) and `calibrate odometry`. No other command moves the robot. Each
of them needs an explicit option, key or answer. Only `--clear-stop`, or its key in the dashboard,
clears a stop that was latched for safety. Look at the robot before you use it.

**Exit status**

| status | meaning |
| --- | --- |
| 0 | done, or the run was ended by the first Ctrl-C or by `--duration` |
| 1 | all other failures: time limit, log not writable, a fault found, Ctrl-C before the end |
| 2 | usage, or an invalid room, robot file, fault or value |
| 3 | cannot open the port, or the device was lost for good |
| 4 | the device rejected a command, or is incompatible |
| 5 | stopped for safety |

**Files**: logs go to `runs/<UTC>-<room or port>.mcap` unless you give `--out`. No file is
replaced without `--force`. Files must be regular files: a pipe, a socket or a device is an error.
A room, a robot file and a key file may also come from the shell, as `--robot <(command)` or
`/dev/stdin`; output may go to `/dev/null`. A robot file is TOML: the keys of the robot's model, a
table for each range sensor, `[supervise.RULE]` for rules. One line names every unknown key, wrong
value and impossible size in it (a sensor far outside the footprint, a wheel base wider than the
robot), with exit status 2. What will not work well (an infrared sensor below its minimum range at
the hull) is a warning as a run begins. A room is a small [JSON file](rooms.md).

**Environment**: with `NO_COLOR` set nothing is coloured. `SWEEPCTL_CONFIG` names the only
[configuration file](configuration.md) that is read; empty: none. A run that owns its port can be
reached by other shells through a Unix socket in the user's runtime directory (`XDG_RUNTIME_DIR`).

**Completion**: `eval "$(sweepctl completion bash)"`, and the same for zsh and fish.
"""


_KINDS = {"FLOAT RANGE": "NUMBER", "INTEGER RANGE": "NUMBER", "INTEGER": "NUMBER"}


def reference() -> str:
    """Return the whole page."""
    from tools.cli.main import cli

    # With the command's settings, because a command stores the help option of its first context.
    context = click.Context(cli, info_name="sweepctl", **cli.context_settings)
    parts = [_HEAD, "## All commands\n", _index(cli, context)]
    for name, command in _commands(cli, context):
        inner = _context(command, context, name)
        parts.append(_section(command, inner, level=2))
        if isinstance(command, click.Group):
            parts += [
                _section(sub, _context(sub, inner, sub_name), level=3)
                for sub_name, sub in _commands(command, inner)
            ]
    return "\n".join(part.rstrip() + "\n" for part in parts)


def _context(command: click.Command, parent: click.Context, name: str) -> click.Context:
    return click.Context(command, info_name=name, parent=parent)


def _commands(group: click.Group, context: click.Context) -> Iterator[tuple[str, click.Command]]:
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if command is not None:
            yield name, command


def _index(cli: click.Group, context: click.Context) -> str:
    rows = ["| command | what it does |", "| --- | --- |"]
    for name, command in _commands(cli, context):
        inner = _context(command, context, name)
        rows.append(f"| [`{name}`](#sweepctl-{name}) | {_cell(command.get_short_help_str(300))} |")
        if isinstance(command, click.Group):
            rows += [
                f"| [`{name} {sub_name}`](#sweepctl-{name}-{sub_name}) | "
                f"{_cell(sub.get_short_help_str(300))} |"
                for sub_name, sub in _commands(command, inner)
            ]
    return "\n".join(rows)


def _section(command: click.Command, context: click.Context, level: int) -> str:
    path = context.command_path
    lines = [f"{'#' * level} {path}", "", f"    {path} {' '.join(_usage(command, context))}", ""]
    lines += [_prose(command.help or ""), ""]
    options = [p for p in command.get_params(context) if isinstance(p, click.Option)]
    shown = [o for o in options if not o.hidden and "--help" not in o.opts]
    if shown:
        lines += ["| option | meaning |", "| --- | --- |"]
        lines += [
            f"| {_names(option, context)} | {_meaning(option, context)} |" for option in shown
        ]
        lines.append("")
    if command.epilog:
        example = command.epilog.removeprefix("Example:").strip()
        lines += ["```sh", example, "```"]
    return "\n".join(lines)


def _usage(command: click.Command, context: click.Context) -> list[str]:
    return command.collect_usage_pieces(context)


def _prose(text: str) -> str:
    """Return a docstring as Markdown: paragraphs joined, literal blocks unchanged."""
    found = []
    for paragraph in inspect.cleandoc(text).split("\n\n"):
        if paragraph.startswith("\b"):
            block = paragraph.removeprefix("\b").strip("\n").splitlines()
            found.append("\n".join(f"    {line}" for line in block))
        else:
            found.append(_escaped(" ".join(paragraph.split())))
    return "\n\n".join(found)


def _names(option: click.Option, context: click.Context) -> str:
    names = ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))
    if option.is_flag or option.count:
        return names
    kind = _KINDS.get(option.make_metavar(context), option.make_metavar(context))
    return f"{names} `{kind}`".replace("|", "\\|")


def _meaning(option: click.Option, context: click.Context) -> str:
    text = _escaped(" ".join((option.help or "").split()))
    text = text.replace("[default:", "\\[default:")
    default = _default(option, context)
    if default and "[default:" not in text:
        text = f"{text} Default: `{default}`.".strip()
    if isinstance(option.type, click.IntRange | click.FloatRange):
        text += f" Range: {_range(option.type)}."
    if option.multiple and "may be repeated" not in text:
        text += " May be repeated."
    return _cell(text)


def _default(option: click.Option, context: click.Context) -> str:
    if not option.show_default or option.default is None:
        return ""
    value: Any = option.get_default(context)
    if option.is_flag and option.secondary_opts:
        return (option.opts if value else option.secondary_opts)[0]
    return f"{value:g}" if isinstance(value, float) else str(value)


def _range(kind: click.IntRange | click.FloatRange) -> str:
    low = "" if kind.min is None else _plain(kind.min)
    high = "" if kind.max is None else _plain(kind.max)
    return f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"


def _plain(value: float) -> str:
    return str(int(value)) if value == int(value) else f"{value:g}"


def _escaped(text: str) -> str:
    return text.replace("<", "\\<").replace("*", "\\*")


def _cell(text: str) -> str:
    return text.replace("|", "\\|") if "\\|" not in text else text


def main() -> None:
    """Write the page."""
    PATH.write_text(reference(), encoding="utf-8")
    write_line(f"wrote {PATH}")


if __name__ == "__main__":
    main()
