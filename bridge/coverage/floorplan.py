"""Floor plans (``*.json``): the room's outline, its obstacles and the start pose.

Used by whoever knows the truth: the virtual world, the metrics and the pictures. Planners
never see one. Files come from elsewhere, so everything in them is checked and bounded.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

from bridge.motion.geometry import Pose2

Point = tuple[float, float]
Polygon = tuple[Point, ...]

MAX_FILE_BYTES = 4 * 1024 * 1024
MAX_POINTS = 20_000
MAX_EXTENT_M = 200.0
_MIN_CORNERS = 3
_PLANE = 2
_POSE = 3


class FloorPlanError(ValueError):
    """A floor plan that cannot be used; the text names the key and the value."""


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """A room. Walls counter-clockwise, all in metres; the start pose in metres and radians."""

    name: str
    walls: Polygon
    obstacles: tuple[Polygon, ...]
    start: Pose2

    def edges(self) -> list[tuple[Point, Point]]:
        """Every wall and obstacle edge as a pair of end points."""
        return [
            (polygon[i - 1], polygon[i])
            for polygon in (self.walls, *self.obstacles)
            for i in range(len(polygon))
        ]

    def bounds(self) -> tuple[float, float, float, float]:
        """The outline's bounding box: x_min, y_min, x_max, y_max."""
        xs = [p[0] for p in self.walls]
        ys = [p[1] for p in self.walls]
        return min(xs), min(ys), max(xs), max(ys)

    def to_json(self) -> str:
        """The plan as a room file."""
        return json.dumps(
            {
                "name": self.name,
                "walls": self.walls,
                "obstacles": self.obstacles,
                "start": list(self.start),
            },
        )


def signed_area_m2(polygon: Polygon) -> float:
    """Shoelace area, positive for counter-clockwise corners."""
    return 0.5 * sum(
        a[0] * b[1] - b[0] * a[1] for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True)
    )


def contains(polygon: Polygon, x_m: float, y_m: float) -> bool:
    """Even-odd test of a point against a polygon."""
    inside = False
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        if (ay > y_m) != (by > y_m) and x_m < (bx - ax) * (y_m - ay) / (by - ay) + ax:
            inside = not inside
    return inside


def parse_floorplan(text: str, *, default_name: str = "room") -> FloorPlan:
    """Read a room file's text.

    Raises:
        FloorPlanError: not JSON, a key missing or of the wrong form, numbers that are not
            finite or out of bounds, or a start outside the free floor.

    """
    if len(text) > MAX_FILE_BYTES:
        raise FloorPlanError(f"room is larger than {MAX_FILE_BYTES} bytes")
    try:
        data = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise FloorPlanError(f"room is not valid JSON: {error}") from None
    if not isinstance(data, dict):
        raise FloorPlanError(f"room must be a JSON object, not {type(data).__name__}")
    name = data.get("name", default_name)
    if not isinstance(name, str) or not name:
        raise FloorPlanError(f"name: must be a non-empty text, not {name!r}")
    walls = _polygon(data.get("walls"), "walls")
    if signed_area_m2(walls) < 0:
        walls = walls[::-1]
    raw_obstacles = data.get("obstacles", [])
    if not isinstance(raw_obstacles, list):
        raise FloorPlanError("obstacles: must be a list of polygons")
    obstacles = tuple(_polygon(o, f"obstacles[{i}]") for i, o in enumerate(raw_obstacles))
    if len(walls) + sum(len(o) for o in obstacles) > MAX_POINTS:
        raise FloorPlanError(f"room has more than {MAX_POINTS} corners")
    start = Pose2(*_numbers(data.get("start"), "start", _POSE))
    _check_start(start, walls, obstacles)
    return FloorPlan(name, walls, obstacles, start)


def _check_start(start: Pose2, walls: Polygon, obstacles: tuple[Polygon, ...]) -> None:
    if not contains(walls, start.x_m, start.y_m):
        raise FloorPlanError(f"start: ({start.x_m:g}, {start.y_m:g}) is outside the walls")
    for i, obstacle in enumerate(obstacles):
        if contains(obstacle, start.x_m, start.y_m):
            raise FloorPlanError(f"start: ({start.x_m:g}, {start.y_m:g}) is in obstacles[{i}]")


def _polygon(value: object, key: str) -> Polygon:
    if not isinstance(value, list) or len(value) < _MIN_CORNERS:
        raise FloorPlanError(f"{key}: must be a list of at least {_MIN_CORNERS} [x, y] corners")
    corners = [_numbers(p, f"{key}[{i}]", _PLANE) for i, p in enumerate(value)]
    polygon = tuple((p[0], p[1]) for p in corners)
    if abs(signed_area_m2(polygon)) < 1e-6:  # noqa: PLR2004 - a square millimetre
        raise FloorPlanError(f"{key}: encloses no area")
    return polygon


def _numbers(value: object, key: str, count: int) -> list[float]:
    if not isinstance(value, list) or len(value) != count:
        raise FloorPlanError(f"{key}: must be a list of {count} numbers, not {value!r:.60}")
    numbers: list[float] = []
    for item in value:
        if isinstance(item, bool) or not isinstance(item, int | float):
            raise FloorPlanError(f"{key}: {item!r:.40} is not a number")
        number = float(item)
        if not math.isfinite(number) or abs(number) > MAX_EXTENT_M:
            raise FloorPlanError(f"{key}: {item!r:.40} must be finite, at most {MAX_EXTENT_M:g}")
        numbers.append(number)
    return numbers
