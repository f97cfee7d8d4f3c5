"""The first lines of the dashboard: port, elapsed time, coverage, log and viewer."""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from rich.text import Text

from bridge.evaluation.metrics import CoverageMeter
from tools.cli.visible_text import one_line

if TYPE_CHECKING:
    from array import array

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel

_RESOLUTION_M = 0.01
"""Cell size of the live coverage, m: the maximum for which the metric is defined."""
_PERIOD_S = 1.0
"""Period at which the coverage is computed, s."""
_GAP = "   "
"""Space between two values."""


class CoverageSoFar(Protocol):
    """Coverage of a run in progress."""

    def share(self, now_s: float) -> float:
        """Return the swept share of the reachable floor, 0 to 1."""
        ...


TRAIL_STEP_M = 0.05
"""Distance between drawn positions of the path, m: less than a cell of the map."""
_TRAIL_POSITIONS = 2000
"""Maximum number of positions: 100 m of path."""


def _trail() -> deque[tuple[float, float]]:
    return deque(maxlen=_TRAIL_POSITIONS)


@dataclass(slots=True)
class RunFacts:
    """Facts of the run that the dashboard shows in addition to the robot's state."""

    port: str = ""
    log: str = ""
    """Path of the log."""
    page: str = ""
    """Address of the viewer's page; empty: no page is served."""
    planner: str = ""
    """Name of the planner; empty: none."""
    plan: FloorPlan | None = None
    """The room, if it is known."""
    coverage: CoverageSoFar | None = None
    """Coverage, if the room is known."""
    began_ns: int | None = None
    """Host time at which the run began, ns."""
    trail: deque[tuple[float, float]] = field(default_factory=_trail)
    """Positions of the path, m. Another thread may append: copy it before iterating."""
    note: str = ""
    """Text in the footer of a dashboard without keys."""
    foxglove: str = ""
    """Address for Foxglove; empty: the run is not served."""

    def follow(self, x_m: float, y_m: float) -> None:
        """Append a position if it is more than ``TRAIL_STEP_M`` from the newest position."""
        trail = self.trail
        if not trail or math.dist(trail[-1], (x_m, y_m)) > TRAIL_STEP_M:
            trail.append((x_m, y_m))


class LiveCoverage:
    """Coverage of a run in progress, from poses that the run's loop appends."""

    def __init__(self, plan: FloorPlan, model: RobotModel, poses: array[float]) -> None:
        """Prepare the metric. This takes 0.1 s, so make this object before the run.

        Args:
            plan: the room.
            model: the robot.
            poses: time, s, x and y, m, and heading, rad, of each control step in one flat array.

        """
        self._poses = poses
        self._track = CoverageMeter(plan, model, _RESOLUTION_M).track()
        self._taken = 0
        self._counted_s = 0.0
        self._share = 0.0
        self._lock = threading.Lock()
        """Lock, because the dashboards of other processes use their own threads."""

    def share(self, now_s: float) -> float:
        """Return the swept share of the reachable floor, 0 to 1; it is updated each second."""
        with self._lock:
            if now_s - self._counted_s >= _PERIOD_S:
                self._counted_s = now_s
                until = len(self._poses) // 4 * 4  # complete poses only, as another thread appends
                values = iter(self._poses[self._taken : until])
                self._taken = until
                for pose in zip(values, values, values, values, strict=True):
                    self._track.add(*pose)
                self._share = self._track.share()
            return self._share


def heading(facts: RunFacts, swept_m2: float, now_ns: int, width: int, lines: int) -> Text:
    """Lay out the facts in at most ``lines`` lines of ``width`` characters."""
    parts = []
    if facts.port:
        parts.append(("port", facts.port))
    if facts.began_ns is not None:
        parts.append(("elapsed", elapsed((now_ns - facts.began_ns) / 1e9)))
    if facts.coverage is not None:
        parts.append(("coverage", f"{100.0 * facts.coverage.share(now_ns / 1e9):.1f} %"))
    elif swept_m2 > 0.0:
        parts.append(("swept", f"{swept_m2:.1f} m²"))
    if facts.log:
        parts.append(("log", facts.log))
    if facts.page:
        parts.append(("viewer", facts.page))
    if facts.foxglove:
        parts.append(("Foxglove", facts.foxglove))
    return _laid_out(parts, width, lines)


def _laid_out(parts: list[tuple[str, str]], width: int, lines: int) -> Text:
    rows: list[list[tuple[str, str]]] = [[]]
    used = 0
    for name, value in parts:
        needs = len(name) + 1 + len(one_line(value)) + (len(_GAP) if rows[-1] else 0)
        if rows[-1] and used + needs > width and len(rows) < lines:
            rows.append([])
            used, needs = 0, needs - len(_GAP)
        rows[-1].append((name, one_line(value)))
        used += needs
    text = Text(no_wrap=True, overflow="ellipsis")
    for number, row in enumerate(rows):
        if number:
            text.append("\n")
        for place, (name, value) in enumerate(row):
            # In a narrow window the name is omitted, so that an address can be copied completely.
            if place or len(name) + 1 + len(value) <= width:
                text.append(f"{_GAP if place else ''}{name} ", style="dim")
            text.append(value, style="bold" if name == "viewer" else "")
    return text


def elapsed(seconds: float) -> str:
    """Return a time as hours, minutes and seconds."""
    whole = int(max(0.0, seconds))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
