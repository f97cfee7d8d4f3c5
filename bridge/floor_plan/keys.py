"""Keys of a room file. The reader, its messages and the reference all use this table."""

from __future__ import annotations

from typing import NamedTuple


class RoomKey(NamedTuple):
    """One key of a room file, or of an object in it."""

    name: str
    form: str
    """Description of the value's form, for people."""
    meaning: str
    unit: str = ""
    low: float = 0.0
    high: float = 0.0
    """Maximum of a number. If ``above_low`` is True, the minimum itself is not allowed."""
    default: float | str | None = None
    """Default if the key is missing; None: the key is required."""
    above_low: bool = False

    @property
    def is_number(self) -> bool:
        """True if the value is one number."""
        return self.high > self.low


_POLYGON = "polygon `[[x, y], …]`"
MAX_EXTENT_M = 200.0
"""Maximum coordinate in a room, m. It is enough for a hall. A larger value is probably in another
unit."""
CARPET_DRAG_N = 4.0
"""Default drag of a carpet, N. It is for a short pile and a robot of 3 kg, and is 14 % of the
robot's weight."""
CARPET_SLIP = 0.02
"""Default slip of a carpet, as a share of the wheel's travel. It was tuned by hand for a short
pile."""

CARPET_KEYS = (
    RoomKey("polygon", _POLYGON, "the carpet's outline", "m"),
    RoomKey(
        "drag_n",
        "number",
        "additional force to roll the whole robot; half for each wheel on the carpet",
        "N",
        0.0,
        50.0,
        CARPET_DRAG_N,
    ),
    RoomKey(
        "slip",
        "number",
        "share of a wheel's travel that is lost on the carpet",
        "1",
        0.0,
        0.5,
        CARPET_SLIP,
    ),
)
THRESHOLD_KEYS = (
    RoomKey("line", "two points `[[x, y], [x, y]]`", "the two ends of the bar", "m"),
    RoomKey(
        "height_m",
        "number",
        "height of the bar above the floor",
        "m",
        0.0,
        0.05,
        above_low=True,
    ),
)
ROOM_KEYS = (
    RoomKey("name", "text", "name for people", default="the name of the file"),
    RoomKey(
        "walls",
        _POLYGON,
        "boundary of the room, counter-clockwise (clockwise is reversed)",
        "m",
    ),
    RoomKey("obstacles", "list of polygons", "what stands on the floor", "m", default="none"),
    RoomKey(
        "start",
        "`[x, y, heading]`",
        "pose of the axle's centre; the footprint must fit there",
        "m, m, rad",
    ),
    RoomKey(
        "carpets",
        "list of objects",
        "floor that is harder to roll on: [carpets](#carpets)",
        default="none",
    ),
    RoomKey(
        "thresholds",
        "list of objects",
        "bars on the floor: [thresholds](#thresholds)",
        default="none",
    ),
    RoomKey("cliffs", "list of polygons", "holes: there is no floor", "m", default="none"),
)
