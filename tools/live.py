"""The live picture of a run: state, pose and map, sensors, wire, planner and events.

On a terminal it takes the whole screen and gives it back at the end; elsewhere each event is a
plain line.
"""

from __future__ import annotations

import contextlib
import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group
from rich.layout import Layout
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from bridge.io import clock
from bridge.telemetry import EventRecord, LogRecord, Severity
from protocol.catalogue import CATALOGUE
from protocol.values import Contact, Fault, Mode, PlannerPhase, StopCause, flag_labels, label
from tools.console import err

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

    from bridge.host import Host
    from bridge.record.sink import Sink
    from bridge.telemetry import Record
    from tools.operating import Operating

_STYLES = {
    Severity.DEBUG: "dim",
    Severity.INFO: "",
    Severity.WARNING: "yellow",
    Severity.ERROR: "red",
}
_ARROWS = "→↗↑↖←↙↓↘"
_KEPT_EVENTS = 200
_NARROW = 90
"""Columns below which the map stands under the tables, not beside them."""
_RATE_NS = 1_000_000_000
_RATES_SHOWN = ("imu", "encoders", "range", "status", "power", "planner_state")


class Teller:
    """Passes every record on, and tells people what matters as it happens."""

    def __init__(self, sink: Sink, *, plain: bool) -> None:
        """With ``plain`` each line is printed; else the last are kept for the picture."""
        self._sink = sink
        self._plain = plain
        self._first_ns: int | None = None
        self.lines: deque[tuple[Severity, str]] = deque(maxlen=_KEPT_EVENTS)

    def write(self, record: Record) -> None:
        """Take one record."""
        self._sink.write(record)
        if isinstance(record, EventRecord):
            if record.severity is not Severity.DEBUG:
                self._tell(record.log_ns, record.severity, f"{record.source}: {record.text}")
        elif isinstance(record, LogRecord):
            self._tell(record.log_ns, record.severity, f"{record.source}: {record.text}")

    def close(self, summary: object = None) -> None:
        """The sink is closed by whoever opened it."""

    def _tell(self, log_ns: int, severity: Severity, text: str) -> None:
        if self._plain:
            with contextlib.suppress(OSError):  # whoever read us has left; the run goes on
                err().print(Text(text, style=_STYLES[severity]), soft_wrap=True)
            return
        if self._first_ns is None:
            self._first_ns = log_ns
        self.lines.append((severity, f"{(log_ns - self._first_ns) / 1e9:8.2f}  {text}"))


class Rates:
    """Messages a second of each type, from the link's own counts."""

    def __init__(self, host: Host) -> None:
        """Know none yet."""
        self._host = host
        self._at_ns = 0
        self._counts: dict[int, int] = {}
        self._bytes = (0, 0)
        self.hz: dict[str, float] = {}
        self.bytes_s = (0.0, 0.0)
        """In and out."""

    def look(self, now_ns: int) -> None:
        """Count anew where a second has passed."""
        since_s = (now_ns - self._at_ns) / 1e9
        if since_s * 1e9 < _RATE_NS:
            return
        statistics = self._host.session.link.statistics
        counts = dict(statistics.by_type)
        total = statistics.bytes_in, statistics.bytes_out
        if self._at_ns:
            self.hz = {
                CATALOGUE.by_type[t].name: (n - self._counts.get(t, 0)) / since_s
                for t, n in counts.items()
                if t in CATALOGUE.by_type
            }
            self.bytes_s = (
                (total[0] - self._bytes[0]) / since_s,
                (total[1] - self._bytes[1]) / since_s,
            )
        self._at_ns, self._counts, self._bytes = now_ns, counts, total


