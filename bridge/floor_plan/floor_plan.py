"""Floor plans (``*.json``): the room's outline, its obstacles and the start pose.

The virtual world, the metrics and the pictures use floor plans. Planners do not use them. Every
value in a file is checked against limits.

Two optional keys describe the floor. They affect the virtual robot. In the metrics, both are normal
floor:

- ``"carpets": [{"polygon": [[x, y], …], "drag_n": 4.0, "slip": 0.02}, …]``: with both wheels on the
  carpet, the rolling resistance is ``drag_n`` newtons higher, and each wheel loses the share
  ``slip`` of its travel. Both keys are optional, with these defaults. The effects of overlapping
  carpets add up.
- ``"thresholds": [{"line": [[x, y], [x, y]], "height_m": 0.005}, …]``: a rounded bar that wheels
  and caster must cross.

A third key describes missing floor: ``"cliffs": [[[x, y], …], …]``, polygons like the obstacles. A
cliff does not block rays or robots, but the cliff sensor detects it. A robot that drives on falls.
In the metrics, cliffs are obstacles.

Other keys are ignored, also inside these objects. An unknown key that is similar to a known key is
probably a misspelling, and :attr:`FloorPlan.cautions` lists it.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from bridge.errors import MAX_PROBLEMS, ConfigError
from bridge.floor_plan.keys import (
    CARPET_DRAG_N,
    CARPET_KEYS,
    CARPET_SLIP,
    MAX_EXTENT_M,
    ROOM_KEYS,
    THRESHOLD_KEYS,
    RoomKey,
)
from bridge.motion.geometry import Pose2
from bridge.spelling import nearest

if TYPE_CHECKING:
    from collections.abc import Callable

Point = tuple[float, float]
Polygon = tuple[Point, ...]

MAX_FILE_BYTES = 4 * 1024 * 1024
MAX_POINTS = 20_000
_MIN_CORNERS = 3
_PLANE = 2
_POSE = 3
_KEYS = tuple(key.name for key in ROOM_KEYS)
_RESEMBLES = 0.75
"""Minimum share of equal letters (Ratcliff and Obershelp) at which two keys are similar. "wall" and
"walls" have 0.89, "Obstacle" and "obstacles" 0.94, "notes" and "name" 0.44."""
_RESEMBLES_MISSING = 0.55
"""Minimum share of equal letters at which a key is similar to a missing required key. "start_pose"
and "start" have 0.67."""
MAX_HEADING_RAD = 2.0 * math.pi + 0.01
"""Maximum heading of the start pose, rad. It allows a full turn that is rounded to two digits. A
larger value is probably an angle in degrees."""
MAX_DEGREES = 10_000.0
"""Maximum value that may be a heading in degrees. A larger value is another error."""
_POLYGON, _DRAG, _SLIP = CARPET_KEYS
_LINE, _HEIGHT = THRESHOLD_KEYS


class FloorPlanError(ConfigError, ValueError):
    """An invalid floor plan. The text lists every wrong key and its value."""


class Carpet(NamedTuple):
    """A patch of floor with a higher rolling resistance."""

    polygon: Polygon
    drag_n: float = CARPET_DRAG_N
    """Additional rolling resistance with both wheels on the carpet, N. Half of it acts on each
    wheel."""
    slip: float = CARPET_SLIP
    """Share of a wheel's travel lost on the carpet."""


class Threshold(NamedTuple):
    """A rounded bar on the floor, from one point to another."""

    begin: Point
    end: Point
    height_m: float


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """A room. Its walls are counter-clockwise. The units are metres and radians."""

    name: str
    walls: Polygon
    obstacles: tuple[Polygon, ...]
    start: Pose2
    carpets: tuple[Carpet, ...] = ()
    thresholds: tuple[Threshold, ...] = ()
    cliffs: tuple[Polygon, ...] = ()
    cautions: tuple[str, ...] = field(default=(), compare=False)
    """Probable mistakes in a valid room file, as text for people."""

    def edges(self) -> list[tuple[Point, Point]]:
        """Every wall and obstacle edge as a pair of end points."""
        return [
            (polygon[i - 1], polygon[i])
            for polygon in (self.walls, *self.obstacles)
            for i in range(len(polygon))
        ]

    def bounds(self) -> tuple[float, float, float, float]:
        """Bounding box of the outline: x_min, y_min, x_max, y_max."""
        xs = [p[0] for p in self.walls]
        ys = [p[1] for p in self.walls]
        return min(xs), min(ys), max(xs), max(ys)

    def to_json(self) -> str:
        """Return the plan as the text of a room file."""
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
    """Return the area by the shoelace formula, positive for counter-clockwise corners."""
    return 0.5 * sum(
        a[0] * b[1] - b[0] * a[1] for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True)
    )


