"""Reader of a run's track in its log: room, robot, poses and summary."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from bridge.motion.geometry import Pose2
from bridge.record.names import readable_name
from bridge.record.reader import LATEST_NS, MISREAD, LogReader
from bridge.view.run_reading import plan_of, robot_of

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel
    from bridge.record.reader import LogMessage

TRUTH_TOPIC, POSE_TOPIC = "/truth/pose", "/pose"
_FARTHEST_M = 1e5
"""Maximum valid distance of a pose from the origin, m. The comparison also rejects NaN."""


@dataclass(frozen=True, slots=True)
class RunTrack:
    """Room, robot and poses of a run."""

    name: str
    plan: FloorPlan | None
    model: RobotModel
    truth: list[tuple[float, Pose2]]
    """Time since the log's first pose (s) and true pose; may be empty."""
    estimate: list[tuple[float, Pose2]]
    """Time since the log's first pose (s) and estimated pose."""
    summary: dict[str, Any]
    start_ns: int = 0
    """Unix time of the log's first pose, ns; 0 if there is none."""
    problems: tuple[str, ...] = ()
    """Damage of the log, one line each."""

    @property
    def best(self) -> list[tuple[float, Pose2]]:
        """The true poses if they are known, else the estimated poses."""
        return self.truth or self.estimate

    @property
    def length_m(self) -> float:
        """Length of the path, m; jumps of the estimate are included."""
        steps = pairwise(pose for _, pose in self.best)
        return sum(math.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in steps)


def load_track(path: Path) -> RunTrack:
    """Read a log's room, robot, poses and summary.

    Raises:
        LogReadError: the file is missing or no log.

    """
    reader = LogReader(path)
    first_ns, truth, estimate = _poses(reader.messages({TRUTH_TOPIC, POSE_TOPIC}))
    return RunTrack(
        readable_name(path.stem),
        plan_of(reader),
        robot_of(reader),
        truth,
        estimate,
        reader.summary or {},
        first_ns,
        tuple(reader.problems),
    )


def _poses(
    messages: Iterable[LogMessage],
) -> tuple[int, list[tuple[float, Pose2]], list[tuple[float, Pose2]]]:
    """Return both tracks and the Unix time of the first pose; times are relative to this pose."""
    raw: dict[str, list[tuple[int, Pose2]]] = {TRUTH_TOPIC: [], POSE_TOPIC: []}
    for message in messages:
        try:
            pose = message.decoded.pose
            quaternion, position = pose.orientation, pose.position
            theta = 2.0 * math.atan2(quaternion.z, quaternion.w)
            x_m, y_m = float(position.x), float(position.y)
        except MISREAD:
            continue
        is_near = abs(x_m) < _FARTHEST_M and abs(y_m) < _FARTHEST_M and math.isfinite(theta)
        if is_near and message.log_ns <= LATEST_NS:
            raw[message.topic].append((message.log_ns, Pose2(x_m, y_m, theta)))
    first_ns = min((track[0][0] for track in raw.values() if track), default=0)
    truth, estimate = (
        [((t - first_ns) / 1e9, pose) for t, pose in raw[topic]]
        for topic in (TRUTH_TOPIC, POSE_TOPIC)
    )
    return first_ns, truth, estimate
