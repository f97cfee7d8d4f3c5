"""``sweepctl param``: read and change a device's parameters."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.completion import complete_parameter, complete_robot
from tools.cli.configuration import RobotsOwnFile
from tools.cli.console import inform, plain_console, write_json, write_line
from tools.cli.interrupt import set_done
from tools.cli.paths import PathName
from tools.cli.port_options import PortAsked, keyed_port_options

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bridge.api.remote import ReachableRobot
    from bridge.session.parameters import Parameter

_WIDEST = 2000
"""Width at which a table is laid out, characters: more than any table needs."""


class ValuesCommand(click.Command):
    """Command whose arguments may be negative numbers, which are no options."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the words. An unknown option is an error."""
        self.make_parser(ctx).parse_args(["0" if _is_negative(word) else word for word in args])
        ctx.ignore_unknown_options = True  # only negative numbers are left
        return super().parse_args(ctx, args)


def _is_negative(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return word.startswith("-")


@click.group(
    "param",
    epilog="Example:  sweepctl param list /dev/ttyUSB0",
)
def command() -> None:
    """Read and change a device's parameters. Nothing moves.

    A change lasts until the next boot; `param save` makes it permanent. If another sweepctl has the
    port open, the request goes through it.
    """


@command.command("list", epilog="Example:  sweepctl param list /dev/ttyUSB0 --json")
@keyed_port_options
@click.option("--changed", is_flag=True, help="List only parameters that differ from the default.")
@options.json_option
def _list(*, port: PortAsked, changed: bool, as_json: bool) -> int:
    """List all parameters with value, unit, range and default.

    The table also shows when a change takes effect, and whether the value is saved.
    """
    with _reach(port) as robot:
        found = robot.list_parameters()
    if changed:
        found = [p for p in found if p.value != p.default]
    _show(found, as_json=as_json)
    return 0


@command.command("get", epilog="Example:  sweepctl param get /dev/ttyUSB0 wheel_base")
@keyed_port_options
@click.argument(
    "names", nargs=-1, required=True, metavar="NAME...", shell_complete=complete_parameter
)
@options.json_option
def _get(*, port: PortAsked, names: tuple[str, ...], as_json: bool) -> int:
    """Show parameters by name or number; on a pipe print only the values."""
    with _reach(port) as robot:
        found = [robot.get_parameter(_name(name)) for name in names]
    if as_json or sys.stdout.isatty():
        _show(found, as_json=as_json)
    else:
        write_line(*(_number(p, p.value) for p in found))
    return 0


@command.command(
    "set",
    cls=ValuesCommand,
    epilog="Example:  sweepctl param set /dev/ttyUSB0 wheel_base 0.2312 --save",
)
@keyed_port_options
@click.argument(
    "pairs", nargs=-1, required=True, metavar="NAME VALUE...", shell_complete=complete_parameter
)
@click.option("--save", is_flag=True, help="Then save all present values for the next boot.")
@options.json_option
def _set(*, port: PortAsked, pairs: tuple[str, ...], save: bool, as_json: bool) -> int:
    """Change parameters until the next boot, or permanently with --save.

    A value must have the parameter's type and be in its range; the device rejects others.
    """
    if len(pairs) % 2:
        raise click.UsageError(f"{pairs[-1]} has no value: give NAME VALUE pairs")
    with _reach(port) as robot:
        names = pairs[::2]
        before = [robot.get_parameter(_name(name)) for name in names]
        for at, parameter in enumerate(before):
            if parameter in before[:at]:
                raise click.UsageError(f"{parameter.name} is given twice: give one value")
        for parameter, value in zip(before, pairs[1::2], strict=True):
            parameter.raw(value)  # check all values before the first one is changed
        _change(robot, before, pairs[1::2], save=save, as_json=as_json)
    return 0


@command.command(
    "reset", epilog="Example:  sweepctl param reset /dev/ttyUSB0 wheel_base wheel_diameter --save"
)
@keyed_port_options
@click.argument("names", nargs=-1, metavar="[NAME]...", shell_complete=complete_parameter)
@click.option("--all", "all_", is_flag=True, help="Reset every parameter.")
@click.option("--save", is_flag=True, help="Then save all present values for the next boot.")
@options.json_option
def _reset(
    *, port: PortAsked, names: tuple[str, ...], all_: bool, save: bool, as_json: bool
) -> int:
    """Set parameters to their defaults until the next boot, or permanently with --save.

    The defaults are the device's own. Read-only parameters keep their value.
    """
    if bool(names) == all_:
        raise click.UsageError("give the NAMEs of parameters, or --all for every one")
    with _reach(port) as robot:
        found = robot.list_parameters() if all_ else [robot.get_parameter(_name(n)) for n in names]
        differing = [p for p in found if p.value != p.default and not (all_ and p.read_only)]
        if not differing:
            inform("every value is the default; nothing was changed")
        defaults = [_number(p, p.default) if p.kind == "bool" else p.default for p in differing]
        _change(robot, differing, defaults, save=save, as_json=as_json)
    return 0


@command.command("save", epilog="Example:  sweepctl param save /dev/ttyUSB0")
@keyed_port_options
@options.json_option
def _save(*, port: PortAsked, as_json: bool) -> int:
    """Save all present values for the next boot."""
    with _reach(port) as robot:
        kept = [p for p in robot.list_parameters() if p.changed]
        robot.save_parameters()
        found = robot.list_parameters()
        names = ", ".join(p.name for p in kept)
        inform(f"saved: {names}" if names else "saved; no value had changed")
        late = ", ".join(p.name for p in kept if p.needs_reboot)
        if late:
            inform(f"{late}: takes effect at the next boot; reboot the device (sweepctl reboot)")
        if as_json:
            _show(found, as_json=True)
        set_done()
    return 0


@command.command("diff", epilog="Example:  sweepctl param diff /dev/ttyUSB0 robot.toml")
@keyed_port_options
@click.argument(
    "file",
    cls=RobotsOwnFile,
    required=False,
    type=PathName(dir_okay=False),
    shell_complete=complete_robot,
)
@options.json_option
def _diff(*, port: PortAsked, file: Path, as_json: bool) -> int:
    """Compare a device's parameters with a robot file: FILE, or that of the named robot.

    Exit status: 0 they are equal; 1 they differ.
    """
    from bridge.bringup.values import differences
    from bridge.config import load_robot

    model, _ = load_robot(file)
    with _reach(port) as robot:
        found = differences(robot.list_parameters(), model)
    if as_json:
        rows = [{**d._asdict()} for d in found]
        write_json({"file": str(file), "differences": rows})
    else:
        rows_shown = [(d.name, _plain(d.device), _plain(d.file), d.unit) for d in found]
        if rows_shown:
            _table(("parameter", "device", str(file), "unit"), rows_shown)
        else:
            inform(f"the device and {file} are equal")
    return 1 if found else 0


# ---- shared -----------------------------------------------------------------------------


def _reach(port: PortAsked) -> ReachableRobot:
    from bridge.api.remote import reach

    return reach(port.name, node=port.node, key=port.key, **port.how)


def _change(
    robot: ReachableRobot,
    before: Sequence[Parameter],
    values: Sequence[float | str],
    *,
    save: bool,
    as_json: bool,
) -> None:
    """Set parameters, save them if requested, and report the old and new value of each."""
    after = [
        robot.set_parameter(parameter.number, value)
        for parameter, value in zip(before, values, strict=True)
    ]
    if save:
        robot.save_parameters()
        after = [robot.get_parameter(p.number) for p in after]
    for was, now in zip(before, after, strict=True):
        inform(f"{now.name}: {_number(was, was.value)} -> {_number(now, now.value)} {now.unit}")
    _remind(after)
    if as_json:
        _show(after, as_json=True)
    set_done()


def _name(text: str) -> str | int:
    return int(text) if text.isascii() and text.isdigit() else text


def _show(parameters: Sequence[Parameter], *, as_json: bool) -> None:
    if as_json:
        found: dict[str, Any] = {"parameters": [p.to_dict() for p in parameters]}
        write_json(found)
        return
    rows = [
        (
            str(p.number),
            p.name,
            _number(p, p.value),
            p.unit,
            p.kind,
            f"{_number(p, p.low)} to {_number(p, p.high)}",
            _number(p, p.default),
            "" if p.read_only else "after reboot" if p.needs_reboot else "at once",
            _state(p),
        )
        for p in parameters
    ]
    head = ("no", "parameter", "value", "unit", "type", "range", "default", "effective", "state")
    _table(head, rows)


def _state(p: Parameter) -> str:
    if p.read_only:
        return "read-only"
    if p.changed:  # a device that needs a reboot for it still uses the value from its boot
        return "needs save and reboot" if p.needs_reboot else "not saved"
    return "stored" if p.stored else ""


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    from rich.measure import Measurement
    from rich.table import Table

    def without(dropped: tuple[str, ...]) -> Table:
        table = Table(box=None, pad_edge=False)
        kept = [at for at, name in enumerate(head) if name not in dropped]
        for at in kept:
            right = head[at] in {"no", "value", "default", "device"}
            table.add_column(head[at], justify="right" if right else "left", no_wrap=True)
        for row in rows:
            table.add_row(*(row[at] for at in kept))
        return table

    console = plain_console()
    wide = console.options.update(width=_WIDEST)
    table = without(())
    for dropped in (("no",), ("no", "default")):  # the least important columns
        if not sys.stdout.isatty() or (
            Measurement.get(console, wide, table).maximum <= console.width
        ):
            break
        table = without(dropped)
    # No cell is cut: a terminal wraps a long line, and a pipe has no width.
    for line in console.render_lines(table, wide, pad=False):
        write_line("".join(part.text for part in line).rstrip())


def _number(parameter: Parameter, value: float) -> str:
    if parameter.kind == "bool":
        return "true" if value else "false"
    return _plain(value) if parameter.kind == "f32" else str(int(value))


def _plain(value: float | None) -> str:
    """Format with as few digits as distinguish 32-bit floats."""
    return "-" if value is None else f"{value:.7g}"


def _remind(parameters: Sequence[Parameter]) -> None:
    if any(p.changed for p in parameters):
        inform("changed until the next boot; `sweepctl param save` makes it permanent")
    late = [p.name for p in parameters if p.needs_reboot]
    if late:
        what = "save, then reboot" if any(p.changed for p in parameters) else "reboot"
        inform(f"{', '.join(late)}: takes effect at the next boot; {what} the device")
