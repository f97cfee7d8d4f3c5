"""Contact sensors: two bumper switches and the cliff sensor."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

BUMPER_SPAN_RAD = math.radians(87.0)
"""Half of the bumper shell's angle, rad. It is a little less than 90°, so that a wall exactly at
the robot's side does not press the bumper."""
BUMPER_OVERLAP_RAD = math.radians(10.0)
"""Maximum bearing to either side at which a contact presses both switches, rad."""


class Bumpers(NamedTuple):
    """State of the two bumper switches."""

    left: bool
    right: bool


def bumpers(touch_bearings_rad: Iterable[float]) -> Bumpers:
    """Return the switches pressed by contacts at these bearings (rad, positive to the left)."""
    left = right = False
    for bearing in touch_bearings_rad:
        if abs(bearing) > BUMPER_SPAN_RAD:
            continue
        left = left or bearing >= -BUMPER_OVERLAP_RAD
        right = right or bearing <= BUMPER_OVERLAP_RAD
    return Bumpers(left, right)
