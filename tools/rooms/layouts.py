"""Layouts in which the paper's algorithm fails, as floor plans (rooms ``layout:NAME``).

The algorithm stores one obstacle and steps to one side only, which is not enough for these layouts.
The shapes have a source, but the sizes are our choice, with sides of 3 to 5 m. The robot starts in
the lower left corner and heads along the lower wall, as in the paper's rooms. Only the layouts that
test the start pose have another start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.floor_plan.floor_plan import FloorPlan, FloorPlanError
from bridge.motion.geometry import Pose2
from tools.rooms.generator import column, rectangle

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import Polygon

LAYOUT = "layout:"
"""Prefix of the names of these rooms."""
_CORNER = Pose2(0.18, 0.18, 0.0)
"""Start pose with 2 cm between the footprint and two walls, as in the paper's rooms."""
_MANY_SIDES = 64
"""Number of sides of the polygon for a round column. The polygon differs from a circle by at most
1 mm."""


@dataclass(frozen=True, slots=True)
class Layout:
    """A layout, with the expected coverage of the paper's algorithm."""

    what: str
    """Description."""
    expected: str
    """Expected coverage of the reachable floor, %, computed for a layout of other sizes."""
    walls: Polygon
    obstacles: tuple[Polygon, ...] = ()
    start: Pose2 = _CORNER


def layout_plan(name: str) -> FloorPlan:
    """Return the floor plan of a layout.

    Raises:
        FloorPlanError: no layout has this name.

    """
    layout = LAYOUTS.get(name)
    if layout is None:
        raise FloorPlanError(f"no layout {name!r}: give one of {', '.join(LAYOUTS)}")
    return FloorPlan(f"{LAYOUT}{name}", layout.walls, layout.obstacles, layout.start)


_ROOM = rectangle(0, 0, 4, 3)
_CENTRE = (2.0, 1.5)


LAYOUTS: dict[str, Layout] = {
    "wall-obstacle": Layout(
        "an obstacle touching a wall",
        "32",
        _ROOM,
        (rectangle(1.2, 1.0, 1.8, 3.0),),
    ),
    "diamond": Layout(
        "a diamond column",
        "20 to 35",
        _ROOM,
        (column(*_CENTRE, 0.6, 4),),
    ),
    "round-column": Layout(
        "a round column",
        "20 to 35",
        _ROOM,
        (column(*_CENTRE, 0.6, _MANY_SIDES),),
    ),
    "h-alcoves": Layout(
        "alcoves of an H",
        "42",
        (
            *((0.0, 0.0), (1.4, 0.0), (1.4, 1.2), (3.0, 1.2), (3.0, 0.0), (4.4, 0.0)),
            *((4.4, 4.0), (3.0, 4.0), (3.0, 2.8), (1.4, 2.8), (1.4, 4.0), (0.0, 4.0)),
        ),
    ),
    "mid-start": Layout("start in mid-room", "53", _ROOM, (), Pose2(*_CENTRE, 0.0)),
    "narrow-door": Layout(
        "a door of 0.6 m",
        "50 to 66",
        rectangle(0, 0, 5, 3),
        (rectangle(2.4, 0.0, 2.5, 1.2), rectangle(2.4, 1.8, 2.5, 3.0)),
    ),
    "nested-boxes": Layout(
        "a box in the occluded region of another",
        "83",
        _ROOM,
        (rectangle(1.0, 0.8, 1.5, 2.2), rectangle(2.3, 1.1, 2.8, 1.7)),
    ),
    "l-shaped": Layout(
        "an L",
        "82",
        ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.4, 4.0), (2.4, 1.8), (0.0, 1.8)),
    ),
    "u-shaped": Layout(
        "a U",
        "38",
        (
            *((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.6, 4.0)),
            *((2.6, 1.2), (1.4, 1.2), (1.4, 4.0), (0.0, 4.0)),
        ),
    ),
    "spiral": Layout(
        "a spiral corridor",
        "11",
        rectangle(0, 0, 4, 4),
        (
            rectangle(0.0, 0.9, 3.1, 1.0),
            rectangle(3.0, 1.0, 3.1, 3.1),
            rectangle(0.9, 3.0, 3.0, 3.1),
            rectangle(0.9, 1.9, 1.0, 3.0),
            rectangle(1.0, 1.9, 2.1, 2.0),
        ),
    ),
    "oblique-start": Layout(
        "an oblique start", "1 to 2", rectangle(0, 0, 5, 4), (), Pose2(0.25, 0.25, math.radians(45))
    ),
}
"""The layouts by name."""
