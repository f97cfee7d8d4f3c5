"""Drawing of the planner's lanes and occluded regions, and of the pose's uncertainty."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.record.reader import MISREAD
from bridge.view.rerun import paths

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.view.rerun.columns import RerunRecording

_Z_LANE, _Z_OCCLUSION, _Z_COVARIANCE = 0.007, 0.005, 0.013
_SIGMAS = 2.0
"""Size of the covariance ellipse, in standard deviations."""
_ELLIPSE_PERIOD_NS = 200_000_000
"""Minimum time between two drawn ellipses, ns."""
_ANGLES = np.linspace(0.0, 2.0 * math.pi, 33)
_CIRCLE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
_SMALLEST_M = 1e-4
"""Minimum semi-axis of a drawn ellipse, m."""
_PAPERS = frozenset({"paper"})
"""Planners whose state contains the variables of the paper's Table 1."""
_ALONG = 0.7
"""Minimum cosine of the angle between a lane and the first lane. Other legs are ignored."""

Pose = tuple[float, float, float]
Strip = list[list[float]]


class Strips:
    """Line strips; each strip becomes visible at its own time."""

    def __init__(self, entity: str, colour: paths.Colour, width: float) -> None:
        self._entity, self._colour, self._width = entity, colour, width
        self._times: list[int] = []
        self._strips: list[Strip] = []

    def add(self, time_ns: int, strip: Strip) -> None:
        """Add a strip that is visible from this time on."""
        self._times.append(time_ns)
        self._strips.append(strip)

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        if not self._times:
            return
        strips = [np.array(strip, dtype=np.float32) for strip in self._strips]
        recording.send_strips(self._entity, self._times, strips, self._colour, self._width)
        self._times, self._strips = [], []


class Lanes:
    """Lanes, each drawn when it ends."""

    def __init__(self) -> None:
        self._strips = Strips(paths.LANES, paths.WHITE, 1.0)
        self._begun: Pose | None = None

    def state(self, time_ns: int, name: str, pose: Pose | None) -> None:
        """Handle a change of the planner's state."""
        if self._begun is not None and pose is not None:
            (x0, y0, _), (x1, y1, _) = self._begun, pose
            self._strips.add(time_ns, [[x0, y0, _Z_LANE], [x1, y1, _Z_LANE]])
        self._begun = pose if "lane" in name else None

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        self._strips.send(recording)


class OcclusionStrips:
    """Occluded regions: the floor behind an obstacle that ended a lane early.

    A lane has ended early if its end is more than the robot's diameter before the farthest end of
    all lanes in its direction (the paper's case 2). The occluded region extends to the farthest
    end.
    """

    def __init__(self, model: RobotModel) -> None:
        self._width_m, self._diameter_m = model.cleaning_width_m, 2.0 * model.radius_m
        self._strips = Strips(paths.OCCLUDED, paths.VIOLET, 1.0)
        self._axis: tuple[float, float] | None = None
        """Direction of the first lane."""
        self._min_m, self._max_m = math.inf, -math.inf
        """Extent of all lanes along the first lane's direction, m."""

    def lane(self, time_ns: int, data_json: str, pose: Pose | None) -> None:
        """Handle the planner's event for a lane that has ended at this pose."""
        try:
            length_m = float(json.loads(data_json)["distance_m"])
        except MISREAD:
            return
        if pose is None:
            return
        x_m, y_m, theta = pose
        if self._axis is None:
            self._axis = math.cos(theta), math.sin(theta)
        ax, ay = self._axis
        along = math.cos(theta) * ax + math.sin(theta) * ay
        if abs(along) < _ALONG:
            return  # not parallel to the lanes of this sweep
        here_m, sign = x_m * ax + y_m * ay, math.copysign(1.0, along)
        ends = here_m, here_m - sign * length_m
        self._min_m = min(self._min_m, *ends)
        self._max_m = max(self._max_m, *ends)
        hidden_m = self._max_m - here_m if sign > 0 else here_m - self._min_m
        if hidden_m > self._diameter_m:
            self._draw(time_ns, pose, hidden_m)

    def report(self, time_ns: int, data_json: str, pose: Pose | None) -> None:
        """Draw an occluded region from the planner's own event, along the driving direction."""
        try:
            data = json.loads(data_json)
            x_m, y_m = float(data["x_m"]), float(data["y_m"])
            length_m = float(data["length_m"])
        except MISREAD:
            return
        if pose is not None:
            self._draw(time_ns, (x_m, y_m, pose[2]), length_m, near=0.0)

    def _draw(self, time_ns: int, pose: Pose, hidden_m: float, near: float | None = None) -> None:
        # The depth of the obstacle is unknown, so the region is drawn from the obstacle's front.
        x_m, y_m, theta = pose
        near, half = self._diameter_m / 2 if near is None else near, self._width_m / 2
        far = near + hidden_m
        corners = ((near, -half), (far, -half), (far, half), (near, half), (near, -half))
        cosine, sine = math.cos(theta), math.sin(theta)
        strip = [
            [x_m + a * cosine - b * sine, y_m + a * sine + b * cosine, _Z_OCCLUSION]
            for a, b in corners
        ]
        self._strips.add(time_ns, strip)

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        self._strips.send(recording)


class Covariance:
    """The covariance ellipse of the position, two standard deviations."""

    def __init__(self) -> None:
        self._strips = Strips(paths.COVARIANCE, paths.BLUE, 1.0)
        self._next_ns = 0

    def add(self, time_ns: int, estimate: Any) -> None:  # noqa: ANN401 - type of a decoded value
        """Add an estimate. At most five ellipses per second are drawn."""
        if time_ns < self._next_ns:
            return
        self._next_ns = time_ns + _ELLIPSE_PERIOD_NS
        xx, xy, yy = estimate.covariance_xx, estimate.covariance_xy, estimate.covariance_yy
        if not all(map(math.isfinite, (xx, xy, yy))):
            return
        values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        axes = _SIGMAS * np.sqrt(np.maximum(values, _SMALLEST_M**2))
        points = vectors @ (axes[:, None] * _CIRCLE)
        self._strips.add(
            time_ns,
            [[estimate.x_m + x, estimate.y_m + y, _Z_COVARIANCE] for x, y in points.T.tolist()],
        )

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        self._strips.send(recording)


def describe(state: Any) -> str:  # noqa: ANN401 - type of a decoded value
    """Return the planner's state as Markdown. The paper's planner also has its variables."""
    target = "none"
    if state.HasField("target_x_m"):
        target = f"({state.target_x_m:.2f}, {state.target_y_m:.2f}) m"
    lines = [f"## {state.planner}: {state.state}", "| | |", "|---|---|"]
    if state.planner in _PAPERS:
        lines += [
            f"| T, turns | {state.turn_count} |",
            f"| D, this lane | {state.lane_distance_m:.2f} m |",
            f"| Prev-D, previous lane | {state.previous_lane_distance_m:.2f} m |",
            f"| Length, distance back | {state.length_m:.2f} m |",
            f"| case | {state.case or 'none'} |",
        ]
    lines.append(f"| target | {target} |")
    return "\n".join(lines)
