"""Contact sensors: two bumper switches and the cliff sensor."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

BUMPER_SPAN_RAD = math.radians(87.0)
"""Half the angle of the shell, rad. It ends just short of the side, so a wall that grazes the robot
exactly abeam does not press it."""
BUMPER_OVERLAP_RAD = math.radians(10.0)
"""Bearing within which a contact presses both switches, rad."""


class Bumpers(NamedTuple):
    """State of the two bumper switches."""

    left: bool
    right: bool


def bumpers(touch_bearings_rad: Iterable[float]) -> Bumpers:
    """Return the switches pressed by contacts at these bearings from the heading, rad, left +."""
    left = right = False
    for bearing in touch_bearings_rad:
        if abs(bearing) > BUMPER_SPAN_RAD:
            continue
        left = left or bearing >= -BUMPER_OVERLAP_RAD
        right = right or bearing <= BUMPER_OVERLAP_RAD
    return Bumpers(left, right)
