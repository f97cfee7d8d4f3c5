"""Drawing of the room from above: walls, swept floor, paths and the robot."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from bridge.record.encode.ros import parse_occupancy_grid
from bridge.view.rerun import paths

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan, Polygon
    from bridge.motion.robot_model import RangerMount, RobotModel
    from bridge.session.records import CoverageRecord
    from bridge.view.rerun.columns import RerunRecording

_PATH_STEP_M = 0.01
"""Distance between two points of a path, m. Finer detail is not visible."""
_MAX_MAP_BYTES = 48 * 1024 * 1024
"""Memory limit of the maps, bytes. Above it, every second map is discarded."""

# Heights of the layers, m. They define which layer hides another; the camera is far above.
_Z_SWEPT, _Z_WHOLE, _Z_WALL, _Z_TRUTH, _Z_PATH, _Z_ROBOT = 0.002, 0.004, 0.006, 0.008, 0.010, 0.014

_RGBA = 4
_FLOOR, _BLOCK = (46, 50, 58, 255), (120, 108, 96, 255)
_SWEPT = (64, 170, 110, 150)
_OPACITY = 0.999
"""Opacity of the swept map. It is below 1, because with 1 Rerun draws transparent cells black. The
map of the room is opaque, because Rerun draws several transparent maps in the order of their
centres' distances, the nearest last."""
_OCCUPIED = 50
"""Minimum value of an occupied cell, in 0 to 100 (nav_msgs). Lower values are free floor or, in the
swept map, swept floor."""


def draw_plan(recording: RerunRecording, plan: FloorPlan) -> None:
    """Draw the lines of the room file for the whole run."""
    recording.log_static(
        paths.WALLS,
        rr.LineStrips3D(
            [_closed(polygon) for polygon in (plan.walls, *plan.obstacles)],
            colors=paths.WHITE,
            radii=rr.Radius.ui_points(1.5),
        ),
    )

    for entity, name, colour, polygons in (
        (paths.CARPETS, "carpet", paths.MAGENTA, [carpet.polygon for carpet in plan.carpets]),
        (paths.CLIFFS, "cliff", paths.RED, plan.cliffs),
    ):
        _label(recording, entity, name, colour, [_closed(polygon) for polygon in polygons])
    bars = [[[x, y, _Z_WALL] for x, y in (bar.begin, bar.end)] for bar in plan.thresholds]
    _label(recording, paths.THRESHOLDS, "threshold", paths.YELLOW, bars)


def _label(
    recording: RerunRecording,
    entity: str,
    name: str,
    colour: paths.Colour,
    strips: list[list[list[float]]],
) -> None:
    """Draw lines with a label at the first line."""
    if strips:
        recording.log_static(
            entity,
            rr.LineStrips3D(
                strips,
                colors=colour,
                radii=rr.Radius.ui_points(1.5),
                labels=[name, *[""] * (len(strips) - 1)],
                show_labels=True,
            ),
        )


def _closed(polygon: Polygon) -> list[list[float]]:
    return [[x, y, _Z_WALL] for x, y in (*polygon, polygon[0])]


def draw_robot(recording: RerunRecording, model: RobotModel) -> None:
    """Draw footprint, heading and mouth in the robot's frame."""
    turns = np.linspace(0.0, 2.0 * math.pi, 49)
    radius_m, half_m, mouth_m = model.radius_m, model.cleaning_width_m / 2, model.mouth_offset_m
    footprint = np.stack(
        [radius_m * np.cos(turns), radius_m * np.sin(turns), np.full_like(turns, _Z_ROBOT)], axis=1
    )
    heading = [[0.0, 0.0, _Z_ROBOT], [radius_m, 0.0, _Z_ROBOT]]
    mouth = [[mouth_m, -half_m, _Z_ROBOT], [mouth_m, half_m, _Z_ROBOT]]
    recording.log_static(
        f"{paths.ROBOT}/body",
        rr.LineStrips3D(
            [footprint, heading, mouth],
            colors=[paths.ORANGE, paths.ORANGE, paths.GREEN],
            # A negative size is in points of the screen, not in metres.
            radii=[-2.0, -2.0, -3.5],
        ),
    )


class Track:
    """A path that grows with time, as a sequence of short strokes."""

    def __init__(self, entity: str, colour: paths.Colour, z_m: float, width: float) -> None:
        self._entity, self._colour, self._z_m, self._width = entity, colour, z_m, width
        self._times: list[int] = []
        self._strokes: list[tuple[tuple[float, float, float], tuple[float, float, float]]] = []
        self._last: tuple[float, float, float] | None = None

    def add(self, time_ns: int, x_m: float, y_m: float) -> None:
        """Extend the path to a point."""
        here = (x_m, y_m, self._z_m)
        if self._last is not None:
            if math.hypot(x_m - self._last[0], y_m - self._last[1]) < _PATH_STEP_M:
                return
            self._times.append(time_ns)
            self._strokes.append((self._last, here))
        self._last = here

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        if not self._times:
            return
        strokes = np.array(self._strokes, dtype=np.float32)
        recording.send_strips(self._entity, self._times, strokes, self._colour, self._width)
        self._times, self._strokes = [], []


def path_track() -> Track:
    """Return the estimated path; the view shows its last minute."""
    return Track(paths.PATH, paths.BLUE, _Z_PATH, 1.2)


def whole_track() -> Track:
    """Return the whole estimated path. It is drawn in a faint colour below its last minute."""
    return Track(paths.WHOLE_PATH, paths.FAINT, _Z_WHOLE, 0.6)


def truth_track() -> Track:
    """Return the true path from the simulator."""
    return Track(paths.TRUTH_PATH, paths.VIOLET, _Z_TRUTH, 2.4)


