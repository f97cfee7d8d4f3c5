"""The first lines of the live picture: port, time, coverage, log and viewer of the run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.text import Text

from bridge.evaluation.metrics import CoverageMeter
from tools.cli.visible_text import one_line

if TYPE_CHECKING:
    from array import array

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel

_RESOLUTION_M = 0.01
"""Cell of the live coverage, metres: the coarsest that the figure is defined for."""
_PERIOD_S = 1.0
"""Time between two counts of the swept cells, seconds."""
_GAP = "   "


@dataclass(slots=True)
class RunFacts:
    """What the picture shows beside the robot."""

    port: str = ""
    log: str = ""
    page: str = ""
    """Address of the viewer, where one is served."""
    planner: str = ""
    plan: FloorPlan | None = None
    coverage: LiveCoverage | None = None
    """Where the room is known."""
    began_ns: int | None = None


class LiveCoverage:
    """The main figure of a run under way, from poses that the run's loop appends."""

    def __init__(self, plan: FloorPlan, model: RobotModel, poses: array[float]) -> None:
        """``poses``: time, x, y and heading of each control step, one after the other."""
        self._poses = poses
        # Here, before the run: it takes the interpreter for a tenth of a second.
        self._track = CoverageMeter(plan, model, _RESOLUTION_M).track()
        self._taken = 0
        self._counted_s = 0.0
        self._share = 0.0

    def share(self, now_s: float) -> float:
        """Swept share of what the mouth can reach, 0 to 1; counted once a second."""
        if now_s - self._counted_s >= _PERIOD_S:
            self._counted_s = now_s
            until = len(self._poses) // 4 * 4  # whole poses: another thread appends
            values = iter(self._poses[self._taken : until])
            self._taken = until
            for pose in zip(values, values, values, values, strict=True):
                self._track.add(*pose)
            self._share = self._track.share()
        return self._share


def heading(facts: RunFacts, swept_m2: float, now_ns: int, width: int, lines: int) -> Text:
    """The facts in at most so many lines; the viewer's address begins a line if it must."""
    parts = []
    if facts.port:
        parts.append(("port", facts.port))
    if facts.began_ns is not None:
        parts.append(("elapsed", _clock((now_ns - facts.began_ns) / 1e9)))
    if facts.coverage is not None:
        parts.append(("coverage", f"{100.0 * facts.coverage.share(now_ns / 1e9):.1f} %"))
    elif swept_m2 > 0.0:
        parts.append(("swept", f"{swept_m2:.1f} m²"))
    if facts.log:
        parts.append(("log", facts.log))
    if facts.page:
        parts.append(("viewer", facts.page))
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
            if place or len(name) + 1 + len(value) <= width:  # an address is for copying whole
                text.append(f"{_GAP if place else ''}{name} ", style="dim")
            text.append(value, style="bold" if name == "viewer" else "")
    return text


def _clock(seconds: float) -> str:
    whole = int(max(0.0, seconds))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
