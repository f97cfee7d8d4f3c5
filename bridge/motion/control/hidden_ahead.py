"""Obstacles that have left the ultrasonic sensor's cone but may still be ahead.

The cone, with half angle α, is narrower than the footprint. An obstacle at lateral distance y is
visible from far away and leaves the cone at the range y / tan α. So the range at which the echo
disappears gives the lateral distance of the obstacle, but not its side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.control.braking import Braking
    from bridge.motion.robot_model import RobotModel


@dataclass(frozen=True, slots=True)
class HiddenAheadTuning:
    """Limits; lengths are in m, angles in rad."""

    contact_m_s: float = 0.026
    """Maximum speed of a harmless contact along the normal, m/s. A collision begins at 0.03 m/s."""
    lost_m: float = 0.08
    """Minimum increase of the range between two readings that means another obstacle, m."""
    same_m: float = 0.06
    """Maximum distance between an echo and a hidden obstacle that means the same obstacle, m."""
    margin_m: float = 0.012
    """Margin around the footprint in the computation of a contact, m."""
    turned_rad: float = 0.15
    """Turn after which the position of a hidden obstacle is unknown, rad."""
    sharp_rad: float = 0.02
    """Maximum turn between two readings after which a lost echo means a hidden obstacle, rad. It is
    1°."""
    past_m: float = 0.01
    """Path beyond the expected contact after which the obstacle is removed, m."""
    aside_m: float = 0.02
    """Lateral margin of the expected contact, m."""


_MAX_STORED = 4
"""Maximum number of stored obstacles."""


def contact_speed(
    aside_m: float, ahead_m: float, rim_m: float, brake: Braking, contact_m_s: float
) -> float:
    """Return the maximum present speed at which a contact with a point is harmless, m/s.

    The speed is infinite if the footprint passes the point. The recovery planner's
    ``evidence_kernels.speed_limit_m_s`` uses the same formula for each occupied cell.

    Args:
        aside_m: distance of the point from the line of motion, m.
        ahead_m: distance of the point ahead of the footprint's centre, m.
        rim_m: radius of the footprint plus a margin, m.
        brake: braking distance of the motion.
        contact_m_s: maximum speed of a harmless contact along the normal, m/s.

    """
    if aside_m >= rim_m or ahead_m <= 0.0:
        return math.inf
    reach_m = math.sqrt(rim_m * rim_m - aside_m * aside_m)
    at_contact = contact_m_s * rim_m / reach_m  # the component along the normal is v·cos β
    lag_speed = brake.decel * brake.latency_s
    path_m = max(ahead_m - reach_m, 0.0)
    if not path_m:
        return at_contact
    return max(
        math.sqrt((lag_speed + at_contact) ** 2 + 2.0 * brake.decel * path_m) - lag_speed,
        at_contact,
    )


class HiddenAhead:
    """Obstacles that have left the cone, and the speed limit because of them."""

    def __init__(self, model: RobotModel, brake: Braking, tuning: HiddenAheadTuning) -> None:
        """Begin without obstacles."""
        self._mount = model.ultrasonic
        self._tune = tuning
        self._rim_m = model.radius_m + tuning.margin_m
        self._slope = math.tan(0.5 * model.ultrasonic.cone_rad)
        self._far_m = (self._rim_m + tuning.margin_m) / max(self._slope, 1e-6)
        self._brake = brake
        self._things: list[list[float]] = []
        """Obstacles. Each has the distance ahead of the axle (m), the lateral distance (m), and the
        turn of the robot since it left the cone (rad)."""
        self._range_m: float | None = None
        """Last range minus the path since the last reading, m."""
        self._raw_m: float | None = None
        self._turned_rad = 0.0

    def update(self, raw_m: float | None, ahead_m: float, turn_rad: float) -> float:
        """Return the maximum forward speed after a motion and a new reading, m/s.

        Args:
            raw_m: ultrasonic range, m; None: no echo.
            ahead_m: forward path since the last call, m.
            turn_rad: turn since the last call, rad.

        """
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
            if thing[0] > self._passed_m(thing[1]) and abs(thing[2]) < self._tune.turned_rad
        ]
        return min(
            (
                contact_speed(t[1], t[0], self._rim_m, self._brake, self._tune.contact_m_s)
                for t in self._things
            ),
            default=math.inf,
        )

    def _passed_m(self, aside_m: float) -> float:
        """Return the distance ahead of the axle below which the robot has passed an obstacle, m."""
        tune = self._tune
        body_m, aside_m = self._rim_m - tune.margin_m, aside_m + tune.aside_m
        reach_m = math.sqrt(max(body_m * body_m - aside_m * aside_m, 0.0))
        return max(reach_m - tune.past_m, 0.0)

    def _look(self, raw_m: float | None) -> None:
        last, self._range_m = self._range_m, raw_m
        turned, self._turned_rad = self._turned_rad, 0.0
        x_m, tune = self._mount.x_m, self._tune
        if raw_m is not None and self._things:
            seen = raw_m + x_m
            self._things = [t for t in self._things if abs(t[0] - seen) > tune.same_m]
        if last is None or not 0.0 < last < self._far_m or turned > tune.sharp_rad:
            return
        if raw_m is None or raw_m > last + tune.lost_m:
            self._things.append([last + x_m, last * self._slope, 0.0])
            del self._things[:-_MAX_STORED]