def contains(polygon: Polygon, x_m: float, y_m: float) -> bool:
    """Return True if a point is inside a polygon, by the even-odd rule."""
    inside = False
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        if (ay > y_m) != (by > y_m) and x_m < (bx - ax) * (y_m - ay) / (by - ay) + ax:
            inside = not inside
    return inside


def check_robot_fits(plan: FloorPlan, radius_m: float) -> None:
    """Check that a robot of this radius fits at the start.

    Raises:
        StartBlockedError: the robot's disc overlaps a wall or an obstacle.

    """
    overlap_m = _overlap_m(plan.start, (plan.walls, *plan.obstacles), radius_m)
    if overlap_m is None or overlap_m > START_OVERLAP_M:
        raise StartBlockedError(plan.start.x_m, plan.start.y_m, radius_m, overlap_m)


def _overlap_m(start: Pose2, boundaries: tuple[Polygon, ...], radius_m: float) -> float | None:
    """Return the overlap of the start disc with walls or obstacles, m; below 0: no overlap.

    ``boundaries`` begins with the walls. None: the disc's centre is not on the floor.
    """
    x_m, y_m = start.x_m, start.y_m
    if [contains(boundary, x_m, y_m) for boundary in boundaries] != [True] + [False] * (
        len(boundaries) - 1
    ):
        return None
    return radius_m - min(
        _distance_m(x_m, y_m, a, b)
        for boundary in boundaries
        for a, b in zip(boundary, boundary[1:] + boundary[:1], strict=True)
    )


START_OVERLAP_M = 1e-6
"""Maximum overlap of the start disc with a wall, m. It allows for rounding in a room file."""


class StartBlockedError(FloorPlanError):
    """The robot's disc does not fit at the start of the room file."""

    def __init__(self, x_m: float, y_m: float, radius_m: float, overlap_m: float | None) -> None:
        """Create the error from the start, the disc's radius and its overlap with a wall (m).

        ``overlap_m`` is None if the disc's centre itself is not on the floor.
        """
        self.x_m, self.y_m, self.radius_m, self.overlap_m = x_m, y_m, radius_m, overlap_m
        what = (
            "stands in a wall or an obstacle"
            if overlap_m is None
            else f"overlaps a wall or an obstacle by {1000.0 * overlap_m:.1f} mm"
        )
        super().__init__(f"start: the robot (radius {radius_m:g} m) at ({x_m:g}, {y_m:g}) {what}")


def _distance_m(x_m: float, y_m: float, a: Point, b: Point) -> float:
    ex, ey = b[0] - a[0], b[1] - a[1]
    length2 = ex * ex + ey * ey
    along = ((x_m - a[0]) * ex + (y_m - a[1]) * ey) / length2 if length2 else 0.0
    along = min(1.0, max(0.0, along))
    return math.hypot(a[0] + along * ex - x_m, a[1] + along * ey - y_m)


def parse_floorplan(
    text: str,
    *,
    default_name: str = "room",
    radius_m: float | None = None,
    start: Pose2 | None = None,
) -> FloorPlan:
    """Read a room file's text.

    Args:
        text: Content of the file.
        default_name: Name of the room if the file has no name.
        radius_m: Radius of a robot that must fit at the start, m; None: no check.
        start: Start pose that replaces the file's start pose.

    Raises:
        FloorPlanError: the text is not JSON, a key is missing or has the wrong form, a number is
            not finite or is out of range, or the start is outside the free floor. The error text
            lists all errors.

    """
    if len(text) > MAX_FILE_BYTES:
        raise FloorPlanError(f"room is larger than {MAX_FILE_BYTES} bytes")
    try:
        data = json.loads(text, object_pairs_hook=_Pairs.made)
    except (json.JSONDecodeError, RecursionError) as error:
        raise FloorPlanError(f"room is not valid JSON: {error}") from None
    if not isinstance(data, dict):
        raise FloorPlanError(f"room must be a JSON object, not {type(data).__name__}")
    if start is not None:
        data["start"] = list(start)
    return _Reading(data, default_name, radius_m).plan()


