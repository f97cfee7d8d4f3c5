"""``sweepctl doctor``: what is wrong with a device's line or a log, and what to do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import inform, plain_console, write_json
from tools.cli.paths import is_file, is_folder, is_there

if TYPE_CHECKING:
    from bridge.doctor import Examination, Finding

_NO_DEVICE = frozenset({"no_data", "no_answer", "wrong_baud", "echo", "other_node", "words"})
_NO_AGREEMENT = frozenset({"version"})


@click.command("doctor", epilog="Example:  sweepctl doctor /dev/ttyUSB0 --duration 20")
@click.argument("target", metavar="PORT|FILE")
@click.option(
    "--duration",
    "duration_s",
    type=options.Number(1.0, 86_400.0),
    default=10.0,
    show_default=True,
    help="With a PORT: examine it for this many seconds.",
)
@click.option("--listen", is_flag=True, help="With a PORT: only listen, send nothing.")
@click.option(
    "--find-baud",
    is_flag=True,
    help="With a serial PORT: try one baud rate after another until a device is found.",
)
@options.port_options
@options.json_option
def command(  # noqa: PLR0913 - what a port can be asked for
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
    """Diagnose a device's link, clock and sensors, and say what to do.

    FILE is a log of sweepctl, an MCAP file of another program (with fewer checks), a `candump -l`
    log or the raw bytes of a serial link. On a PORT the command connects and listens. It sends
    nothing that moves a wheel, and a robot that another host left moving stops.

    Exit status: 0 no problem found, 1 problems found, 3 no device to examine, 4 incompatible
    device.
    """
    path = Path(target)
    _check(target, path, listen=listen, find_baud=find_baud)
    if is_file(path):
        from bridge.doctor.log_visit import examine_log

        return _report(target, "log", examine_log(path), as_json=as_json)
    if find_baud:
        from bridge.doctor.attend import find_baud as search

        found = search(target, on_rate=lambda rate: inform(f"listening at {rate} baud"))
        if found is None:
            inform("no sweeper was heard at any rate")
            return 3
        inform(f"a sweeper is heard at {found} baud: --baud {found}")
        baud = found
    import threading

    from bridge.doctor.attend import attend
    from bridge.io.ports import open_port
    from tools.cli.signals import until_signalled

    port = open_port(target, baud=baud, dtr=dtr, rts=rts, bitrate=bitrate, lan=lan)
    note = getattr(port, "latency_note", None)
    if not as_json:
        how = "listening" if listen else "asking and listening; nothing moves"
        inform(f"{target}: {how}, {duration_s:g} s (Ctrl-C ends it sooner)")
    ended = threading.Event()
    with until_signalled(ended.set):  # what was seen is reported
        examination = attend(
            port, target, duration_s, node=node, ask=not listen, ended=ended.is_set
        )
    return _report(target, "port", examination, as_json=as_json, note=note)


def _check(target: str, path: Path, *, listen: bool, find_baud: bool) -> None:
    """See that what was asked for goes together."""
    if is_folder(path):
        raise click.UsageError(f"{target} is a folder; give a log, or a port.")
    if is_file(path) and (listen or find_baud):
        option = "--find-baud" if find_baud else "--listen"
        raise click.UsageError(f"{option} is for a port, and {target} is a file.")
    if find_baud and target.startswith("can:"):
        raise click.UsageError(f"--find-baud is for a serial port; for {target} give --bitrate.")
    if find_baud and "://" in target and not target.startswith("rfc2217://"):
        raise click.UsageError(f"--find-baud is for a serial port; {target} has no baud rate.")
    if path.suffix and not is_there(path) and "://" not in target and not target.startswith("can:"):
        from bridge.record.errors import LogReadError

        raise LogReadError(path, "there is no such file, and no such port")


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
        f.kind in _NO_AGREEMENT or (f.kind == "schema" and f.severity.value == "error")
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
    if _status(findings) == 0:  # notes are no trouble
        console.print("nothing is wrong", style="green")
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
        counts.append("clock not judged in so short a time")
    console.print(", ".join(counts), style="dim")
    for boot in figures["boots"][:1]:
        who = f"{boot['firmware']}, uid {boot['uid']}, booted by {boot['cause']}"
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
        others = f"rates other than the defaults: {', '.join(off)}"
        console.print(others, style="dim")
