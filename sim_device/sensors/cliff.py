"""The cliff sensor: reflex light barriers under the front rim that detect missing floor.

Three barriers are mounted 1 cm inside the rim, straight ahead and 55° to either side. Together they
give one bit. The outer barriers are 12.3 cm from the centre line and the wheels 11.5 cm. So a
barrier passes every point ahead of a wheel before the wheel does. The floor is missing in a room's
``cliffs`` and under a robot in the air. Objects on the floor (carpet, threshold) count as floor.
``plant`` describes a robot that drives over a cliff.
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
    """The barriers of the cliff sensor."""

    __slots__ = ("_spots",)

    def __init__(self, radius_m: float) -> None:
        """Mount the barriers under the rim of a disc."""
        reach_m = radius_m - INSIDE_RIM_M
        self._spots = [(reach_m * math.cos(b), reach_m * math.sin(b)) for b in BEARINGS_RAD]

    def sees_none(self, pose: Pose2, cliffs: tuple[Polygon, ...]) -> bool:
        """Return True if any barrier of a robot at ``pose`` is over missing floor."""
        return any(
            contains(cliff, *pose.transform(*spot)) for spot in self._spots for cliff in cliffs
        )
