"""Readings of a range sensor with a wall at known distances."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.bringup.ranging import Point, point
from protocol.messages.device import Range

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.bringup.person import Person
    from bridge.bringup.session import BringupSession

READ_S = 2.0
"""Duration of a measurement, s: 40 readings at 20 Hz."""
_WORDS = {
    "ultrasonic": "FRONT",
    "infrared_left": "LEFT",
    "infrared_right": "RIGHT",
}
"""Names of the sensors in the prompts."""


def measured(
    session: BringupSession, person: Person, name: str, distances_m: Sequence[float]
) -> list[Point]:
    """Ask for a wall at each distance and measure its range; a declined distance is skipped.

    Args:
        session: connection to the device.
        person: the person who holds the wall.
        name: sensor, such as ``infrared_left``.
        distances_m: distances of the wall from the sensor's face, m.

    Raises:
        RangeCalibrationError: too few readings show the wall.
        DeviceLostError: the device does not answer any more.

    """
    found = []
    for distance_m in distances_m:
        shown = f"{100 * distance_m:g} cm"
        if not person.confirm(
            f"Hold a flat board {shown} in front of the {_WORDS[name]} sensor. Ready (no: skip)?"
        ):
            continue
        readings = [getattr(m, f"{name}_m") for _, m in session.collect(Range, READ_S)]
        found.append(point(distance_m, readings))
        person.show(
            f"  {shown}: reads {100 * found[-1].read_m:.2f} cm ±{1000 * found[-1].sigma_m:.1f} mm"
        )
    return found