class _Pairs(dict[str, object]):
    """A JSON object that stores its duplicate keys."""

    twice: tuple[str, ...] = ()

    @classmethod
    def made(cls, pairs: list[tuple[str, object]]) -> _Pairs:
        """Create the object from the pairs of the text."""
        found = cls(pairs)
        if len(found) < len(pairs):
            keys = [key for key, _ in pairs]
            found.twice = tuple(key for key in found if keys.count(key) > 1)
        return found


_Read = TypeVar("_Read")


class _Reading:
    """Reader of one room file that collects all errors."""

    def __init__(self, data: dict[str, object], default_name: str, radius_m: float | None) -> None:
        self._data = data
        self._default_name = default_name
        self._radius_m = radius_m
        self._problems: list[str] = []
        self._cautions: list[str] = []

    def plan(self) -> FloorPlan:
        """Return the floor plan.

        Raises:
            FloorPlanError: the file is invalid.

        """
        data = self._data
        self._look_at_keys(data, _KEYS, "")
        name = data.get("name", self._default_name)
        if not isinstance(name, str) or not name:
            self._problems.append(f"name: must be a non-empty text, not {name!r:.60}")
            name = self._default_name
        walls = self._one(self._walls)
        obstacles = self._each("obstacles", "polygons", _polygon)
        carpets = self._each("carpets", "objects", _carpet, CARPET_KEYS)
        thresholds = self._each("thresholds", "objects", _threshold, THRESHOLD_KEYS)
        cliffs = self._each("cliffs", "polygons", _polygon)
        start = self._one(self._start)
        corners = sum(
            len(p)
            for p in (
                walls or (),
                *obstacles,
                *(carpet.polygon for carpet in carpets),
                thresholds,
                *cliffs,
            )
        )
        if corners > MAX_POINTS:
            self._problems.append(f"room has more than {MAX_POINTS} corners")
        elif start is not None:
            self._check_start(start, walls, obstacles, cliffs)
        if self._problems or walls is None or start is None:
            raise FloorPlanError(*self._problems, *self._cautions)
        cautions = tuple(self._cautions[:MAX_PROBLEMS])
        return FloorPlan(name, walls, obstacles, start, carpets, thresholds, cliffs, cautions)

    def _walls(self) -> Polygon:
        walls = _polygon(self._needed("walls"), "walls")
        return walls[::-1] if signed_area_m2(walls) < 0 else walls

    def _start(self) -> Pose2:
        value = self._needed("start")
        if isinstance(value, list) and len(value) == _POSE:
            x, y, heading = value
            if isinstance(heading, int | float) and MAX_HEADING_RAD < abs(heading) < MAX_DEGREES:
                self._problems.append(
                    f"start: a heading of {heading:g} rad is more than a full turn; the format "
                    f"has radians ({heading:g}° are {math.radians(heading):.5g} rad)"
                )
                value = [x, y, 0.0]
        return Pose2(*_numbers(value, "start", _POSE))

    def _needed(self, key: str) -> object:
        if key not in self._data:
            unknown = [other for other in self._data if other not in _KEYS]
            near = nearest(key, unknown, _RESEMBLES_MISSING)
            hint = f'; is "{near:.40}" meant to be it?' if near is not None else ""
            raise FloorPlanError(f"{key}: is missing{hint}")
        return self._data[key]

    def _one(self, read: Callable[[], _Read]) -> _Read | None:
        try:
            return read()
        except FloorPlanError as error:
            self._problems += error.problems
            return None

    def _each(
        self,
        key: str,
        what: str,
        read: Callable[[object, str], _Read],
        keys: tuple[RoomKey, ...] = (),
    ) -> tuple[_Read, ...]:
        values = self._data.get(key, [])
        if not isinstance(values, list):
            self._problems.append(f"{key}: must be a list of {what}")
            return ()
        found = []
        for i, value in enumerate(values):
            if isinstance(value, dict):
                names = tuple(known.name for known in keys)
                self._look_at_keys(value, names, f"{key}[{i}].")
            made = self._one(partial(read, value, f"{key}[{i}]"))
            if made is not None:
                found.append(made)
        return tuple(found) if len(found) == len(values) else ()

    def _look_at_keys(self, data: dict[str, object], known: tuple[str, ...], prefix: str) -> None:
        """Record probable misspellings and duplicate keys."""
        if len(self._cautions) >= MAX_PROBLEMS:
            return
        for key in data:
            near = None if key in known else nearest(key, known, _RESEMBLES)
            if near is not None:
                self._cautions.append(
                    f'"{prefix}{key:.40}" is no key of a room file and is ignored; '
                    f'did you mean "{prefix}{near}"?'
                )
        twice = data.twice if isinstance(data, _Pairs) else ()
        self._cautions += [
            f'"{prefix}{key}" stands twice in the room file; the last one counts'
            for key in twice
            if key in known
        ]

    def _check_start(
        self,
        start: Pose2,
        walls: Polygon | None,
        obstacles: tuple[Polygon, ...],
        cliffs: tuple[Polygon, ...],
    ) -> None:
        place = f"start: ({start.x_m:g}, {start.y_m:g})"
        if walls is not None and not contains(walls, start.x_m, start.y_m):
            self._problems.append(f"{place} is outside the walls")
        for key, where, polygons in (("obstacles", "in", obstacles), ("cliffs", "over", cliffs)):
            for i, polygon in enumerate(polygons):
                if contains(polygon, start.x_m, start.y_m):
                    self._problems.append(f"{place} is {where} {key}[{i}]")
        if self._radius_m is not None and walls is not None:
            overlap_m = _overlap_m(start, (walls, *obstacles), self._radius_m)
            if overlap_m is not None and overlap_m > START_OVERLAP_M:
                blocked = StartBlockedError(start.x_m, start.y_m, self._radius_m, overlap_m)
                self._problems += blocked.problems


