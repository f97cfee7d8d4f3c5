"""``sweepctl ports``: the ports on which a robot may be."""

from __future__ import annotations

from importlib.resources import files
from typing import TYPE_CHECKING

import click

from tools.cli import options
from tools.cli.configuration import Named, given, robots_of
from tools.cli.console import inform, plain_console, write_json, write_lines

if TYPE_CHECKING:
    from bridge.io.candidates import Candidate


class Probe(click.Choice[str]):
    """Values of ``--probe``. If the value is missing, click reads the next argument as value."""

    def get_invalid_choice_message(self, value: object, ctx: click.Context | None) -> str:
        """Add a hint for a port name after ``--probe``."""
        problem = super().get_invalid_choice_message(value, ctx)
        return f"{problem} Give ports before --probe."


@click.command("ports", epilog="Example:  sweepctl ports --probe")
@click.argument("named", nargs=-1, metavar="[PORT]...", callback=robots_of)
@click.option(
    "--probe",
    type=Probe(["listen", "active"]),
    is_flag=False,
    flag_value="listen",
    help="Open each free port with DTR and RTS inactive and listen 1.5 s for a device's hello. "
    "--probe=active also sends a hello to every port.",
)
@click.option(
    "--baud",
    type=click.IntRange(1200, 12_000_000),
    default=921_600,
    show_default=True,
    help="Serial baud rate of the probe.",
)
@click.option("--udev-rule", is_flag=True, help="Print a udev rule for Linux and exit.")
@options.json_option
def command(
    *, named: tuple[Named, ...], probe: str | None, baud: int, udev_rule: bool, as_json: bool
) -> int:
    """List the serial ports and CAN interfaces on which a robot may be, likely ones first.

    Ports are opened only with --probe. Give one or more PORTs to list or probe only these. A port
    with a stable name is listed by it: the name stays the same whichever adapter is plugged in
    first.
    """
    if udev_rule:
        if as_json or probe is not None:
            other = "--json" if as_json else "--probe"
            raise click.UsageError(f"--udev-rule prints a file for udev: omit {other}")
        rule = files("tools").joinpath("data/70-sweepctl.rules").read_text(encoding="utf-8")
        write_lines(rule)
        return 0
    if given("baud") and probe is None:
        raise click.UsageError("--baud is the rate of the probe: give --probe")
    from bridge.io.candidates import candidates
    from bridge.io.candidates import probe as ask

    found = candidates([robot.port for robot in named])
    if probe == "active":
        inform("warning: a hello is sent to every listed port, whatever device is on it")
    if probe is not None:
        rates: dict[str, int] = {}
        if not given("baud"):
            rates = {r.port: int(r.values["baud"].value) for r in named if "baud" in r.values}
        found = ask(found, active=probe == "active", baud=baud, own_baud=rates)
    if as_json:
        write_json({"ports": [one.to_dict() for one in found]})
    elif not found:
        inform("no serial port or CAN interface found; check that the robot is plugged in")
    else:
        _show(found)
    return 0


def _show(found: list[Candidate]) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for title in ("port", "device", "adapter", "state"):
        table.add_column(title, overflow="fold", no_wrap=title != "state")
    for one in found:
        style = "bold green" if one.found else "" if one.known else "dim"
        device = "" if one.device == one.port else one.device
        table.add_row(one.port, device, one.what, _state(one), style=style)
    plain_console().print(table)


def _state(one: Candidate) -> str:
    if one.found is not None:
        return f"{one.found['firmware']}, node {one.found['node']}, uid {one.found['uid']}"
    if one.note is not None:
        return one.note
    return f"process {one.owner} has it open" if one.owner is not None else ""
