"""``sweepctl monitor``: what passes on a line, without a word of our own."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import click

from tools import options
from tools.port_options import PortAsked, port_options

if TYPE_CHECKING:
    from bridge.monitor import Monitor
    from protocol.clock import HostNs


def _complete_type(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    from protocol.catalogue import CATALOGUE

    return [name for name in CATALOGUE.by_name if name.startswith(incomplete)]


@click.command(
    "monitor",
    epilog="Example:  sweepctl monitor /dev/ttyUSB0 imu range --duration 10",
)
@port_options
@click.argument("types", nargs=-1, metavar="[TYPE]...", shell_complete=_complete_type)
@click.option("--raw", is_flag=True, help="Show each message's payload in hex too.")
@click.option(
    "--lines",
    is_flag=True,
    help="A line for each message on a terminal too, where a table is the default.",
)
@click.option("--jsonl", is_flag=True, help="A line of JSON for each message on stdout.")
@click.option(
    "--duration",
    "duration_s",
    type=options.Seconds(0.1, 1e6),
    help="End after this many seconds; else at Ctrl-C.",
)
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    port: PortAsked,
    types: tuple[str, ...],
    raw: bool,
    lines: bool,
    jsonl: bool,
    duration_s: float | None,
    as_json: bool,
) -> int:
    """Show what passes on PORT: messages decoded, rates, broken bytes in hex. Sends nothing.

    TYPE is a message's name (imu, range, status, velocity_setpoint, ...); without one, all. A
    device on a serial line that no host has agreed with says only hello, once a second. On a CAN
    bus both sides are heard. With --json one object is printed at the end.
    """
    from bridge.io.listen import Listener
    from bridge.io.ports import link_of
    from bridge.monitor import Monitor, UnknownTypeError
    from tools.monitor_view import JsonLines, Nothing, Table, TextLines
    from tools.stopping import until_signalled

    if as_json and jsonl:
        raise click.UsageError("--json prints one object at the end, --jsonl one for each message")
    try:
        monitor = Monitor(link_of(port.name), types=types, node=port.node)
    except UnknownTypeError as error:
        raise click.BadParameter(str(error), param_hint="'[TYPE]...'") from None
    if as_json:
        view: Nothing = Nothing()
    elif jsonl:
        view = JsonLines(raw=raw)
    elif lines or raw or not sys.stdout.isatty():
        view = TextLines(raw=raw)
    else:
        view = Table(monitor, port.name, types)
    opened = port.open()
    try:
        listener = Listener(opened)

        def take(data: bytes, now_ns: HostNs) -> None:
            monitor.tick(now_ns)
            for seen in monitor.receive(data, now_ns) if data else ():
                view.show(seen)
            view.tick(monitor, now_ns)

        with until_signalled(listener.end), view:
            listener.run(take, duration_s)
    finally:
        opened.close()
    if as_json:
        sys.stdout.write(json.dumps(_account(monitor, port.name)) + "\n")
    else:
        view.sum_up(monitor)
    return 0


def _account(monitor: Monitor, port: str) -> dict[str, object]:
    rates = monitor.rates_hz()
    return {
        "port": port,
        "bytes": monitor.bytes,
        "damaged": monitor.damaged,
        "rejected": monitor.rejected,
        "lost": monitor.lost,
        "strange_catalogues": {str(n): f"{h:08x}" for n, h in monitor.strangers.items()},
        "types": {
            name: {
                "count": count.count,
                "rate_hz": round(rates[name], 2),
                "newest": count.newest.fields if count.newest else None,
            }
            for name, count in monitor.types.items()
        },
    }