def _object(value: object, key: str) -> dict[str, object]:
    if not isinstance(value, dict):
        raise FloorPlanError(f"{key}: must be an object, not {value!r:.60}")
    return value


def _carpet(value: object, key: str) -> Carpet:
    data = _object(value, key)
    drag_n, slip = _number(data, _DRAG, key), _number(data, _SLIP, key)
    return Carpet(_polygon(_needed(data, _POLYGON.name, key), f"{key}.polygon"), drag_n, slip)


def _threshold(value: object, key: str) -> Threshold:
    data = _object(value, key)
    line = _needed(data, _LINE.name, key)
    if not isinstance(line, list) or len(line) != 2:  # noqa: PLR2004 - two ends
        raise FloorPlanError(f"{key}.line: must be two [x, y] points, not {line!r:.60}")
    ends = [_numbers(p, f"{key}.line[{i}]", _PLANE) for i, p in enumerate(line)]
    (ax, ay), (bx, by) = ends
    if math.hypot(bx - ax, by - ay) < 1e-3:  # noqa: PLR2004 - a millimetre
        raise FloorPlanError(f"{key}.line: its ends must lie apart")
    return Threshold((ax, ay), (bx, by), _number(data, _HEIGHT, key))


def _needed(data: dict[str, object], name: str, key: str) -> object:
    """Return the value of a required key."""
    if name not in data:
        raise FloorPlanError(f"{key}.{name}: is missing")
    return data[name]


def _number(data: dict[str, object], of: RoomKey, key: str) -> float:
    """Return a number in its range. If the key is missing, return its default, if any."""
    if of.name not in data and isinstance(of.default, float):
        return of.default
    path = f"{key}.{of.name}"
    (number,) = _numbers([_needed(data, of.name, key)], path, 1)
    if of.above_low and number == of.low:
        raise FloorPlanError(f"{path}: must be above {of.low:g}")
    if not of.low <= number <= of.high:
        raise FloorPlanError(f"{path}: {number:g} must be from {of.low:g} to {of.high:g}")
    return number


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
