"""``sweepctl monitor``: show the traffic on a port without sending anything."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import click

from tools.cli import options
from tools.cli.configuration import given
from tools.cli.console import flush, inform, is_drawable, plain_console, write_json, write_line
from tools.cli.interrupt import set_done
from tools.cli.port_options import PortAsked, port_options

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from bridge.api.robot import Robot
    from bridge.run.snapshot import Snapshot
    from bridge.session.monitor import Monitor
    from protocol.clock import HostNs
    from tools.live.heading import RunFacts
    from tools.live.live import EventLines
    from tools.live.monitor_view import JsonLines, MonitorLines, Nothing, RateTable

S = TypeVar("S")
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
@options.robot_option
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
    robot: Path | None,
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

    With --handshake the command completes the handshake, and the device sends its sensor data: a
    dashboard shows the state of an idle robot. The command sends nothing that can move a wheel. If
    another host left the robot moving, the handshake stops it.

    If another sweepctl has the port open, its dashboard is shown; TYPE, --raw and --node are then
    rejected. Without a terminal the state is printed as one line, four times a second. With --json
    one object is printed at the end.
    """
    from bridge.io.owner_client import has_owner
    from bridge.io.ports import link_of
    from bridge.session.monitor import Monitor, UnknownTypeError

    if as_json and jsonl:
        raise click.UsageError(
            "give --json (one object at the end) or --jsonl (one for each message), not both"
        )
    if lines and (as_json or jsonl):
        raise click.UsageError(f"--lines is for people: omit {'--json' if as_json else '--jsonl'}")
    if raw and as_json:
        raise click.UsageError("--json prints no messages: omit --raw, or use --jsonl")
    try:
        monitor = Monitor(link_of(port.name), types=types, node=port.node)
    except UnknownTypeError as error:
        raise click.BadParameter(str(error), param_hint="'[TYPE]...'") from None
    if handshake and (types or raw):
        raise click.UsageError("--handshake shows the device's state: omit TYPE and --raw")
    if given("robot") and not handshake:
        raise click.UsageError("--robot needs --handshake: the messages need no robot file")
    looker = _Looker(port.name, duration_s, as_json=as_json, jsonl=jsonl, lines=lines)
    if has_owner(port.name):
        _check_followed(port, types, raw=raw)
        looker.look_on_owner()
    elif handshake:
        looker.look_on_device(port, robot)
    else:
        view = _view(monitor, port.name, types, raw=raw, lines=lines, jsonl=jsonl, quiet=as_json)
        _listen(port, monitor, view, duration_s)
        if as_json:
            write_json(_account(monitor, port.name))
            set_done()
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
) -> Nothing | JsonLines | MonitorLines | RateTable:
    from tools.live.monitor_view import JsonLines, MonitorLines, Nothing, RateTable

    if quiet:
        return Nothing()
    if jsonl:
        return JsonLines(raw=raw)
    if lines or raw or not plain_console().is_interactive:
        return MonitorLines(raw=raw)
    return RateTable(monitor, port, types)


def _listen(
    port: PortAsked,
    monitor: Monitor,
    view: Nothing | JsonLines | MonitorLines | RateTable,
    duration_s: float | None,
) -> None:
    """Show the traffic until a signal arrives or the time is over."""
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
        click.UsageError: TYPE, --raw or --node was given.

    """
    asked = [*(f"TYPE ({name})" for name in types[:1]), *(["--raw"] if raw else [])]
    asked += [f"--node {port.node}"] if given("node") else []
    if asked:
        raise click.UsageError(
            f"another sweepctl has {port.name} open and reports its state, not the traffic: omit "
            f"{' and '.join(asked)}, or end the other process first"
        )


def _states(robot: Robot) -> Iterator[dict[str, Any]]:
    """Yield the state of a robot that this process is connected to, until the session ends.

    Raises:
        DeviceLostError: the device was lost and did not return.

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
    """Shows the state of a robot until a signal arrives or the time is over."""

    def __init__(
        self, port: str, duration_s: float | None, *, as_json: bool, jsonl: bool, lines: bool
    ) -> None:
        self._port, self._duration_s = port, duration_s
        self._as_json, self._jsonl, self._lines = as_json, jsonl, lines

    def look_on_owner(self) -> None:
        """Show the state that the port's owner reports; nothing is sent to the device."""
        from bridge.io.owner_client import watch

        if self._draws:
            from tools.live.shared import OwnerPicture

            picture = OwnerPicture(self._port, _STATES_HZ)
            self._draw(lambda: picture.snapshot, picture.events, picture.facts, picture.follow())
            return
        inform(f"another sweepctl has {self._port} open: its state is shown, not the traffic")
        self._print(watch(self._port, hz=_STATES_HZ), "owner")

    def look_on_device(self, port: PortAsked, robot_file: Path | None) -> None:
        """Connect to an idle device and show its state; the robot does not move.

        Raises:
            RobotFileError: the robot file is invalid.
            PortError: the port cannot be opened.
            NoDeviceError: no device answered.
            IncompatibleError: the device is incompatible.
            DeviceLostError: the device was lost and did not return.

        """
        import bridge
        from bridge.config import load_robot
        from bridge.record.sink import NullSink
        from tools.live.heading import RunFacts
        from tools.live.live import EventLines

        events = EventLines(NullSink(), plain=False)
        model, _ = load_robot(robot_file)
        with bridge.open(port.name, model=model, node=port.node, sink=events, **port.how) as robot:
            robot.wait_for_status()
            if self._draws:
                facts = RunFacts(self._port, note="connected; moves nothing, records nothing")
                self._draw(robot.look, events, facts, _states(robot))
            else:
                self._print(_states(robot), "state")

    @property
    def _draws(self) -> bool:
        """Whether the state is shown as a dashboard."""
        is_text = not (self._jsonl or self._as_json or self._lines)
        return is_text and plain_console().is_interactive and is_drawable()

    def _draw(
        self,
        look: Callable[[], Snapshot],
        events: EventLines,
        facts: RunFacts,
        states: Iterator[object],
    ) -> None:
        """Show a dashboard for as long as there are states."""
        from tools.live.live import Dashboard

        dashboard = Dashboard(look, events, None, facts)
        dashboard.start()
        try:
            for _ in self._until_end(states):
                pass
        finally:
            dashboard.stop()

    def _print(self, states: Iterator[dict[str, Any]], key: str) -> None:
        newest: dict[str, Any] = {}
        for newest in self._until_end(states):
            if self._jsonl:
                write_json(newest)
            elif not self._as_json:
                write_line(_line(newest))
            flush()
        if self._as_json:
            write_json({"port": self._port, key: newest})
            set_done()

    def _until_end(self, states: Iterator[S]) -> Iterator[S]:
        """Yield states until a signal arrives or the time is over."""
        from bridge.io import clock
        from tools.cli.signals import until_signalled

        ended: list[bool] = []
        duration_s = self._duration_s
        end_ns = None if duration_s is None else clock.now() + round(duration_s * 1e9)
        with until_signalled(lambda: ended.append(True)):
            for state in states:
                yield state
                if ended or (end_ns is not None and clock.now() >= end_ns):
                    return


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
