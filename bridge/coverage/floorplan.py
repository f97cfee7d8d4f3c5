"""Floor plans (``*.json``): the room's outline, its obstacles and the start pose.

Used by whoever knows the truth: the virtual world, the metrics and the pictures. Planners
never see one. Files come from elsewhere, so everything in them is checked and bounded.

Two optional keys tell what the floor is like; the virtual robot's body feels them, the
metrics do not (both are floor):

- ``"carpets": [{"polygon": [[x, y], …], "drag_n": 4.0, "slip": 0.02}, …]``: with both wheels on
  it the robot needs ``drag_n`` newtons more to roll, and each wheel loses the share ``slip`` of
  its travel; either may be left out (these are its values then). Where carpets overlap, both
  are felt.
- ``"thresholds": [{"line": [[x, y], [x, y]], "height_m": 0.005}, …]``: a rounded bar that wheels
  and caster have to climb over.

A third tells where there is no floor at all: ``"cliffs": [[[x, y], …], …]``, polygons like the
obstacles. Nothing stands there, so rays and bodies pass; the cliff sensor sees it, a robot
that drives on falls in, and the metrics count it as they count obstacles.

Other keys are ignored, in these objects too.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import NamedTuple

from bridge.motion.geometry import Pose2

Point = tuple[float, float]
Polygon = tuple[Point, ...]

MAX_FILE_BYTES = 4 * 1024 * 1024
MAX_POINTS = 20_000
MAX_EXTENT_M = 200.0
_MIN_CORNERS = 3
_PLANE = 2
_POSE = 3
DEFAULT_CARPET_DRAG_N = 4.0
"""A short-pile carpet under a robot of 3 kg: 14 % of its weight."""
DEFAULT_CARPET_SLIP = 0.02
MAX_CARPET_DRAG_N = 50.0
MAX_CARPET_SLIP = 0.5
MAX_THRESHOLD_M = 0.05


class FloorPlanError(ValueError):
    """A floor plan that cannot be used; the text names the key and the value."""


class Carpet(NamedTuple):
    """A patch of floor that is harder to roll on."""

    polygon: Polygon
    drag_n: float = DEFAULT_CARPET_DRAG_N
    """Extra resistance with both wheels on it, half by each."""
    slip: float = DEFAULT_CARPET_SLIP
    """Share of a wheel's travel lost on it."""


class Threshold(NamedTuple):
    """A rounded bar on the floor, from one point to another."""

    begin: Point
    end: Point
    height_m: float


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """A room. Walls counter-clockwise, all in metres; the start pose in metres and radians."""

    name: str
    walls: Polygon
    obstacles: tuple[Polygon, ...]
    start: Pose2
    carpets: tuple[Carpet, ...] = ()
    thresholds: tuple[Threshold, ...] = ()
    cliffs: tuple[Polygon, ...] = ()

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
        room: dict[str, object] = {
            "name": self.name,
            "walls": self.walls,
            "obstacles": self.obstacles,
            "start": list(self.start),
        }
        if self.carpets:
            room["carpets"] = [carpet._asdict() for carpet in self.carpets]
        if self.thresholds:
            room["thresholds"] = [
                {"line": [t.begin, t.end], "height_m": t.height_m} for t in self.thresholds
            ]
        if self.cliffs:
            room["cliffs"] = self.cliffs
        return json.dumps(room)


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
    carpets = tuple(_carpet(c, f"carpets[{i}]") for i, c in enumerate(_list(data, "carpets")))
    thresholds = tuple(
        _threshold(t, f"thresholds[{i}]") for i, t in enumerate(_list(data, "thresholds"))
    )
    cliffs = tuple(_polygon(c, f"cliffs[{i}]") for i, c in enumerate(_list(data, "cliffs")))
    corners = sum(
        len(p) for p in (walls, *obstacles, *(c.polygon for c in carpets), thresholds, *cliffs)
    )
    if corners > MAX_POINTS:
        raise FloorPlanError(f"room has more than {MAX_POINTS} corners")
    start = Pose2(*_numbers(data.get("start"), "start", _POSE))
    _check_start(start, walls, obstacles)
    for i, cliff in enumerate(cliffs):
        if contains(cliff, start.x_m, start.y_m):
            raise FloorPlanError(f"start: ({start.x_m:g}, {start.y_m:g}) is over cliffs[{i}]")
    return FloorPlan(name, walls, obstacles, start, carpets, thresholds, cliffs)


def _list(data: dict[str, object], key: str) -> list[object]:
    value = data.get(key, [])
    if not isinstance(value, list):
        raise FloorPlanError(f"{key}: must be a list of objects")
    return value


def _object(value: object, key: str) -> dict[str, object]:
    if not isinstance(value, dict):
        raise FloorPlanError(f"{key}: must be an object, not {value!r:.60}")
    return value


def _carpet(value: object, key: str) -> Carpet:
    data = _object(value, key)
    drag_n = _share(data, "drag_n", key, MAX_CARPET_DRAG_N, DEFAULT_CARPET_DRAG_N)
    slip = _share(data, "slip", key, MAX_CARPET_SLIP, DEFAULT_CARPET_SLIP)
    return Carpet(_polygon(data.get("polygon"), f"{key}.polygon"), drag_n, slip)


def _threshold(value: object, key: str) -> Threshold:
    data = _object(value, key)
    line = data.get("line")
    if not isinstance(line, list) or len(line) != 2:  # noqa: PLR2004 - two ends
        raise FloorPlanError(f"{key}.line: must be two [x, y] points, not {line!r:.60}")
    ends = [_numbers(p, f"{key}.line[{i}]", _PLANE) for i, p in enumerate(line)]
    (ax, ay), (bx, by) = ends
    if math.hypot(bx - ax, by - ay) < 1e-3:  # noqa: PLR2004 - a millimetre
        raise FloorPlanError(f"{key}.line: its ends must lie apart")
    height_m = _share(data, "height_m", key, MAX_THRESHOLD_M, None)
    if height_m == 0.0:
        raise FloorPlanError(f"{key}.height_m: must be above 0")
    return Threshold((ax, ay), (bx, by), height_m)


def _share(
    data: dict[str, object], name: str, key: str, most: float, default: float | None
) -> float:
    """A number from 0 to ``most`` in an object; without a default it must be there."""
    if name not in data and default is not None:
        return default
    (number,) = _numbers([data.get(name)], f"{key}.{name}", 1)
    if not 0.0 <= number <= most:
        raise FloorPlanError(f"{key}.{name}: {number:g} must be from 0 to {most:g}")
    return number


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
        try:
            number = float(item)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number) or abs(number) > MAX_EXTENT_M:
            raise FloorPlanError(f"{key}: {item!r:.40} must be finite, at most {MAX_EXTENT_M:g}")
        numbers.append(number)
    return numbers
