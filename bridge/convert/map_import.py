"""Import of ROS maps and SVG floor plans as rooms."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import ndimage

from bridge.convert.mask_outlines import outlines, roomiest, simplified
from bridge.errors import BridgeError
from bridge.files import open_to_read
from bridge.floor_plan.floor_plan import (
    MAX_POINTS,
    Carpet,
    FloorPlan,
    FloorPlanError,
    Threshold,
    signed_area_m2,
)
from bridge.floor_plan.keys import MAX_EXTENT_M
from bridge.motion.geometry import Pose2

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bridge.floor_plan.floor_plan import Point, Polygon

_MAX_BYTES = 64 * 1024 * 1024
"""Maximum size of a file, bytes. It is a map of 8000 × 8000 cells."""
_MAX_PIXELS = 64_000_000
_YAML = (".yaml", ".yml")
FORMATS = (*_YAML, ".svg")
_MODES = ("trinary",)
_SVG_TOLERANCE_M = 0.01
_STEP = 0.75
"""Tolerance for a ROS map, in cells. In a wall at 45°, the cells' corners are 0.71 cells off the
line."""
_CURVE_STEPS = 16
"""Number of straight segments per curve of an SVG. The simplification removes segments that are not
needed."""
_THRESHOLD_M = 0.005
"""Height of a threshold from an SVG, m. An SVG has no heights. The default robot can cross this
threshold."""


class MapsMissingError(BridgeError):
    """A library that reads maps is not installed."""

    def __init__(self) -> None:
        super().__init__("importing maps needs some libraries: pip install 'sweepctl[maps]'")


def import_map(
    path: Path, *, scale_m: float | None, tolerance_m: float | None, start: Pose2 | None
) -> FloorPlan:
    """Read a ROS map (``.yaml`` beside its image) or an SVG floor plan.

    Args:
        path: the file.
        scale_m: length of one unit of an SVG, m.
        tolerance_m: maximum distance of a removed corner from the simplified outline, m; None: 0.75
            cells for a map, 1 cm for an SVG.
        start: start pose; None: the start in the file, else the place farthest from all walls.

    Raises:
        FloorPlanError: the file is not a map, or not valid as a room.
        MapsMissingError: a library is not installed.

    """
    if path.suffix.lower() in _YAML:
        if scale_m is not None:
            raise FloorPlanError(f"{path}: a ROS map has its own resolution; leave out the scale")
        return _ros_map(path, tolerance_m, start)
    if path.suffix.lower() == ".svg":
        if scale_m is None:
            raise FloorPlanError(f"{path}: an SVG needs a scale, the length of one unit in metres")
        tolerance_m = _SVG_TOLERANCE_M if tolerance_m is None else tolerance_m
        return _svg_plan(path, scale_m, tolerance_m, start)
    raise FloorPlanError(f"{path}: the format is not one of {', '.join(FORMATS)}")


def _content(path: Path) -> bytes:
    try:
        with open_to_read(path) as file:
            content = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise FloorPlanError(f"cannot read {path}: {error.strerror}") from None
    if len(content) > _MAX_BYTES:
        raise FloorPlanError(f"{path} is larger than {_MAX_BYTES} bytes")
    return content


# -------------------------------------------------------------------------------- ROS


class _RosMap(NamedTuple):
    """Content of a map's YAML file, with the fields that nav2's map_server reads."""

    image: str
    resolution_m: float
    origin: tuple[float, float, float]
    negate: bool
    occupied: float
    free: float


def _ros_map(path: Path, tolerance_m: float | None, start: Pose2 | None) -> FloorPlan:
    about = _ros_yaml(path)
    if tolerance_m is None:
        tolerance_m = _STEP * about.resolution_m
    free = _free_cells(path.parent / about.image, about)
    labels, count = ndimage.label(free)  # cells with a common edge are connected
    if not count:
        raise FloorPlanError(f"{path}: no cell of the map is free")
    sizes = np.bincount(labels.ravel())[1:]
    floor = labels == int(np.argmax(sizes)) + 1
    if start is not None:
        floor = _piece_at(labels, about, start, path)
    loops = outlines(floor)
    cosine, sine = math.cos(about.origin[2]), math.sin(about.origin[2])

    def placed(corner: tuple[int, int]) -> Point:
        x_m, y_m = corner[0] * about.resolution_m, corner[1] * about.resolution_m
        return (
            round(about.origin[0] + cosine * x_m - sine * y_m, 4),
            round(about.origin[1] + sine * x_m + cosine * y_m, 4),
        )

    polygons = [simplified([placed(c) for c in loop], tolerance_m) for loop in loops]
    polygons = [p for p in polygons if len(p) > 2 and abs(signed_area_m2(p)) > 1e-6]  # noqa: PLR2004
    if not polygons:
        raise FloorPlanError(f"{path}: the free floor is smaller than the tolerance")
    walls = max(polygons, key=lambda polygon: abs(signed_area_m2(polygon)))
    obstacles = tuple(p[::-1] for p in polygons if p is not walls)
    return _room(path, walls, obstacles, start)


def _piece_at(
    labels: np.ndarray[Any, np.dtype[np.int32]], about: _RosMap, start: Pose2, path: Path
) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return the connected free floor that contains the start."""
    dx_m, dy_m = start.x_m - about.origin[0], start.y_m - about.origin[1]
    cosine, sine = math.cos(about.origin[2]), math.sin(about.origin[2])
    column = math.floor((cosine * dx_m + sine * dy_m) / about.resolution_m)
    row = math.floor((cosine * dy_m - sine * dx_m) / about.resolution_m)
    rows, columns = labels.shape
    if not (0 <= row < rows and 0 <= column < columns) or not labels[row, column]:
        raise FloorPlanError(f"{path}: the start ({start.x_m:g}, {start.y_m:g}) is not free")
    return np.asarray(labels == labels[row, column])


