"""``sweepctl doctor``: diagnose a device on a port, or a log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.configuration import given, port_of
from tools.cli.console import inform, plain_console, write_json
from tools.cli.log_file import complete_log, newest_if_named
from tools.cli.paths import is_file, is_folder, is_there
from tools.cli.port_options import complete_port

if TYPE_CHECKING:
    from bridge.doctor import Examination, Finding

_NO_DEVICE = frozenset({"no_data", "no_answer", "wrong_baud", "echo", "other_node", "words"})
"""Kinds of finding that mean that no device answered: exit status 3."""
_INCOMPATIBLE = frozenset({"version"})
"""Kinds of finding that mean that host and device are incompatible: exit status 4."""


def _complete_target(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    return [*complete_port(ctx, param, incomplete), *complete_log(incomplete)]


@click.command("doctor", epilog="Example:  sweepctl doctor /dev/ttyUSB0 --duration 20")
@click.argument(
    "target",
    metavar="PORT|FILE",
    shell_complete=_complete_target,
    callback=port_of,
    is_eager=True,
)
@click.option(
    "--duration",
    "duration_s",
    type=options.Number(1.0, 86_400.0),
    default=10.0,
    show_default=True,
    metavar="N",
    help="With a PORT: examine it for N seconds.",
)
@click.option("--listen", is_flag=True, help="With a PORT: only listen, send nothing.")
@click.option(
    "--find-baud",
    is_flag=True,
    help="With a serial PORT: listen at each common baud rate until a sweeper is found.",
)
@options.port_options
@options.json_option
def command(  # noqa: PLR0913 - the options of a port
    *,
    target: str,
    duration_s: float,
    listen: bool,
    find_baud: bool,
    node: int | None,
    baud: int,
    bitrate: int | None,
    lan: bool,
    dtr: bool,
    rts: bool,
    as_json: bool,
) -> int:
    """Diagnose a device's link, clock and sensors, and recommend what to do.

    With a PORT, the command completes the handshake and listens. It sends nothing that can move a
    wheel. If another host left the robot moving, the handshake stops it. FILE is a log, an MCAP
    file of another program (as far as possible), a `candump -l` log, or the raw bytes of a serial
    line.

    Exit status: 0 no problem found; 1 a problem; 3 no device found; 4 incompatible device.
    """
    if "://" not in target and not target.startswith("can:"):
        target = str(newest_if_named(Path(target)))
    path = Path(target)
    _check(target, path, find_baud=find_baud)
    if is_file(path):
        from bridge.doctor.log_examination import examine_log

        return _report(target, "log", examine_log(path), as_json=as_json)
    if find_baud:
        from bridge.doctor.port_examination import find_baud as search

        found = search(
            target, dtr=dtr, rts=rts, on_rate=lambda rate: inform(f"listening at {rate} baud")
        )
        if found is None:
            inform(f"{target}: no sweeper found at any baud rate")
        else:
            inform(f"{target}: sweeper found at {found} baud (--baud {found})")
            baud = found
    import threading

    from bridge.doctor.port_examination import examine_port
    from bridge.io import clock
    from bridge.io.ports import latency_note, open_port
    from tools.cli.signals import until_signalled

    port = open_port(target, baud=baud, dtr=dtr, rts=rts, bitrate=bitrate, lan=lan)
    note = latency_note(port)
    if not as_json:
        how = "listening" if listen else "examining (nothing moves)"
        inform(f"{target}: {how} for {duration_s:g} s; Ctrl-C ends it earlier")
    ended = threading.Event()
    begun_ns = clock.now()
    with until_signalled(ended.set):  # an interrupted examination is reported too
        examination = examine_port(
            port, target, duration_s, node=node, ask=not listen, ended=ended.is_set
        )
    if ended.is_set() and (clock.now() - begun_ns) / 1e9 < _MIN_S:
        raise KeyboardInterrupt  # too short for a finding
    return _report(target, "port", examination, as_json=as_json, note=note)


_MIN_S = 2.0
"""Minimum duration of an interrupted examination that is reported, s."""
_OF_FILES = {"target", "as_json"}
"""Parameters of the command that a file takes, too."""


def _check(target: str, path: Path, *, find_baud: bool) -> None:
    """Check that the options are valid for the target.

    Raises:
        click.UsageError: an option is not valid for the target.
        LogReadError: the target is a file that does not exist.

    """
    if is_folder(path):
        raise click.UsageError(f"{target} is a folder; give a log file or a port")
    if is_file(path):
        for param in click.get_current_context().command.params:
            if given(param.name or "") and param.name not in _OF_FILES:
                raise click.UsageError(f"{param.opts[0]} needs a port, but {target} is a file")
    if find_baud and given("baud"):
        raise click.UsageError("--find-baud tries every baud rate: omit --baud")
    if find_baud and target.startswith("can:"):
        raise click.UsageError(f"--find-baud needs a serial port; for {target} give --bitrate")
    if find_baud and "://" in target and not target.startswith("rfc2217://"):
        raise click.UsageError(f"--find-baud needs a serial port; {target} has no baud rate")
    if path.suffix and not is_there(path) and "://" not in target and not target.startswith("can:"):
        from bridge.record.errors import LogReadError

        raise LogReadError(path, "no such file or port")


def _report(
    target: str, kind: str, examination: Examination, *, as_json: bool, note: str | None = None
) -> int:
    findings = examination.conclude()
    figures = examination.figures()
    status = _status(findings)
    if as_json:
        report = {
            "target": target,
            "kind": kind,
            "healthy": status == 0,
            "findings": [finding.as_json() for finding in findings],
            "figures": figures,
            "exit_status": status,
        }
        write_json(report)
        return status
    _print(target, findings, figures, note)
    return status


def _status(findings: list[Finding]) -> int:
    grave = [f for f in findings if f.severity.value in {"warning", "error"}]
    if any(f.kind in _NO_DEVICE and f.severity.value == "error" for f in grave):
        return 3
    if any(
        f.kind in _INCOMPATIBLE or (f.kind == "schema" and f.severity.value == "error")
        for f in grave
    ):
        return 4
    return 1 if grave else 0


_COLOURS = {"error": "red", "warning": "yellow", "info": "cyan", "debug": "dim"}


def _print(target: str, findings: list[Finding], figures: dict[str, Any], note: str | None) -> None:
    from rich.text import Text

    console = plain_console()
    console.soft_wrap = True
    console.print(target, style="bold")
    for finding in findings:
        colour = _COLOURS[finding.severity.value]
        name = finding.kind.replace("_", " ")
        console.print(
            Text.assemble(
                (f"{finding.severity.value:<8}", colour), (name, "bold"), f": {finding.text}"
            )
        )
        console.print(Text.assemble("        ", ("what to do:", "dim"), f" {finding.advice}"))
    if _status(findings) == 0:  # notes are not problems
        console.print("no problem found", style="green")
    if note:
        console.print(Text.assemble(("note    ", "yellow"), note))
    _print_figures(console, figures)


def _print_figures(console: Any, figures: dict[str, Any]) -> None:  # noqa: ANN401 - rich's console, imported late
    trip, delay = figures["round_trip_ms"], figures["delay_ms"]
    counts = [
        f"{figures['frames']} frames in {figures['duration_s']:.1f} s",
        f"{figures['lost']} lost",
        f"{figures['damaged']} damaged",
    ]
    if trip:
        counts.append(f"round trip {trip['p50']:.1f} ms (p99 {trip['p99']:.1f})")
    if delay:
        counts.append(f"delay p95 {delay['p95']:.1f} ms")
    if figures["drift_error_ppm"] is not None:
        counts.append(f"clock {figures['drift_ppm']:+.0f} ppm (± {figures['drift_error_ppm']:.0f})")
    elif figures["drift_ppm"] is not None:
        counts.append("clock drift not measured: too short")
    console.print(", ".join(counts), style="dim")
    for boot in figures["boots"][:1]:
        who = f"{boot['firmware']}, uid {boot['uid']}, reset cause {boot['cause']}"
        console.print(who, style="dim")
    off = [
        f"{name} {stream['rate_hz']:g} Hz (default {stream['default_hz']:g})"
        for name, stream in figures["streams"].items()
        if stream["default_hz"]
        and stream["rate_hz"] is not None
        and not 0.9 < stream["rate_hz"] / stream["default_hz"] < 1.1  # noqa: PLR2004 - a tenth
        and name != "hello"
    ]
    if off:
        others = f"rates that differ from the default: {', '.join(off)}"
        console.print(others, style="dim")