class LivePicture:
    """Draws a host four times a second, from its own thread."""

    def __init__(self, host: Host, teller: Teller, operating: Operating | None = None) -> None:
        """Draws nothing before :meth:`start`."""
        self._host = host
        self._teller = teller
        self._operating = operating
        self._rates = Rates(host)
        self._trail: deque[tuple[float, float]] = deque(maxlen=2000)
        self._live = Live(self, console=err(), refresh_per_second=4, screen=True)

    def start(self) -> None:
        """Begin to draw."""
        self._live.start()

    def stop(self) -> None:
        """Take the picture away."""
        self._live.stop()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """What is drawn now."""
        width, height = options.max_width, options.height or console.height
        self._rates.look(clock.now())
        yield self.layout(width, height)

    def layout(self, width: int, height: int) -> Layout:
        """Everything, in so many columns and rows."""
        host = self._host
        pose = host.estimator.pose
        if not self._trail or math.dist(self._trail[-1], pose[:2]) > 0.005:  # noqa: PLR2004 - metres
            self._trail.append((pose.x_m, pose.y_m))
        events = max(4, min(10, height // 4))
        body = max(8, height - events - 3)
        wide = width >= _NARROW
        left = Group(
            Panel(state_table(host), title="robot", title_align="left"),
            Panel(sensor_table(host), title="sensors", title_align="left"),
        )
        right = Group(
            Panel(planner_table(host), title="planner", title_align="left"),
            Panel(wire_table(host, self._rates), title="wire", title_align="left"),
        )
        columns = Layout()
        if wide:
            map_width = max(20, width - 2 * 44)
            picture = swept_picture(host, map_width - 4, 2 * (body - 2), self._trail)
            columns.split_row(
                Layout(left, size=44),
                Layout(Panel(picture, title="map, swept", title_align="left")),
                Layout(right, size=44),
            )
        else:
            columns.split_column(Layout(left), Layout(right, size=9))
        page = Layout()
        page.split_column(
            Layout(columns, size=body),
            Layout(Panel(self._events(events - 2), title="events", title_align="left")),
            Layout(self._footer(), size=2),
        )
        return page

    def _events(self, count: int) -> Text:
        text = Text(no_wrap=True, overflow="ellipsis")
        for severity, line in list(self._teller.lines)[-max(1, count) :]:
            text.append(line + "\n", style=_STYLES[severity])
        return text

    def _footer(self) -> Text:
        if self._operating is None:
            return Text("Ctrl-C: end", style="dim")
        text = Text(no_wrap=True, overflow="ellipsis")
        text.append(self._operating.message + "\n", style="bold")
        text.append(self._operating.help, style="dim")
        return text


def _rows(rows: list[tuple[str, str | Text]]) -> Table:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="ellipsis", no_wrap=True)
    for name, value in rows:
        table.add_row(name, value)
    return table


def state_table(host: Host) -> Table:
    """Session, run, mode, stop, faults, pose and battery."""
    state, mission, hello = host.state, host.mission, host.hello
    pose, status, power = host.estimator.pose, state.status, state.power
    rows: list[tuple[str, str | Text]] = [
        ("session", f"{host.session.state.value}, run {mission.phase.value}")
    ]
    if hello is not None:
        version = f"{hello.version_major}.{hello.version_minor}.{hello.version_patch}"
        rows.append(("device", f"{hello.name} {version}, node {host.session.node}"))
    if status is not None:
        cause = label(StopCause, status.stop_cause)
        stopped = status.stop_cause not in {StopCause.NONE, StopCause.SESSION_END}
        rows += [
            ("mode", label(Mode, status.mode)),
            ("stop", Text(cause, style="bold red" if stopped else "")),
        ]
        faults = ", ".join(flag_labels(Fault, status.faults))
        rows.append(("faults", Text(faults or "none", style="yellow" if faults else "")))
    degrees, rate = math.degrees(pose.theta_rad), math.degrees(host.estimator.yaw_rate_rad_s)
    rows += [
        ("pose", f"{pose.x_m:+.3f} m {pose.y_m:+.3f} m {degrees:+.0f}°"),
        ("speed", f"{host.estimator.v_m_s:+.2f} m/s {rate:+.0f}°/s"),
        ("path", f"{host.path_m:.1f} m"),
    ]
    if power is not None:
        rows.append(("battery", _battery(power.battery_v, host.model.battery_v)))
    return _rows(rows)


def _battery(volts: float, nominal_v: float) -> Text:
    # Four cells of 3.0 V empty to 4.2 V full, as shares of 3.6 V nominal.
    share = (volts / nominal_v - 0.75) / 0.25
    style = "red" if share < 0.2 else "yellow" if share < 0.4 else "green"  # noqa: PLR2004 - fifths
    return Text.assemble(f"{volts:.2f} V ", (_bar(share, 10), style))


def _bar(share: float, width: int) -> str:
    full = round(max(0.0, min(1.0, share)) * width)
    return "█" * full + "░" * (width - full)


def sensor_table(host: Host) -> Table:
    """Ranges, contacts, inertial sensor, encoders and currents."""
    state, model = host.state, host.model
    ranges, imu, encoders, power = state.range, state.imu, state.encoders, state.power
    rows: list[tuple[str, str | Text]] = []
    if ranges is not None:
        for name, value, mount in (
            ("front", ranges.ultrasonic_m, model.ultrasonic),
            ("left", ranges.infrared_left_m, model.infrared_left),
            ("right", ranges.infrared_right_m, model.infrared_right),
        ):
            rows.append((name, _range(value, mount.max_range_m)))
        touched = flag_labels(Contact, ranges.contacts)
        rows.append(("contact", Text(", ".join(touched) or "none", "red" if touched else "")))
    if imu is not None:
        rate = math.degrees(imu.gyro_z_rad_s)
        rows += [
            ("gyro z", f"{rate:+7.2f} °/s"),
            (
                "accel",
                f"{imu.accel_x_m_s2:+.2f} {imu.accel_y_m_s2:+.2f} {imu.accel_z_m_s2:+.2f} m/s²",
            ),
        ]
    if encoders is not None:
        rows.append(("counts", f"{encoders.left} {encoders.right}"))
    if power is not None:
        rows += [
            ("motors", f"{power.motor_left_a:.2f} A {power.motor_right_a:.2f} A"),
            ("logic", f"{power.logic_v:.2f} V"),
        ]
    return _rows(rows or [("", "no data yet")])


def _range(value: float | None, most_m: float) -> Text:
    if value is None:
        return Text("nothing", style="dim")
    return Text.assemble(f"{value:.3f} m ", (_bar(value / most_m, 12), "cyan"))


def planner_table(host: Host) -> Table:
    """What drives, and the paper's variables."""
    runner, device = host.mission.runner, host.state.planner
    if runner is None and device is None:
        return _rows([("", "no plan")])
    rows: list[tuple[str, str | Text]] = []
    if runner is not None:
        state = runner.state
        rows += [
            ("state", Text(state.state, style="bold")),
            ("T", str(state.turn_count)),
            ("D, Prev-D", f"{state.lane_distance_m:.2f} m {state.previous_lane_distance_m:.2f} m"),
            ("Length", f"{state.length_m:.2f} m, case {state.case or '-'}"),
        ]
        if state.target is not None:
            rows.append(("target", f"{state.target[0]:+.2f} m {state.target[1]:+.2f} m"))
    elif device is not None:
        rows.append(("on board", label(PlannerPhase, device.phase)))
    return _rows(rows)


def wire_table(host: Host, rates: Rates) -> Table:
    """Rates, losses and the clock."""
    wire, sync = host.session.link.statistics, host.sync
    shown = [
        f"{name.removesuffix('_state')} {rates.hz[name]:.0f}"
        for name in _RATES_SHOWN
        if name in rates.hz
    ]
    lines = [", ".join(shown[:3]), ", ".join(shown[3:])]
    bad = wire.lost or wire.damaged
    rows: list[tuple[str, str | Text]] = [
        ("Hz", lines[0] or "-"),
        ("", lines[1]),
        ("frames", f"{wire.frames_in} in, {wire.frames_out} out"),
        ("lost", Text(f"{wire.lost}, {wire.damaged} damaged", style="yellow" if bad else "")),
        ("B/s", f"{rates.bytes_s[0]:.0f} in, {rates.bytes_s[1]:.0f} out"),
    ]
    if sync.round_trip_ns:
        rows.append(("trip", f"{sync.round_trip_ns / 1e6:.2f} ms"))
    if sync.fit is not None:
        rows.append(("clock", f"±{sync.fit.bound_ns / 1e6:.3f} ms"))
    return _rows(rows)


def swept_picture(
    host: Host,
    columns: int = 56,
    rows: int = 40,
    trail: deque[tuple[float, float]] | None = None,
) -> Text:
    """The swept map and the way in half blocks, north up, the robot an arrow where it looks.

    At most ``columns`` wide, ``rows`` half lines high.
    """
    grid = host.swept.to_occupancy()
    pose = host.estimator.pose
    points = [*(trail or ()), (pose.x_m, pose.y_m)]
    swept = grid.cells == 0
    low_x = min(x for x, _ in points)
    low_y = min(y for _, y in points)
    high_x = max(x for x, _ in points)
    high_y = max(y for _, y in points)
    if swept.size:
        low_x, low_y = min(low_x, grid.origin_x_m), min(low_y, grid.origin_y_m)
        high_x = max(high_x, grid.origin_x_m + swept.shape[1] * grid.resolution_m)
        high_y = max(high_y, grid.origin_y_m + swept.shape[0] * grid.resolution_m)
    margin_m = 0.1
    low_x, low_y, high_x, high_y = (
        low_x - margin_m,
        low_y - margin_m,
        high_x + margin_m,
        high_y + margin_m,
    )
    size_m = max((high_x - low_x) / max(8, columns), (high_y - low_y) / max(8, rows), 0.02)
    wide = min(columns, max(1, math.ceil((high_x - low_x) / size_m)))
    high = max(1, math.ceil((high_y - low_y) / size_m))
    high += high % 2
    cells = np.zeros((high, wide), dtype=np.int8)
    if swept.size:
        marked = np.argwhere(swept)
        ys = ((marked[:, 0] + 0.5) * grid.resolution_m + grid.origin_y_m - low_y) / size_m
        xs = ((marked[:, 1] + 0.5) * grid.resolution_m + grid.origin_x_m - low_x) / size_m
        cells[np.clip(ys.astype(int), 0, high - 1), np.clip(xs.astype(int), 0, wide - 1)] = 1
    for x, y in points:
        cells[_at(y, low_y, size_m, high), _at(x, low_x, size_m, wide)] = 2
    robot = _at(pose.y_m, low_y, size_m, high), _at(pose.x_m, low_x, size_m, wide)
    return _half_blocks(cells, robot, pose.theta_rad)


def _at(value: float, low: float, size: float, count: int) -> int:
    return min(count - 1, max(0, int((value - low) / size)))


_INK = {1: "green", 2: "cyan"}


def _half_blocks(cells: np.ndarray, robot: tuple[int, int], theta_rad: float) -> Text:
    text = Text(no_wrap=True)
    arrow = _ARROWS[round(theta_rad / (math.pi / 4)) % 8]
    for row in range(cells.shape[0] - 1, 0, -2):
        for column in range(cells.shape[1]):
            above, below = int(cells[row, column]), int(cells[row - 1, column])
            if column == robot[1] and robot[0] in {row, row - 1}:
                text.append(arrow, style="bold yellow")
            elif above and below:
                text.append("▀", style=f"{_INK[above]} on {_INK[below]}")
            elif above or below:
                text.append("▀" if above else "▄", style=_INK[above or below])
            else:
                text.append(" ")
        text.append("\n")
    return text
