"""Obstacles that have left the ultrasonic's cone and may still be in the way.

A cone of half angle α is narrower than the footprint. An obstacle at lateral distance y is visible
from afar and leaves the cone at the range y / tan α. So the range at which the echo disappears
gives the lateral distance, but not the side.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.control.braking import Braking

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

TOUCH_M_S = 0.026
"""Normal speed of a harmless contact, m/s; a collision begins at 0.03."""
_LOST_M = 0.08
"""Growth of the range between readings that means another obstacle, m."""
_SAME_M = 0.06
"""Distance within which an echo is a hidden obstacle that is visible again, m."""
_MARGIN_M = 0.012
_TURNED_RAD = 0.15
"""Turn after which a hidden obstacle's place is unknown, rad."""
_PAST_M, _ASIDE_M = 0.01, 0.02
"""Path beyond the expected contact (m), with a further lateral margin (m), after which there is no
obstacle."""
_MOST = 4
_LATENCY_S = 0.10


def contact_speed(aside_m: float, ahead_m: float, rim_m: float, brake: Braking) -> float:
    """Return the highest speed, m/s, with a harmless contact at a point, braking from here.

    It is infinite if the disc passes the point.

    Args:
        aside_m: distance of the point from the line of motion, m.
        ahead_m: distance of the point ahead of the disc's centre, m.
        rim_m: the disc's radius and a margin, m.
        brake: braking distance of the motion.

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
        """Last range less the path since, m."""
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
        """Return the distance ahead of an obstacle after its latest contact, with a margin, m."""
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
