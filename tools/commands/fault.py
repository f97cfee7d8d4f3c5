"""``sweepctl fault``: start and end faults of a running emulator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tools.cli.completion import complete_fault
from tools.cli.console import write_json, write_line
from tools.cli.paths import PathName

if TYPE_CHECKING:
    from pathlib import Path


@click.command(
    "fault",
    epilog="Example:  sweepctl fault /tmp/sweeper.ctl silence:0.5 wheel-stuck:3:side=left",
)
@click.argument("control", type=PathName())
@click.argument("specs", nargs=-1, metavar="[SPEC]...", shell_complete=complete_fault)
@click.option(
    "--clear",
    multiple=True,
    metavar="KIND",
    shell_complete=complete_fault,
    help="End the faults of this kind; may be repeated.",
)
@click.option("--clear-all", is_flag=True, help="End all faults, including waiting ones.")
@click.option("--list", "list_them", is_flag=True, help="List active and waiting faults.")
@click.option(
    "--truth",
    is_flag=True,
    help="Print the true state of the virtual robot: pose, path, collisions, energy.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout.")
def command(  # noqa: PLR0913 - one parameter per option
    *,
    control: Path,
    specs: tuple[str, ...],
    clear: tuple[str, ...],
    clear_all: bool,
    list_them: bool,
    truth: bool,
    as_json: bool,
) -> int:
    """Start or end faults of the emulator whose --control socket is CONTROL.

    SPEC is kind[@time][:for][:name=value,...], as for emulate --fault. Without a time the fault
    starts at once; @+2 means in two seconds. Faults are ended before others are started.

    --truth prints what only the emulator knows, such as the number of collisions.
    """
    from bridge.errors import PortError
    from sim_device.faults.kinds import KINDS
    from sim_device.ports import PortUnavailableError
    from sim_device.ports.control import MAX_LINE

    unknown = [kind for kind in clear if kind not in KINDS]
    if unknown:
        text = f"{unknown[0]!r} is not one of {', '.join(KINDS)}"
        raise click.BadParameter(text, param_hint="--clear")
    lines = ["clear"] if clear_all else []
    lines += [f"clear {_one_line(kind)}" for kind in clear]
    lines += [f"start {_one_line(spec)}" for spec in specs]
    if any(len(line.encode()) >= MAX_LINE for line in lines):
        raise click.UsageError(f"a fault's text must be shorter than {MAX_LINE} bytes")
    if not (lines or list_them or truth):
        options = "--clear KIND, --clear-all, --list or --truth"
        raise click.UsageError(f"nothing to do: give a SPEC, {options}")
    try:
        answer = _exchange(control, specs, lines, truth=truth)
    except PortUnavailableError as error:
        raise PortError(str(error)) from None
    if as_json:
        write_json(answer)
        return 0
    said = [f"started: {text}" for text in answer["begun"]]
    said += [f"ended: {answer['cleared']}"] if clear or clear_all else []
    if list_them:
        said += [f"active: {text}" for text in answer["active"]] or ["active: none"]
        said += [f"waiting: {text}" for text in answer["waiting"]]
    said += [f"{name}: {value:.6g}" for name, value in answer.get("truth", {}).items()]
    write_line(*said)
    return 0


def _exchange(
    control: Path, specs: tuple[str, ...], lines: list[str], *, truth: bool
) -> dict[str, Any]:
    """Send the requests, and return the command's JSON object."""
    from sim_device.ports import ask_control

    begun: list[str] = []
    cleared = 0
    checks = [f"check {spec}" for spec in specs]
    for line in checks + lines:  # all are checked before the first fault starts
        reply = ask_control(control, line)
        if not reply["ok"]:
            raise click.BadParameter(str(reply.get("error")))
        if line in checks:
            continue
        begun += [reply["fault"]] if "fault" in reply else []
        cleared += reply.get("cleared", 0)
    found = ask_control(control, "list")
    answer = {
        "begun": begun,
        "cleared": cleared,
        "active": found["active"],
        "waiting": found["waiting"],
    }
    if truth:
        answer["truth"] = ask_control(control, "truth")["truth"]
    return answer


def _one_line(text: str) -> str:
    """Return the text of a fault; check that it does not contain a second request.

    Raises:
        click.UsageError: the text has several lines or is not UTF-8.

    """
    if "\n" in text or "\r" in text:
        raise click.UsageError("a fault's text must be one line")
    if any("\ud800" <= c <= "\udfff" for c in text):
        raise click.UsageError(f"a fault's text must be UTF-8: {text!r}")
    return text