class Motion:
    """The pose of the robot's frame over time."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._poses: list[tuple[float, float, float]] = []

    def add(self, time_ns: int, x_m: float, y_m: float, theta_rad: float) -> None:
        """Add a pose."""
        self._times.append(time_ns)
        self._poses.append((x_m, y_m, theta_rad))

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        if not self._times:
            return
        poses = np.array(self._poses, dtype=np.float64)
        nought = np.zeros(len(poses))
        half = 0.5 * poses[:, 2]
        columns = rr.Transform3D.columns(
            translation=np.stack([poses[:, 0], poses[:, 1], nought], axis=1),
            quaternion=np.stack([nought, nought, np.sin(half), np.cos(half)], axis=1),
        )
        recording.send(paths.ROBOT, self._times, columns)
        self._times, self._poses = [], []


class Ray:
    """Ray of one range sensor, in the robot's frame; without an echo there is no ray."""

    def __init__(self, name: str, mount: RangerMount, colour: paths.Colour) -> None:
        self._entity = f"{paths.ROBOT}/range_{name}"
        self._mount, self._colour = mount, colour
        self._times: list[int] = []
        self._rays: list[list[list[float]]] = []
        self._counts: list[int] = []

    def add(self, time_ns: int, range_m: float | None) -> None:
        """Add a ray of this length."""
        self._times.append(time_ns)
        self._counts.append(0 if range_m is None else 1)
        if range_m is not None:
            x_m, y_m, yaw_rad = self._mount.x_m, self._mount.y_m, self._mount.yaw_rad
            end = [x_m + range_m * math.cos(yaw_rad), y_m + range_m * math.sin(yaw_rad), _Z_ROBOT]
            self._rays.append([[x_m, y_m, _Z_ROBOT], end])

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        if not self._times:
            return
        recording.style(
            self._entity,
            rr.LineStrips3D.from_fields(colors=self._colour, radii=rr.Radius.ui_points(1.0)),
        )
        rays = np.array(self._rays, dtype=np.float32).reshape(-1, 2, 3)
        columns = rr.LineStrips3D.columns(strips=rays)
        recording.send(self._entity, self._times, columns.partition(self._counts))
        self._times, self._rays, self._counts = [], [], []


class TargetPoint:
    """The point that the planner drives to."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._points: list[list[float]] = []
        self._counts: list[int] = []

    def add(self, time_ns: int, point: tuple[float, float] | None) -> None:
        """Add a target; None if there is none."""
        self._times.append(time_ns)
        self._counts.append(0 if point is None else 1)
        if point is not None:
            self._points.append([*point, _Z_ROBOT])

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        if not self._times:
            return
        recording.style(
            paths.TARGET,
            rr.Points3D.from_fields(colors=paths.RED, radii=rr.Radius.ui_points(4.0)),
        )
        points = np.array(self._points, dtype=np.float32).reshape(-1, 3)
        columns = rr.Points3D.columns(positions=points)
        recording.send(paths.TARGET, self._times, columns.partition(self._counts))
        self._times, self._points, self._counts = [], [], []


class Maps:
    """Occupancy grids over time: the map of the room or the swept floor."""

    def __init__(self, entity: str, *, swept: bool) -> None:
        self._entity = entity
        self._swept = swept
        self._grids: list[CoverageRecord] = []
        self._latest: CoverageRecord | None = None
        self._bytes = 0
        self._stride = self._seen = 1

    def add(self, time_ns: int, data: bytes) -> None:
        """Store a ``nav_msgs/OccupancyGrid``. Above the memory limit, discard every second map."""
        self._latest = parse_occupancy_grid(time_ns, data)
        self._seen += 1
        if self._seen % self._stride:
            return
        self._grids.append(self._latest)
        self._bytes += _RGBA * self._latest.cells.size
        if self._bytes > _MAX_MAP_BYTES:
            self._grids = self._grids[::2]
            self._bytes = sum(_RGBA * grid.cells.size for grid in self._grids)
            self._stride *= 2

    def send(self, recording: RerunRecording) -> None:
        """Send the stored maps, and always the last map."""
        if self._latest is not None and (not self._grids or self._grids[-1] is not self._latest):
            self._grids.append(self._latest)
        stream = recording.stream
        for grid in self._grids:
            rows, columns = grid.cells.shape
            # Rerun places an image's last row at the origin, but an occupancy grid's first row is
            # there.
            image = self._paint(grid.cells[::-1])
            map_ = rr.GridMap(
                data=image.tobytes(),
                format=rr.components.ImageFormat(
                    width=columns, height=rows, color_model="RGBA", channel_datatype="U8"
                ),
                cell_size=grid.resolution_m,
                translation=[grid.origin_x_m, grid.origin_y_m, _Z_SWEPT if self._swept else 0.0],
                draw_order=1.0 if self._swept else 0.0,
                opacity=_OPACITY if self._swept else None,
            )
            stream.set_time(paths.TIMELINE, duration=recording.seconds(grid.log_ns))
            stream.set_time(paths.UNIX_TIMELINE, timestamp=np.datetime64(grid.log_ns, "ns"))
            stream.log(self._entity, map_)
        stream.reset_time()
        self._grids, self._latest, self._bytes = [], None, 0

    def _paint(
        self, cells: np.ndarray[Any, np.dtype[np.int8]]
    ) -> np.ndarray[Any, np.dtype[np.uint8]]:
        """Return the colours of the cells.

        Unknown cells are transparent or have the background colour.
        """
        image = np.zeros((*cells.shape, _RGBA), dtype=np.uint8)
        if not self._swept:
            image[:] = (*paths.BACKGROUND, 255)
        image[(cells >= 0) & (cells < _OCCUPIED)] = _SWEPT if self._swept else _FLOOR
        image[cells >= _OCCUPIED] = _BLOCK
        return image
