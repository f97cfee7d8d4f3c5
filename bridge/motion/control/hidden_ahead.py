"""What the ultrasonic saw ahead and sees no more: it left the cone, and may stand in the way.

A cone of half angle α widens less than the body is broad: a thing at y beside the axis is seen
from afar and leaves the cone at the range y / tan α. Where the echo was lost tells, therefore,
how far aside the thing is, though not on which side.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.control.braking import Braking

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

TOUCH_M_S = 0.026
"""Speed along the normal at which a touch is none of the collisions (0.03 m/s)."""
_LOST_M = 0.08
"""A range that grows by more than this between readings is of another thing."""
_SAME_M = 0.06
"""An echo so near to where a hidden thing should be is that thing: it is not hidden."""
_MARGIN_M = 0.012
_TURNED_RAD = 0.15
"""After turning so far it is not known where it is."""
_PAST_M, _ASIDE_M = 0.01, 0.02
"""So far past the touch that did not come, were it farther aside by this: there is nothing."""
_MOST = 4
_LATENCY_S = 0.10


def contact_speed(aside_m: float, ahead_m: float, rim_m: float, brake: Braking) -> float:
    """Fastest speed now that touches a point at a harmless speed, braking from here.

    Args:
        aside_m: of the point, from the line of motion.
        ahead_m: of the point, from the disc's centre.
        rim_m: the disc's radius and a margin.
        brake: how the motion can be stopped.

    Returns:
        m/s; infinite where the disc passes the point.

    """
    if aside_m >= rim_m or ahead_m <= 0.0:
        return math.inf
    reach_m = math.sqrt(rim_m * rim_m - aside_m * aside_m)
    touch = TOUCH_M_S * rim_m / reach_m  # its part along the normal is v·cos β
    push = brake.decel * brake.latency_s
    way_m = max(ahead_m - reach_m, 0.0)
    if not way_m:
        return touch
    return max(math.sqrt((push + touch) ** 2 + 2.0 * brake.decel * way_m) - push, touch)


class HiddenAhead:
    """Things that left the cone, and the speed that they allow."""

    def __init__(self, model: RobotModel, decel_m_s2: float) -> None:
        """Nothing seen yet."""
        self._mount = model.ultrasonic
        self._rim_m = model.radius_m + _MARGIN_M
        self._slope = math.tan(0.5 * model.ultrasonic.cone_rad)
        self._far_m = (self._rim_m + _MARGIN_M) / max(self._slope, 1e-6)
        self._brake = Braking(decel_m_s2, _LATENCY_S)
        self._things: list[list[float]] = []
        """Each: ahead of the axle, aside, turned since (m, m, rad)."""
        self._range_m: float | None = None
        """Of the last reading, less what was driven since."""
        self._raw_m: float | None = None
        self._turned_rad = 0.0

    def update(self, raw_m: float | None, ahead_m: float, turn_rad: float) -> float:
        """Fastest forward speed, after driving ``ahead_m`` and turning, with the newest reading."""
        for thing in self._things:
            thing[0] -= ahead_m
            thing[2] += turn_rad
        self._turned_rad += abs(turn_rad)
        if self._range_m is not None:
            self._range_m -= ahead_m
        if raw_m != self._raw_m:
            self._raw_m = raw_m
            self._look(raw_m)
        if not self._things:
            return math.inf
        self._things = [
            thing
            for thing in self._things
            if thing[0] > self._passed_m(thing[1]) and abs(thing[2]) < _TURNED_RAD
        ]
        return min(
            (contact_speed(t[1], t[0], self._rim_m, self._brake) for t in self._things),
            default=math.inf,
        )

    def _passed_m(self, aside_m: float) -> float:
        """How far ahead a thing is when the latest touch of it would have come, and a margin."""
        body_m, aside_m = self._rim_m - _MARGIN_M, aside_m + _ASIDE_M
        reach_m = math.sqrt(max(body_m * body_m - aside_m * aside_m, 0.0))
        return max(reach_m - _PAST_M, 0.0)

    def _look(self, raw_m: float | None) -> None:
        last, self._range_m = self._range_m, raw_m
        turned, self._turned_rad = self._turned_rad, 0.0
        x_m = self._mount.x_m
        if raw_m is not None and self._things:
            seen = raw_m + x_m
            self._things = [t for t in self._things if abs(t[0] - seen) > _SAME_M]
        if last is None or not 0.0 < last < self._far_m or turned > 0.02:  # noqa: PLR2004 - 1°
            return
        if raw_m is None or raw_m > last + _LOST_M:
            self._things.append([last + x_m, last * self._slope, 0.0])
            del self._things[:-_MOST]
