"""Reader of room, robot, losses and pose errors in a run's log, for viewer and report."""

from __future__ import annotations

import bisect
import math
from typing import TYPE_CHECKING, Generic, TypeVar

from bridge.config import parse_robot
from bridge.errors import ConfigError
from bridge.floor_plan.floor_plan import FloorPlan, FloorPlanError, parse_floorplan
from bridge.motion.robot_model import RobotModel
from bridge.record.names import ROBOT_ATTACHMENT, ROOM_ATTACHMENT
from bridge.record.reader import MISREAD

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.record.reader import LogMessage, LogReader

_T = TypeVar("_T", int, float)
_MAX_WAITING = 500
"""Maximum number of estimates that wait for a true pose. Some logs have no true pose."""
_SEQUENCES = 1 << 8
"""Number of sequence numbers of a sender."""
_HALF_SEQUENCES = _SEQUENCES // 2


def plan_of(reader: LogReader) -> FloorPlan | None:
    """Return the run's room; None if the log has no valid room."""
    try:
        return parse_floorplan(reader.attachments[ROOM_ATTACHMENT].decode(errors="replace"))
    except (KeyError, FloorPlanError):
        return None


def robot_of(reader: LogReader) -> RobotModel:
    """Return the run's robot; the default robot if the log has no valid robot."""
    try:
        return parse_robot(reader.attachments[ROBOT_ATTACHMENT].decode(errors="replace"))
    except (KeyError, ConfigError):
        return RobotModel()


def boot_id_of(message: LogMessage) -> int | None:
    """Return the boot id of a recorded hello, or None for another or unreadable message."""
    if message.topic != "/device/hello":
        return None
    try:
        return int(message.decoded.boot_id)
    except (AttributeError, TypeError, *MISREAD):
        return None


class LossCounter:
    """Counts the numbers that are missing in one sender's sequence.

    A log sorts messages with equal times by topic, so a sequence number may arrive late. A late
    number is not a loss. A repeated number does not replace a lost one.
    """

    def __init__(self) -> None:
        self._newest: int | None = None
        self._missing: set[int] = set()
        """Missing numbers that may still arrive."""
        self._gone = 0
        """Number of missing numbers that cannot arrive any more."""
        self._boot_id: int | None = None
        self.lost = 0
        """Number of losses; it never decreases."""

    def add(self, sequence: int, boot_id: int | None = None) -> None:
        """Add the sequence number of a received message, and the boot id of a hello.

        The sequence restarts at a boot.
        """
        if boot_id is not None:
            if self._boot_id not in {None, boot_id}:
                self._forget(math.inf)
                self._newest = None
            self._boot_id = boot_id
        if self._newest is None:
            self._newest = sequence
            return
        step = (sequence - self._newest + _HALF_SEQUENCES) % _SEQUENCES - _HALF_SEQUENCES
        if step > 0:
            self._missing.update(range(self._newest + 1, self._newest + step))
            self._newest += step
            if self._missing:
                self._forget(self._newest - _HALF_SEQUENCES)
        else:
            self._missing.discard(self._newest + step)

    def update(self) -> int:
        """Return the new losses since the last call."""
        new = max(0, self._gone + len(self._missing) - self.lost)
        self.lost += new
        return new

    def _forget(self, before: float) -> None:
        """Count the numbers below ``before`` that are still missing."""
        gone = {number for number in self._missing if number < before}
        self._gone += len(gone)
        self._missing -= gone


class PoseErrors(Generic[_T]):
    """Position errors of the estimates relative to the true pose, which may arrive later."""

    def __init__(self) -> None:
        self._truth: list[tuple[_T, float, float]] = []
        self._estimates: list[tuple[_T, float, float]] = []

    def add_truth(self, time: _T, x_m: float, y_m: float) -> None:
        """Add a true position."""
        self._truth.append((time, x_m, y_m))

    def add_estimate(self, time: _T, x_m: float, y_m: float) -> None:
        """Add an estimated position."""
        self._estimates.append((time, x_m, y_m))

    def take(self) -> Iterator[tuple[_T, float]]:
        """Yield and discard time and error (m) of each estimate between two true positions."""
        truth, estimates = self._truth, self._estimates
        times = [time for time, _, _ in truth]
        waiting = []
        for time, x_m, y_m in estimates:
            at = bisect.bisect_right(times, time)
            if at >= len(times):
                waiting.append((time, x_m, y_m))
            elif at:
                (t0, x0, y0), (t1, x1, y1) = truth[at - 1], truth[at]
                share = (time - t0) / (t1 - t0) if t1 > t0 else 0.0
                yield time, math.hypot(x0 + share * (x1 - x0) - x_m, y0 + share * (y1 - y0) - y_m)
        self._truth, self._estimates = truth[-1:], waiting[-_MAX_WAITING:]