def _ros_yaml(path: Path) -> _RosMap:
    try:
        import yaml  # noqa: PLC0415 - an optional dependency, imported where it is used
    except ImportError:
        raise MapsMissingError from None
    try:
        data = yaml.load(_content(path), Loader=_yaml_loader(yaml))  # noqa: S506 - a safe loader
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise FloorPlanError(f"{path} is not valid YAML: {_yaml_problem(error)}") from None
    if not isinstance(data, dict):
        raise FloorPlanError(f"{path}: must be a map with the keys image, resolution and origin")
    return _ros_keys(path, data)


def _yaml_loader(yaml: Any) -> Any:  # noqa: ANN401 - untyped
    """Return a safe loader whose only errors are those of YAML.

    PyYAML raises a ValueError for the date 2020-13-45 and for the number 0x_, among others.
    """

    class Loader(yaml.SafeLoader):  # type: ignore[misc]  # an optional dependency
        def construct_object(self, node: Any, deep: bool = False) -> Any:  # noqa: ANN401, FBT001, FBT002 - its interface
            try:
                return super().construct_object(node, deep)
            except (ValueError, LookupError, TypeError, AttributeError):
                value = getattr(node, "value", "")
                problem = f"{value!r:.40} is no {node.tag.rpartition(':')[2]}"
                raise yaml.constructor.ConstructorError(
                    None, None, problem, node.start_mark
                ) from None

    return Loader


def _yaml_problem(error: Exception) -> str:
    """Return the problem and its line, in one line."""
    problem = getattr(error, "problem", None)
    mark = getattr(error, "problem_mark", None)
    if problem is None or mark is None:
        return str(error).splitlines()[0]
    return f"line {mark.line + 1}: {problem}"


def _ros_keys(path: Path, data: dict[object, Any]) -> _RosMap:
    problems: list[str] = []

    def number(key: str, low: float, high: float, default: float | None = None) -> float:
        value = data.get(key, default)
        if isinstance(value, int | float) and low <= value <= high:
            return float(value)
        missing = (
            "is missing" if value is None else f"{value!r:.40} is not from {low:g} to {high:g}"
        )
        problems.append(f"{key}: {missing}")
        return low

    resolution_m = number("resolution", 0.001, 1.0)
    occupied, free = (
        number("occupied_thresh", 0.0, 1.0, 0.65),
        number("free_thresh", 0.0, 1.0, 0.25),
    )
    if occupied < free and not problems:
        problems.append(f"occupied_thresh: {occupied:g} is below free_thresh, {free:g}")
    negate = data.get("negate", 0)
    if negate not in (0, 1):
        problems.append(f"negate: {negate!r:.40} is not 0 or 1")
    if data.get("mode", "trinary") not in _MODES:
        problems.append(f"mode: {data['mode']!r:.40} is not {' or '.join(_MODES)}")
    image = data.get("image")
    if not isinstance(image, str) or not image or "\0" in image:
        problems.append("image: must be the name of the map's image")
    origin = data.get("origin")
    if not (
        isinstance(origin, list)
        and len(origin) == 3  # noqa: PLR2004 - x, y, yaw
        and all(isinstance(v, int | float) and abs(v) <= MAX_EXTENT_M for v in origin)
    ):
        problems.append("origin: must be [x, y, yaw], in metres and radians")
        origin = [0.0, 0.0, 0.0]
    if problems:
        raise FloorPlanError(*problems, source=str(path))
    x_m, y_m, yaw_rad = map(float, origin)
    return _RosMap(str(image), resolution_m, (x_m, y_m, yaw_rad), bool(negate), occupied, free)


