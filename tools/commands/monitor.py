"""``sweepctl monitor``: show the traffic on a port without sending anything."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import flush, inform, plain_console, write_json, write_line
from tools.cli.interrupt import set_done
from tools.cli.port_options import PortAsked, port_options

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.api.robot import Robot
    from bridge.session.monitor import Monitor
    from protocol.clock import HostNs
    from tools.live.monitor_view import JsonLines, Nothing, Table, TextLines

_STATES_HZ = 4.0
"""Rate at which the state of a robot is shown, Hz."""


def _complete_type(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    from protocol.schema.catalogue import CATALOGUE

    return [name for name in CATALOGUE.by_name if name.startswith(incomplete)]


@click.command(
    "monitor",
    epilog="Example:  sweepctl monitor /dev/ttyUSB0 imu range --duration 10",
)
@port_options
@click.argument("types", nargs=-1, metavar="[TYPE]...", shell_complete=_complete_type)
@click.option(
    "--handshake",
    is_flag=True,
    help="Connect to the device, so that it sends its sensor data, and show its state. Nothing "
    "moves.",
)
@click.option("--raw", is_flag=True, help="Also show each payload in hex.")
@click.option(
    "--lines",
    is_flag=True,
    help="Print a line for each message instead of a table.",
)
@click.option("--jsonl", is_flag=True, help="Print a JSON object for each message on stdout.")
@click.option(
    "--duration",
    "duration_s",
    type=options.Number(0.1, 1e6),
    metavar="N",
    help="End after N seconds.  [default: at Ctrl-C]",
)
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    port: PortAsked,
    types: tuple[str, ...],
    handshake: bool,
    raw: bool,
    lines: bool,
    jsonl: bool,
    duration_s: float | None,
    as_json: bool,
) -> int:
    """Show the traffic on PORT: decoded messages, rates and damaged bytes. Sends nothing.

    TYPE is the name of a message (imu, range, status, velocity_setpoint, ...); without it all are
    shown. On a serial line a device that no host is connected to sends only a hello each second. On
    a CAN bus the frames of both sides are shown.

    With --handshake the command completes the handshake, and the device sends its sensor data: the
    state of an idle robot is shown four times a second. Nothing that is sent can move a wheel, and
    a robot that another host left moving stops.

    If another sweepctl has the port open, its state is shown four times a second; TYPE, --raw and
    --node are then rejected. With --json one object is printed at the end.
    """
    from bridge.io.owner_client import has_owner
    from bridge.io.ports import link_of
    from bridge.session.monitor import Monitor, UnknownTypeError

    if as_json and jsonl:
        raise click.UsageError(
            "give --json (one object at the end) or --jsonl (one for each message), not both"
        )
    try:
        monitor = Monitor(link_of(port.name), types=types, node=port.node)
    except UnknownTypeError as error:
        raise click.BadParameter(str(error), param_hint="'[TYPE]...'") from None
    if handshake and (types or raw):
        raise click.UsageError("--handshake shows the device's state: omit TYPE and --raw")
    looker = _Looker(port.name, duration_s, as_json=as_json, jsonl=jsonl, lines=lines)
    if has_owner(port.name):
        _check_followed(port, types, raw=raw)
        looker.look_on_owner()
    elif handshake:
        looker.look_on_device(port)
    else:
        view = _view(monitor, port.name, types, raw=raw, lines=lines, jsonl=jsonl, quiet=as_json)
        _listen(port, monitor, view, duration_s)
        if as_json:
            write_json(_account(monitor, port.name))
        else:
            view.sum_up(monitor)
    return 0


def _view(  # noqa: PLR0913 - how the traffic is shown
    monitor: Monitor,
    port: str,
    types: tuple[str, ...],
    *,
    raw: bool,
    lines: bool,
    jsonl: bool,
    quiet: bool,
) -> Nothing | JsonLines | TextLines | Table:
    from tools.live.monitor_view import JsonLines, Nothing, Table, TextLines

    if quiet:
        return Nothing()
    if jsonl:
        return JsonLines(raw=raw)
    if lines or raw or not plain_console().is_interactive:
        return TextLines(raw=raw)
    return Table(monitor, port, types)


def _listen(
    port: PortAsked,
    monitor: Monitor,
    view: Nothing | JsonLines | TextLines | Table,
    duration_s: float | None,
) -> None:
    """Show the traffic until a signal comes or the time is over."""
    from bridge.io import clock
    from bridge.io.port_loop import Listening, serve
    from protocol.clock import HostNs
    from tools.cli.signals import until_signalled

    opened = port.open()
    asked_to_end: list[bool] = []

    def end() -> None:
        asked_to_end.append(True)
        opened.wake()

    def take(data: bytes, now_ns: HostNs) -> None:
        monitor.tick(now_ns)
        for seen in monitor.receive(data, now_ns) if data else ():
            view.show(seen)
        view.tick(monitor, now_ns)

    end_ns = None if duration_s is None else HostNs(clock.now() + round(duration_s * 1e9))
    try:
        with until_signalled(end), view:
            serve(opened, Listening(take), end_ns, lambda: bool(asked_to_end))
    finally:
        opened.close()


def _check_followed(port: PortAsked, types: tuple[str, ...], *, raw: bool) -> None:
    """Reject the options that do not work if another process owns the port.

    Raises:
        click.UsageError: one was given.

    """
    asked = [*(f"TYPE ({name})" for name in types[:1]), *(["--raw"] if raw else [])]
    asked += [f"--node {port.node}"] if port.node is not None else []
    if asked:
        raise click.UsageError(
            f"another sweepctl has {port.name} open and reports its state, not the traffic: omit "
            f"{' and '.join(asked)}, or end the other process first"
        )


def _states(robot: Robot) -> Iterator[dict[str, Any]]:
    """Yield the state of a robot of this process until its session ends.

    Raises:
        DeviceLostError: the device was lost for good.

    """
    from bridge.errors import DeviceLostError
    from bridge.io import clock

    while True:
        known = robot.snapshot()
        yield known
        if known["run"] == "done":
            raise DeviceLostError("the device was lost, and did not come back")
        clock.pause(1.0 / _STATES_HZ)


class _Looker:
    """Shows the state of a robot until a signal comes or the time is over."""

    def __init__(
        self, port: str, duration_s: float | None, *, as_json: bool, jsonl: bool, lines: bool
    ) -> None:
        self._port, self._duration_s = port, duration_s
        self._as_json, self._jsonl, self._lines = as_json, jsonl, lines

    def look_on_owner(self) -> None:
        """Show the state that the port's owner reports; nothing is sent to the device."""
        from bridge.io.owner_client import watch

        inform(f"another sweepctl has {self._port} open: its state is shown, not the traffic")
        states = watch(self._port, hz=_STATES_HZ)
        self._show(states, "state reported by another sweepctl", "owner")

    def look_on_device(self, port: PortAsked) -> None:
        """Connect to an idle device and show its state; nothing moves.

        Raises:
            PortError: the port cannot be opened.
            NoDeviceError: no device answered.
            IncompatibleError: the device is incompatible.
            DeviceLostError: the device was lost for good.

        """
        import bridge

        with bridge.open(port.name, node=port.node, **port.how) as robot:
            robot.wait_for_status()
            self._show(_states(robot), "connected, moves nothing", "state")
        set_done()

    def _show(self, states: Iterator[dict[str, Any]], how: str, key: str) -> None:
        from bridge.io import clock
        from tools.cli.signals import until_signalled
        from tools.live.monitor_view import StateTable

        ended: list[bool] = []
        newest: dict[str, Any] = {}
        duration_s = self._duration_s
        end_ns = None if duration_s is None else clock.now() + round(duration_s * 1e9)
        plain = self._jsonl or self._as_json or self._lines or not plain_console().is_interactive
        table = None if plain else StateTable(self._port, how)
        with until_signalled(lambda: ended.append(True)), table or contextlib.nullcontext():
            for newest in states:
                if self._jsonl:
                    write_json(newest)
                elif table is not None:
                    table.show(newest)
                elif not self._as_json:
                    write_line(_line(newest))
                flush()
                if ended or (end_ns is not None and clock.now() >= end_ns):
                    break
        if self._as_json:
            write_json({"port": self._port, key: newest})


