"""The dashboard of a run: state, pose and map, sensors, link, planner and events.

On a terminal it uses the whole screen and restores it at the end. Elsewhere each event is a plain
line.
"""

from __future__ import annotations

import contextlib
from collections import deque
from typing import TYPE_CHECKING

from rich.console import Group
from rich.layout import Layout
from rich.live import Live
from rich.panel import Panel
from rich.segment import Segments
from rich.text import Text

from bridge.io import clock
from bridge.run.ending import described
from bridge.session.event_kinds import EventKind
from bridge.session.records import EventRecord, IdentityRecord, LogRecord, Severity
from tools.cli.console import drop_queued, err, inform
from tools.cli.visible_text import one_line
from tools.live.heading import RunFacts, heading
from tools.live.map import legend, swept_picture
from tools.live.tables import (
    Rates,
    compact_table,
    link_table,
    planner_table,
    plugged_table,
    sensor_table,
    state_table,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console, ConsoleOptions, RenderResult

    from bridge.record.sink import Sink
    from bridge.run.snapshot import Snapshot
    from bridge.session.records import Record
    from tools.live.operating import Operating

_STYLES = {
    Severity.DEBUG: "dim",
    Severity.INFO: "",
    Severity.WARNING: "yellow",
    Severity.ERROR: "red",
}
_KEPT_EVENTS = 200
"""Number of event lines kept for the dashboard."""
_STATUS_NS = 5_000_000_000
"""Period of the status lines without a dashboard, ns."""
_NARROW = 110
"""Width of the window below which one compact table replaces the four tables, columns."""
_LOW = 22
"""Height of the tables' area below which one compact table replaces the four tables, rows."""
_LOWEST = 15
"""Height of the window below which heading and events are omitted, rows."""
_FOOTER = 2
"""Height of the footer, rows: the message and the keys."""
_COLUMN = 44
"""Width of a column of tables, characters."""
_TABLE = 46
"""Width of the compact table, characters."""
_MIN_MAP = 10
"""Width below which the map is omitted, characters."""
_MIN_ROWS = 6
"""Height of the map below which its legend is omitted, rows."""
_TALL = 24
"""Height of the window from which the heading may have three lines instead of two, rows."""


class EventLines:
    """A sink that passes every record on and shows events and device logs as lines."""

    def __init__(self, sink: Sink, *, plain: bool) -> None:
        """Pass records on to ``sink`` and keep the newest lines; with ``plain`` print them too."""
        self._sink = sink
        self._plain = plain
        self._first_ns: int | None = None
        self._status_ns = 0
        self.status: Callable[[], str] | None = None
        """Returns the status line that is printed every 5 s with ``plain``."""
        self.on_ready: Callable[[], None] = lambda: None
        """Called after each handshake with a device, also after a loss."""
        self.lines: deque[tuple[Severity, str]] = deque(maxlen=_KEPT_EVENTS)
        """The newest lines with their severity."""

    def write(self, record: Record) -> None:
        """Pass a record on, and show its line if it has one."""
        self._sink.write(record)
        if self._first_ns is None:
            self._first_ns = self._status_ns = record.log_ns
        if isinstance(record, EventRecord):
            if record.severity is not Severity.DEBUG and not _ends_run(record):
                self._show_line(record.log_ns, record.severity, f"{record.source}: {record.text}")
        elif isinstance(record, LogRecord):
            self._show_line(record.log_ns, record.severity, f"{record.source}: {record.text}")
        elif isinstance(record, IdentityRecord):
            self.on_ready()
        if self._plain and self.status and record.log_ns - self._status_ns >= _STATUS_NS:
            self._status_ns = record.log_ns
            self._print(record.log_ns, Severity.INFO, self.status())

    def close(self, summary: object = None) -> None:
        """Do nothing: the code that opened the sink closes it."""

    def _show_line(self, log_ns: int, severity: Severity, text: str) -> None:
        self.lines.append((severity, self._line(log_ns, text)))
        if self._plain:
            self._print(log_ns, severity, text)

    def _print(self, log_ns: int, severity: Severity, text: str) -> None:
        with contextlib.suppress(OSError):  # stderr is closed; the run continues
            inform(self._line(log_ns, text), style=_STYLES[severity])

    def _line(self, log_ns: int, text: str) -> str:
        return f"{(log_ns - (self._first_ns or 0)) / 1e9:8.2f}  {one_line(text)}"


def _ends_run(event: EventRecord) -> bool:
    """Return whether an event is a failure of the session, which the run's last line repeats."""
    return event.source == "session" and (
        event.kind == EventKind.FAILED or event.severity is Severity.ERROR
    )


class Dashboard:
    """Draws the state of a run three times a second, in its own thread."""

    def __init__(
        self,
        look: Callable[[], Snapshot],
        events: EventLines,
        operating: Operating | None = None,
        facts: RunFacts | None = None,
    ) -> None:
        """Prepare; :meth:`start` begins to draw.

        Args:
            look: returns the present snapshot of the run.
            events: its lines are shown.
            operating: its message and keys are shown; None: there is no keyboard.
            facts: facts of the run for the heading.

        """
        self._look = look
        self._facts = facts or RunFacts()
        self._events = events
        self._operating = operating
        self._rates = Rates(look)
        self._live = Live(self, console=err(), refresh_per_second=3, screen=True)

    def start(self) -> None:
        """Switch to a full screen and begin to draw."""
        if self._facts.began_ns is None:
            self._facts.began_ns = clock.now()
        self._live.start()

    def stop(self) -> None:
        """Stop drawing and restore the screen."""
        drop_queued()  # drops older frames, so that the sequence that restores the terminal fits
        self._live.stop()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the dashboard in its present state."""
        width, height = options.max_width, options.height or console.height
        try:
            self._rates.look(clock.now())
            # Rendered here, because an exception in Rich's drawing thread would end the thread.
            drawn = list(console.render(self.layout(width, height), options))
        except Exception as error:  # noqa: BLE001 - the drawing thread must continue
            yield Text(f"the dashboard cannot be drawn: {one_line(described(error))}", "red")
        else:
            yield Segments(drawn)

    def layout(self, width: int, height: int, now_ns: int | None = None) -> Layout:
        """Lay the dashboard out.

        Args:
            width: width of the window, columns.
            height: height of the window, rows.
            now_ns: host time that is shown, ns; None: now.

        """
        host = self._look()
        pose = host.estimator.pose
        self._facts.follow(pose.x_m, pose.y_m)
        # A low window shows only the compact table and the footer with the keys.
        facts, now_ns = self._facts, clock.now() if now_ns is None else now_ns
        heads = 0 if height < _LOWEST else 2 if height < _TALL else 3
        top = heading(facts, host.swept.swept_m2, now_ns, width, heads) if heads else Text()
        heads = len(top.plain.splitlines()) if heads else 0
        events = max(4, min(10, height // 4)) if height >= _LOWEST else 0
        body = max(8, height - heads - events - 3) if events else max(1, height - _FOOTER)
        wide = width >= _NARROW
        columns = Layout()
        if wide and body >= _LOW:
            self._three(host, columns, width, body, now_ns / 1e9)
        else:
            table = Panel(
                compact_table(host, self._rates, now_ns / 1e9), title="robot", title_align="left"
            )
            map_width = width - _TABLE
            if map_width < _MIN_MAP:
                columns.update(table)
            else:
                columns.split_row(
                    Layout(table, size=_TABLE), Layout(self._map(host, map_width, body))
                )
        page = Layout()
        happened = Layout(Panel(self._event_text(events - 2), title="events", title_align="left"))
        page.split_column(
            *([Layout(top, size=heads)] if heads else []),
            Layout(columns, size=body),
            *([happened] if events else []),
            Layout(self._footer(width), size=_FOOTER),
        )
        return page

    def _map(self, host: Snapshot, width: int, height: int) -> Panel:
        """Draw the map in a frame with its legend."""
        plan, inside = self._facts.plan, width - 4
        shown = legend(plan, inside - 2)
        below = shown if len(shown) > 1 else []
        rows = max(1, height - 2 - len(below))
        picture = swept_picture(host, inside, max(2, 2 * rows), self._facts.trail.copy(), plan)
        subtitle = None if below else shown[0]
        content = Group(picture, *below) if rows >= _MIN_ROWS else picture
        return Panel(content, title="map", title_align="left", subtitle=subtitle)

    def _three(self, host: Snapshot, columns: Layout, width: int, body: int, now_s: float) -> None:
        """Fill ``columns`` with two columns of tables and the map between them."""
        map_width, plugged = max(20, width - 2 * _COLUMN), plugged_table(host, now_s)
        left = Group(
            Panel(state_table(host, now_s), title="robot", title_align="left"),
            Panel(sensor_table(host, now_s), title="sensors", title_align="left"),
        )
        right = Group(
            Panel(planner_table(host, self._facts.planner), title="planner", title_align="left"),
            Panel(link_table(host, self._rates), title="link", title_align="left"),
            *([Panel(plugged, title="plug-ins", title_align="left")] if plugged else []),
        )
        columns.split_row(
            Layout(left, size=_COLUMN),
            Layout(self._map(host, map_width, body)),
            Layout(right, size=_COLUMN),
        )

    def _event_text(self, count: int) -> Text:
        text = Text(no_wrap=True, overflow="ellipsis")
        for severity, line in list(self._events.lines)[-max(1, count) :]:
            text.append(one_line(line) + "\n", style=_STYLES[severity])
        return text

    def _footer(self, width: int) -> Text:
        if self._operating is None:
            return Text(f"{self._facts.note}\nCtrl-C: end".lstrip(), style="dim")
        text = Text(no_wrap=True, overflow="ellipsis")
        text.append(self._operating.note + "\n", style="bold")
        text.append(self._operating.help(width), style="dim")
        return text
