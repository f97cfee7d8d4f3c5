"""Arcs of the hull where the range sensors measure an object in contact.

It also computes the arcs where the object is too near for a measurement.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from bridge.motion.robot_model import RangerMount, RobotModel

_STEPS = 1440
"""Number of bearings. They are a quarter of a degree apart."""
_BEAM_RAD = math.radians(1.0)
"""Minimum half-angle of a sensor's cone, rad. An infrared sensor has a cone of 0°, but its beam has
a width."""


class Arc(NamedTuple):
    """A piece of the hull: bearings of its ends from the axle's centre, counter-clockwise, rad."""

    begin_rad: float
    end_rad: float

    @property
    def width_rad(self) -> float:
        """Angle from one end to the other, rad."""
        return self.end_rad - self.begin_rad


class HullView(NamedTuple):
    """Pieces of the hull where an object in contact is measured, and where it is too near."""

    measured: list[Arc]
    too_near: list[Arc]
    """Arcs inside a sensor's cone, but nearer than its minimum range."""


def hull_view(model: RobotModel) -> HullView:
    """Return the arcs where an object in contact is measured, and where it is too near for that."""
    measured, too_near = [False] * _STEPS, [False] * _STEPS
    for step in range(_STEPS):
        bearing = 2.0 * math.pi * step / _STEPS
        x_m, y_m = model.radius_m * math.cos(bearing), model.radius_m * math.sin(bearing)
        ranges = [
            (mount, range_m)
            for mount in model.rangers.values()
            if (range_m := _range_in_cone(mount, x_m, y_m)) is not None
        ]
        measured[step] = any(m.min_range_m <= r <= m.max_range_m for m, r in ranges)
        too_near[step] = not measured[step] and any(r < m.min_range_m for m, r in ranges)
    return HullView(_arcs(measured), _arcs(too_near))


def blind_share(view: HullView) -> float:
    """Return the share of the hull where no range sensor measures an object in contact."""
    return 1.0 - sum(arc.width_rad for arc in view.measured) / (2.0 * math.pi)


def _range_in_cone(mount: RangerMount, x_m: float, y_m: float) -> float | None:
    """Return the distance of a point from a sensor; None: the point is outside its cone."""
    dx_m, dy_m = x_m - mount.x_m, y_m - mount.y_m
    off_rad = math.remainder(math.atan2(dy_m, dx_m) - mount.yaw_rad, 2.0 * math.pi)
    if abs(off_rad) > max(0.5 * mount.cone_rad, _BEAM_RAD):
        return None
    return math.hypot(dx_m, dy_m)


def _arcs(marks: list[bool]) -> list[Arc]:
    """Return the arcs of marked steps on the circle.

    Marked steps on both sides of step 0 are one arc.
    """
    width = 2.0 * math.pi / len(marks)
    if all(marks):
        return [Arc(0.0, 2.0 * math.pi)]
    first = marks.index(False)
    arcs, begun = [], None
    for step in range(first, first + len(marks) + 1):
        if marks[step % len(marks)]:
            begun = step if begun is None else begun
        elif begun is not None:
            arcs.append(Arc((begun - 0.5) * width, (step - 0.5) * width))
            begun = None
    return arcs
