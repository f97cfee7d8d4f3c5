"""A range sensor's readings with a wall held at known distances."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.bringup.ranging import Point, point
from protocol.messages import Range

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.bringup.desk import Desk
    from bridge.bringup.person import Person

READ_S = 2.0
"""Forty readings."""
_WORDS = {
    "ultrasonic": "FRONT",
    "infrared_left": "LEFT",
    "infrared_right": "RIGHT",
}


def measured(desk: Desk, person: Person, name: str, distances_m: Sequence[float]) -> list[Point]:
    """Ask for a wall at each distance, and read; a distance that is refused is left out.

    Raises:
        BridgeError: the sensor saw too little of a wall.
        DeviceLostError: the device fell silent.

    """
    found = []
    for distance_m in distances_m:
        shown = f"{100 * distance_m:g} cm"
        if not person.confirm(
            f"Hold a flat wall {shown} before the face of the {_WORDS[name]} sensor. Ready "
            "(no: leave it out)?"
        ):
            continue
        readings = [getattr(m, f"{name}_m") for _, m in desk.collect(Range, READ_S)]
        found.append(point(distance_m, readings))
        person.show(
            f"  {shown}: reads {100 * found[-1].read_m:.2f} cm ±{1000 * found[-1].sigma_m:.1f} mm"
        )
    return found