def _free_cells(path: Path, about: _RosMap) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Read the image; return a mask of the free cells, with the lowest row first."""
    try:
        from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 - an extra
    except ImportError:
        raise MapsMissingError from None
    import io  # noqa: PLC0415 - beside the extra

    content = _content(path)
    try:
        with Image.open(io.BytesIO(content)) as image:
            if image.width * image.height > _MAX_PIXELS:
                raise FloorPlanError(f"{path} has more than {_MAX_PIXELS} pixels")
            grey = np.asarray(image.convert("L"), dtype=np.float64)
    except UnidentifiedImageError:
        raise FloorPlanError(f"{path} is no image that can be read") from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        if isinstance(error, FloorPlanError):
            raise
        raise FloorPlanError(f"{path} is no image that can be read: {error}") from None
    occupancy = grey / 255.0 if about.negate else (255.0 - grey) / 255.0
    # As in map_server's mode trinary, a cell is occupied above one threshold, free below the other
    # threshold, and else unknown. Unknown cells are not floor.
    free = (occupancy < about.free) & ~(occupancy > about.occupied)
    return np.asarray(free[::-1])


# -------------------------------------------------------------------------------- SVG

_ROLES = {
    "wall": "walls",
    "walls": "walls",
    "obstacle": "obstacles",
    "obstacles": "obstacles",
    "furniture": "obstacles",
    "carpet": "carpets",
    "carpets": "carpets",
    "rug": "carpets",
    "rugs": "carpets",
    "threshold": "thresholds",
    "thresholds": "thresholds",
    "cliff": "cliffs",
    "cliffs": "cliffs",
    "stair": "cliffs",
    "stairs": "cliffs",
    "staircase": "cliffs",
    "start": "start",
}
"""Map of a whole word in the id, class or label of a shape or of a group around it, to the role."""
_ROOM = "room"
"""Word that makes a shape the walls if its own name has no word of ``_ROLES``. The word means
nothing in a group's name: a group named after a room contains the room's shapes."""
_LETTERS = re.compile(r"[^\W\d_]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


class _Shape(NamedTuple):
    role: str
    points: list[Point]


def _svg_plan(path: Path, scale_m: float, tolerance_m: float, start: Pose2 | None) -> FloorPlan:
    shapes = list(_svg_shapes(path))
    if not shapes:
        raise FloorPlanError(f"{path} has no shape")
    below = max(y for shape in shapes for _, y in shape.points)
    left = min(x for shape in shapes for x, _ in shape.points)

    def placed(shape: _Shape) -> list[Point]:
        return [
            (round((x - left) * scale_m, 4), round((below - y) * scale_m, 4))
            for x, y in shape.points
        ]

    by_role: dict[str, list[Polygon]] = {}
    thresholds: list[Threshold] = []
    for shape in shapes:
        points = placed(shape)
        if shape.role == "thresholds":
            a, b = points[0], max(points, key=lambda p: math.dist(p, points[0]))
            if math.dist(a, b) > 1e-3:  # noqa: PLR2004 - a millimetre
                thresholds.append(Threshold(a, b, _THRESHOLD_M))
            continue
        polygon = simplified(points, tolerance_m)
        if shape.role == "start" or (len(polygon) > 2 and abs(signed_area_m2(polygon)) > 1e-6):  # noqa: PLR2004
            by_role.setdefault(shape.role, []).append(polygon)
    walls, obstacles = _walls(path, by_role)
    marked = by_role.get("start", [])
    if start is None and marked:
        x_m, y_m = np.mean(marked[0], axis=0)
        start = Pose2(round(float(x_m), 4), round(float(y_m), 4), 0.0)
    carpets = tuple(Carpet(p) for p in by_role.get("carpets", ()))
    cliffs = tuple(by_role.get("cliffs", ()))
    return _room(path, walls, obstacles, start, carpets, tuple(thresholds), cliffs)


def _walls(path: Path, by_role: dict[str, list[Polygon]]) -> tuple[Polygon, tuple[Polygon, ...]]:
    """Return walls and obstacles. If no shape is named as walls, the largest shape is the walls."""
    unnamed = sorted(by_role.get("", ()), key=lambda p: -abs(signed_area_m2(p)))
    named = by_role.get("walls", [])
    if len(named) > 1:
        raise FloorPlanError(f"{path}: {len(named)} shapes are named walls; a room has one outline")
    if not named and not unnamed:
        raise FloorPlanError(f"{path} has no closed shape that could be the walls")
    walls, others = (named[0], unnamed) if named else (unnamed[0], unnamed[1:])
    return walls, (*by_role.get("obstacles", ()), *others)


def _svg_shapes(path: Path) -> Iterator[_Shape]:
    """Read every shape as points in the units of the SVG, with y downward."""
    try:
        import svgelements  # noqa: PLC0415 - an optional dependency, imported where it is used
    except ImportError:
        raise MapsMissingError from None
    import io  # noqa: PLC0415 - beside the extra

    try:
        drawing = svgelements.SVG.parse(io.BytesIO(_content(path)), reify=True)
    except FloorPlanError:
        raise
    except Exception as error:  # noqa: BLE001 - its errors have no common base
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        what = _wrong_transform(svgelements, _content(path)) or what
        raise FloorPlanError(f"{path} is not valid SVG: {what}") from None
    yield from _walk(svgelements, drawing, "")


def _wrong_transform(svgelements: Any, content: bytes) -> str | None:  # noqa: ANN401 - untyped
    """Return the first element whose transform cannot be read, with the value."""
    from xml.etree import ElementTree as ET  # noqa: PLC0415 - only after an error

    try:
        elements = list(ET.fromstring(content).iter())  # noqa: S314 - as svgelements does
    except ET.ParseError:
        return None
    for element in elements:
        value = element.get("transform", "")
        try:
            svgelements.Matrix(value)
        except Exception:  # noqa: BLE001 - its errors have no common base
            return f"transform of {element.tag.rpartition('}')[2]}: {value!r:.40} is wrong"
    return None


def _walk(svgelements: Any, element: Any, role: str) -> Iterator[_Shape]:  # noqa: ANN401 - untyped
    """Read the shapes of an element; ``role`` is the role of the groups around it."""
    words = _words(element)
    # The last word is the noun: a wall rug is a rug.
    role = next((_ROLES[word] for word in reversed(words) if word in _ROLES), role)
    if isinstance(element, svgelements.Shape):
        if _ROOM in words and not any(word in _ROLES for word in words):
            role = "walls"
        for part in svgelements.Path(element).as_subpaths():
            points = _points(svgelements, part)
            if len(points) > 1 and all(math.isfinite(v) for point in points for v in point):
                yield _Shape(role, points)
    elif isinstance(element, list):
        for inner in element:
            yield from _walk(svgelements, inner, role)


def _points(svgelements: Any, part: Any) -> list[Point]:  # noqa: ANN401 - untyped
    """Return the corners of a sub-path. Curves become short straight segments."""
    points: list[Point] = []
    for segment in part:
        if isinstance(segment, svgelements.Move) or segment.end is None:
            continue
        if not points and segment.start is not None:
            points.append((float(segment.start.x), float(segment.start.y)))
        is_straight = isinstance(segment, svgelements.Line | svgelements.Close)
        steps = 1 if is_straight else _CURVE_STEPS
        for step in range(1, steps + 1):
            at = segment.end if steps == 1 else segment.point(step / steps)
            points.append((float(at.x), float(at.y)))
    if len(points) > 1 and points[0] == points[-1]:
        points.pop()
    return points


def _words(element: Any) -> list[str]:  # noqa: ANN401 - untyped
    """Return the words of an element's own label, class and id, in lower case.

    Words end at characters that are no letters, and at capitals as in ``bathroomRug``.
    """
    values = getattr(element, "values", None) or {}
    own = values.get("attributes", values)
    label = next((str(v) for k, v in own.items() if str(k).endswith("label")), "")
    text = " ".join((label, *(str(own.get(key) or "") for key in ("class", "id"))))
    return [word.lower() for run in _LETTERS.findall(text) for word in _CAMEL.split(run)]


# ------------------------------------------------------------------------------- both


def _room(  # noqa: PLR0913, PLR0917 - one parameter for each key of a room
    path: Path,
    walls: Polygon,
    obstacles: tuple[Polygon, ...],
    start: Pose2 | None,
    carpets: tuple[Carpet, ...] = (),
    thresholds: tuple[Threshold, ...] = (),
    cliffs: tuple[Polygon, ...] = (),
) -> FloorPlan:
    if signed_area_m2(walls) < 0:
        walls = walls[::-1]
    corners = len(walls) + sum(map(len, obstacles))
    if corners > MAX_POINTS:
        raise FloorPlanError(
            f"{path}: {corners} corners, more than {MAX_POINTS}; a larger tolerance leaves some out"
        )
    if max(abs(value) for point in walls for value in point) > MAX_EXTENT_M:
        raise FloorPlanError(
            f"{path}: the room is larger than {MAX_EXTENT_M:g} m; is the scale right?"
        )
    pose = start or roomiest(walls, (*obstacles, *cliffs))
    return FloorPlan(path.stem, walls, obstacles, pose, carpets, thresholds, cliffs)
