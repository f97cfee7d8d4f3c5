"""The cliff sensor: infrared reflection sensors under the front rim that detect missing floor.

Three sensors are mounted 1 cm inside the rim, straight ahead and 55° to either side. They are
combined to one bit. The outer sensors are 12.3 cm from the centre line, the wheels 11.5 cm. So a
sensor detects a cliff ahead of a wheel before the wheel reaches it. The floor is missing inside the
room's ``cliffs``, and under a lifted robot. Objects on the floor (carpet, threshold) count as
floor. The module ``plant`` describes a robot that drives over a cliff.
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
    """The cliff sensor with its three reflection sensors."""

    __slots__ = ("_spots",)

    def __init__(self, radius_m: float) -> None:
        """Place the reflection sensors under the rim of a disc."""
        reach_m = radius_m - INSIDE_RIM_M
        self._spots = [(reach_m * math.cos(b), reach_m * math.sin(b)) for b in BEARINGS_RAD]

    def sees_none(self, pose: Pose2, cliffs: tuple[Polygon, ...]) -> bool:
        """Return True if any reflection sensor of a robot at ``pose`` has no floor below it."""
        return any(
            contains(cliff, *pose.transform(*spot)) for spot in self._spots for cliff in cliffs
        )
