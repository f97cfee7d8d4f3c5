"""Missing floor, as sensor and wheels meet it.

The cliff sensor: reflex light barriers under the front rim that look for the floor.

Three of them, straight ahead and 55° to either side, 1 cm inside the rim; together they are
one bit. The outer ones are 12.3 cm aside, so that whatever comes under a wheel, 11.5 cm aside, on
the way ahead was under one of them before. The floor is missing in a room's ``cliffs``, and under
a robot that is held up. What stands on the floor (carpet, threshold) is floor to them. What
becomes of a robot that drives on is told in ``plant``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.floor_plan.floor_plan import contains

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import Polygon
    from bridge.motion.geometry import Pose2

INSIDE_RIM_M = 0.01
BEARINGS_RAD = (math.radians(-55.0), 0.0, math.radians(55.0))


class CliffSensor:
    """Its spots on the floor."""

    __slots__ = ("_spots",)

    def __init__(self, radius_m: float) -> None:
        """Sit under the rim of a disc."""
        reach_m = radius_m - INSIDE_RIM_M
        self._spots = [(reach_m * math.cos(b), reach_m * math.sin(b)) for b in BEARINGS_RAD]

    def sees_none(self, pose: Pose2, cliffs: tuple[Polygon, ...]) -> bool:
        """Whether any spot of a robot at ``pose`` is over missing floor."""
        return any(
            contains(cliff, *pose.transform(*spot)) for spot in self._spots for cliff in cliffs
        )
