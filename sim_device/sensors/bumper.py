"""The front bumper: a spring-loaded shell with two halves; each half has a switch.

The plant's disc is the outline of the shell at the position where the switches close. So a contact
closes the switch at once. The switch opens when the shell has moved back by ``RELEASE_M``, which
means that the obstacle is at least this distance away from the disc. The module ``contacts``
defines which bearings press which switch.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.geometry import wrap_angle
from sim_device.sensors.contacts import Bumpers, bumpers

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sim_device.body.plant import Plant

RELEASE_M = 0.001
"""Travel of the shell between closing and opening of the switch, m. It is chosen as 0.1 mm of a
microswitch times a lever ratio of 10."""
_FREE = Bumpers(left=False, right=False)


class Bumper:
    """Both bumper switches of a plant."""

    __slots__ = ("_plant", "_pressed", "_radius_m")

    def __init__(self, plant: Plant, radius_m: float) -> None:
        """Start with open switches."""
        self._plant, self._radius_m = plant, radius_m
        self._pressed = _FREE

    def read(self) -> Bumpers:
        """Return the closed switches: pressed, or not yet released far enough to open."""
        bearings, before = self._plant.touch_bearings_rad, self._pressed
        if not bearings and before is _FREE:
            return _FREE
        touched = bumpers(bearings)
        if (before.left and not touched.left) or (before.right and not touched.right):
            near = bumpers(self._bearings_near())
            touched = Bumpers(
                touched.left or (before.left and near.left),
                touched.right or (before.right and near.right),
            )
        self._pressed = touched if touched.left or touched.right else _FREE
        return touched

    def _bearings_near(self) -> Iterator[float]:
        """Yield the bearings of obstacles within the travel of a switch."""
        x_m, y_m, theta = self._plant.pose
        world, reach_m = self._plant.world, self._radius_m + RELEASE_M
        walker_x, walker_y, walker_m = world.walker.tolist()
        if walker_m and math.hypot(walker_x - x_m, walker_y - y_m) <= reach_m + walker_m:
            yield wrap_angle(math.atan2(walker_y - y_m, walker_x - x_m) - theta)
        for index in world.edges_near(x_m, y_m, reach_m):
            ax, ay, ex, ey, inv_len2 = world.edges[index, :5].tolist()
            along = min(1.0, max(0.0, ((x_m - ax) * ex + (y_m - ay) * ey) * inv_len2))
            to_x, to_y = ax + along * ex - x_m, ay + along * ey - y_m
            yield wrap_angle(math.atan2(to_y, to_x) - theta)
