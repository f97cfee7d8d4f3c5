"""The live picture of ``connect``: state, sensors and swept map on a terminal."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from rich.columns import Columns
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from bridge.telemetry import EventRecord, LogRecord, Severity
from protocol.values import Fault, Mode, StopCause, flag_labels, label
from tools.console import err

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

    from bridge.host import Host
    from bridge.record.sink import Sink
    from bridge.telemetry import Record

_MAP_WIDTH, _MAP_HEIGHT = 56, 40
_STYLES = {
    Severity.DEBUG: "dim",
    Severity.INFO: "",
    Severity.WARNING: "yellow",
    Severity.ERROR: "red",
}


class Teller:
    """Passes every record on, and tells people what matters as it happens."""

    def __init__(self, sink: Sink, *, plain: bool) -> None:
        """With ``plain`` each line is printed; else the last few are kept for the picture."""
        self._sink = sink
        self._plain = plain
        self.lines: deque[tuple[Severity, str]] = deque(maxlen=6)

    def write(self, record: Record) -> None:
        """Take one record."""
        self._sink.write(record)
        if isinstance(record, EventRecord):
            if record.severity is not Severity.DEBUG:
                self._tell(record.severity, f"{record.source}: {record.text}")
        elif isinstance(record, LogRecord):
            self._tell(record.severity, f"{record.source}: {record.text}")

    def close(self, summary: object = None) -> None:
        """The sink is closed by whoever opened it."""

    def _tell(self, severity: Severity, text: str) -> None:
        if self._plain:
            with contextlib.suppress(OSError):  # whoever read us has left; the run goes on
                err().print(Text(text, style=_STYLES[severity]), soft_wrap=True)
        else:
            self.lines.append((severity, text))


class LivePicture:
    """Draws a host four times a second, from its own thread."""

    def __init__(self, host: Host, teller: Teller) -> None:
        """Draws nothing before :meth:`start`."""
        self._host = host
        self._teller = teller
        self._live = Live(self, console=err(), refresh_per_second=4, transient=True)

    def start(self) -> None:
        """Begin to draw."""
        self._live.start()

    def stop(self) -> None:
        """Take the picture away."""
        self._live.stop()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """What is drawn now."""
        events = Text()
        for severity, text in list(self._teller.lines):
            events.append(text + "\n", style=_STYLES[severity])
        yield Columns([_state(self._host), Panel(swept_picture(self._host), title="swept")])
        yield events
        yield Text("space or s: stop the robot    Ctrl-C: end", style="dim")


def _state(host: Host) -> Table:
    state, mission = host.state, host.mission
    table = Table(show_header=False, box=None)
    table.add_column(style="dim")
    table.add_column(min_width=26)
    pose, status, power, ranges = host.estimator.pose, state.status, state.power, state.range
    table.add_row("session", f"{host.session.state.value}, run {mission.phase.value}")
    if status is not None:
        table.add_row("mode", label(Mode, status.mode))
        table.add_row("stop", label(StopCause, status.stop_cause))
        table.add_row("faults", ", ".join(flag_labels(Fault, status.faults)) or "none")
    table.add_row(
        "pose",
        f"{pose.x_m:+.2f} m {pose.y_m:+.2f} m {math.degrees(pose.theta_rad):+.0f}°",
    )
    table.add_row("speed", f"{host.estimator.v_m_s:+.2f} m/s")
    if ranges is not None:
        table.add_row(
            "range",
            f"front {_metres(ranges.ultrasonic_m)}, left {_metres(ranges.infrared_left_m)}, "
            f"right {_metres(ranges.infrared_right_m)}",
        )
    if power is not None:
        table.add_row("battery", f"{power.battery_v:.1f} V")
    if mission.runner is not None:
        table.add_row("planner", mission.runner.state.state)
    wire = host.session.link.statistics
    table.add_row("wire", f"{wire.frames_in} in, {wire.lost} lost, {wire.damaged} damaged")
    return table


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def swept_picture(host: Host) -> Text:
    """The swept map in half blocks, north up, the robot as a dot."""
    grid = host.swept.to_occupancy()
    cells = grid.cells == 0
    if cells.size == 0:
        return Text("nothing yet")
    step = max(1, math.ceil(cells.shape[1] / _MAP_WIDTH), math.ceil(cells.shape[0] / _MAP_HEIGHT))
    rows, columns = -(-cells.shape[0] // step), -(-cells.shape[1] // step)
    padded = np.zeros((rows * step + (rows % 2) * step, columns * step), dtype=bool)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    coarse = padded.reshape(-1, step, columns, step).mean(axis=(1, 3)) > 0.5  # noqa: PLR2004
    pose = host.estimator.pose
    size_m = grid.resolution_m * step
    robot = (
        int((pose.y_m - grid.origin_y_m) / size_m),
        int((pose.x_m - grid.origin_x_m) / size_m),
    )
    text = Text()
    for row in range(coarse.shape[0] - 1, 0, -2):
        for column in range(columns):
            if column == robot[1] and robot[0] in {row, row - 1}:
                text.append("●", style="bold cyan")
            else:
                text.append(" ▄▀█"[2 * coarse[row, column] + coarse[row - 1, column]], "green")
        text.append("\n")
    return text
