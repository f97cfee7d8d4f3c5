"""The dashboard of a fleet: a row for each robot, their events, and the keys."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any, Protocol

from rich.layout import Layout
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from bridge.io import clock
from tools.cli.console import drop_queued, err
from tools.cli.visible_text import one_line
from tools.live.heading import elapsed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console, ConsoleOptions, RenderResult

    from tools.fleet.member import Ended, Stopped, Target

_KEPT_EVENTS = 200
_MIN_EVENTS = 3
"""Minimum height of the list of events with its frame, rows."""
_WIDE = 110
"""Width from which the table also has the pose and the log, columns."""
_MIDDLE = 80
"""Width from which the table also has path and planner, columns."""
_NARROW = 60
"""Width from which the table also has battery and speed, columns."""
_KEYS = "space s: STOP ALL   Ctrl-C: end all"
_ORDERLY = {"none", "session_end"}
"""Names of the stop causes that are not a stop for safety."""


class ShownMember(Protocol):
    """What the dashboard shows of a :class:`tools.fleet.member.Member`."""

    @property
    def target(self) -> Target:
        """The robot."""

    @property
    def status(self) -> dict[str, Any] | None:
        """Newest state of the robot."""

    @property
    def ended(self) -> Ended | None:
        """How its process ended."""

    @property
    def stopped(self) -> Stopped | None:
        """Result of the newest stop."""


class ShownFleet(Protocol):
    """What the dashboard shows of a :class:`tools.fleet.fleet.Fleet`."""

    @property
    def members(self) -> Sequence[ShownMember]:
        """The robots."""

    @property
    def message(self) -> str:
        """Effect of the newest request."""

    @property
    def unconfirmed(self) -> Sequence[str]:
        """Robots that have not confirmed the stop."""


class FleetDashboard:
    """Draws the fleet three times a second, in its own thread."""

    def __init__(self, *, has_keys: bool) -> None:
        """Prepare; :meth:`start` begins to draw."""
        self.fleet: ShownFleet | None = None
        """The fleet; None: not started yet."""
        self._has_keys = has_keys
        self.began_ns: int = clock.now()
        """Host time of the start, ns."""
        self._lines: deque[tuple[str, str]] = deque(maxlen=_KEPT_EVENTS)
        self._live = Live(self, console=err(), refresh_per_second=3, screen=True)

    def line(self, label: str, line: str, *, is_error: bool = False) -> None:
        """Add a line of a robot's process; callable from any thread."""
        del is_error
        self._lines.append((label, one_line(line)))

    def start(self) -> None:
        """Switch to a full screen and begin to draw."""
        self._live.start()

    def stop(self) -> None:
        """Stop drawing and restore the screen."""
        drop_queued()  # drops older frames, so that the sequence that restores the terminal fits
        self._live.stop()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the dashboard in its present state."""
        width, height = options.max_width, options.height or console.height
        yield self.page(width, height)

    def page(self, width: int, height: int, now_ns: int | None = None) -> Layout:
        """Lay out the dashboard for a window of this size, columns and rows."""
        members: Sequence[ShownMember] = () if self.fleet is None else self.fleet.members
        now_ns = clock.now() if now_ns is None else now_ns
        running = sum(member.ended is None for member in members)
        top = Text(no_wrap=True, overflow="ellipsis")
        for name, value in (
            ("fleet", f"{len(members)} robots, {running} running"),
            ("elapsed", elapsed((now_ns - self.began_ns) / 1e9)),
        ):
            top.append(f"{name} ", style="dim")
            top.append(f"{value}   ")
        rows = max(4, min(len(members) + 3, height - 3))
        events = height - rows - 3
        robots = Panel(table(members, width), title="robots", title_align="left")
        happened = Panel(self._events(members, events - 2), title="events", title_align="left")
        layout = Layout()
        layout.split_column(
            Layout(top, size=1),
            Layout(robots, size=rows),
            # In a low window the robots are more important than their events.
            *([Layout(happened, size=events)] if events >= _MIN_EVENTS else []),
            Layout(self._footer(), size=2),
        )
        return layout

    def _events(self, members: Sequence[ShownMember], count: int) -> Text:
        wide = max((len(one_line(member.target.label)) for member in members), default=0)
        text = Text(no_wrap=True, overflow="ellipsis")
        for label, line in list(self._lines)[-max(1, count) :]:
            text.append(f"{one_line(label):<{wide}}  ", style="bold")
            text.append(line + "\n")
        return text

    def _footer(self) -> Text:
        text = Text(no_wrap=True, overflow="ellipsis")
        fleet = self.fleet
        message = "" if fleet is None else fleet.message
        is_bad = fleet is not None and bool(fleet.unconfirmed)
        text.append(one_line(message) + "\n", style="bold red" if is_bad else "bold")
        text.append(_KEYS if self._has_keys else "Ctrl-C: end all", style="dim")
        return text


def table(members: Sequence[ShownMember], width: int) -> Table:
    """Return a row for each robot; a narrow window has fewer columns."""
    made = Table(box=None, pad_edge=False, expand=True)
    names = ["robot", "state", "stop"]
    names += ["battery", "speed"] if width >= _NARROW else []
    names += ["path", "planner"] if width >= _MIDDLE else []
    names += ["pose", "log"] if width >= _WIDE else []
    for name in names:
        made.add_column(
            name, no_wrap=True, overflow="ellipsis", ratio=1 if name == "state" else None
        )
    for member in members:
        cells = _cells(member)
        made.add_row(*(cells[name] for name in names))
    return made


def _cells(member: ShownMember) -> dict[str, Text]:
    status: dict[str, Any] = member.status or {}
    dim = "dim" if member.ended is not None else ""
    pose, power = status.get("pose"), status.get("power")
    path_m = status.get("path_m")
    # Without messages from the robot, the estimate is old.
    speed = status.get("v_m_s") if status.get("session") == "ready" and not dim else None
    shown_pose = "-"
    if pose is not None:
        heading_deg = math.degrees(pose["theta_rad"])
        shown_pose = f"{pose['x_m']:+.2f} {pose['y_m']:+.2f} m {heading_deg:+.0f}°"
    return {
        "robot": Text(one_line(member.target.label), "bold"),
        "state": _state(member),
        "stop": _stop(member),
        "battery": Text("-" if power is None else f"{power['battery_v']:.2f} V", dim),
        "speed": Text("-" if speed is None else f"{speed:.2f} m/s", dim),
        "path": Text("-" if path_m is None else f"{path_m:.1f} m", dim),
        "planner": Text(one_line(str(status.get("planner") or "-")), dim),
        "pose": Text(shown_pose, dim),
        "log": Text(one_line(member.target.log.name), "dim"),
    }


def _state(member: ShownMember) -> Text:
    ended, status = member.ended, member.status
    if ended is not None:
        style = {"complete": "green", "stopped": "yellow"}.get(ended.outcome, "red")
        return Text(one_line(f"{ended.outcome}: {ended.reason}"), style)
    if member.stopped is not None and member.stopped.confirmed:
        return Text("stopped", "yellow")
    if status is None:
        return Text("starting", "dim")
    faults = status.get("faults") or []
    text = f"{status['session']}, {status['run']}"
    if status["session"] != "ready":
        return Text(text, "red")
    return Text(", ".join([text, *faults]), "yellow" if faults else "")


def _stop(member: ShownMember) -> Text:
    stopped = member.stopped
    if stopped is not None:
        if stopped.confirmed:
            return Text("confirmed", "green")
        return Text("NOT CONFIRMED", "bold red")
    cause = (member.status or {}).get("stop")
    if cause is None or cause in _ORDERLY:
        return Text("-", "dim")
    return Text(one_line(str(cause)), "yellow")