def _line(known: dict[str, Any]) -> str:
    pose, ranges, power = known["pose"], known["range"], known["power"]
    parts = [f"{known['session']}/{known['run']}", f"mode={known['mode']}", f"stop={known['stop']}"]
    if known["faults"]:
        parts.append("faults=" + "|".join(known["faults"]))
    parts.append(f"pose={pose['x_m']:+.3f}m,{pose['y_m']:+.3f}m,{pose['theta_rad']:+.3f}rad")
    parts.append(f"v={known['v_m_s']:+.3f}m/s")
    if ranges is not None:
        seen = [ranges[k] for k in ("ultrasonic_m", "infrared_left_m", "infrared_right_m")]
        parts.append("range=" + ",".join("-" if r is None else f"{r:.3f}m" for r in seen))
    if power is not None:
        parts.append(f"battery={power['battery_v']:.2f}V")
    wire = known["wire"]
    parts.append(f"lost={wire['lost']} damaged={wire['crc_errors']}")
    return " ".join(parts)


def _account(monitor: Monitor, port: str) -> dict[str, object]:
    rates = monitor.rates_hz()
    return {
        "port": port,
        "bytes": monitor.bytes,
        "damaged": monitor.damaged,
        "rejected": monitor.rejected,
        "lost": monitor.lost,
        "other_nodes": sorted(monitor.others),
        "strange_catalogues": {str(n): f"{h:08x}" for n, h in monitor.foreign_catalogues.items()},
        "types": {
            name: {
                "count": count.count,
                "rate_hz": round(rates[name], 2),
                "newest": count.newest.fields if count.newest else None,
            }
            for name, count in monitor.types.items()
        },
    }
