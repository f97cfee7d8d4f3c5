"""Outcome of a run of the supervision campaign, and a check of its alarms against the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bridge.session.records import EventRecord, TruthRecord
from bridge.supervise import SuperviseSettings
from campaign.hazards import GRACE_S, Hazard
from tools.virtual.run import EPOCH_NS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.motion.geometry import Pose2
    from bridge.session.records import Record


@dataclass(frozen=True)
class Job:
    """One run."""

    room: str
    planner: str
    seed: int
    onboard: bool = True
    hazard: Hazard | None = None
    max_s: float = 600.0

    @property
    def name(self) -> str:
        """Unique name of the run."""
        where = (
            f"{self.room} {self.planner} seed {self.seed} {'device' if self.onboard else 'host'}"
        )
        what = "none" if self.hazard is None else self.hazard.name
        return f"{what}, {where}, {self.max_s:g} s"


@dataclass(frozen=True)
class Alarm:
    """Alarm of a rule."""

    at_s: float
    """Time since boot, s."""
    rule: str
    text: str
    true: bool = False
    """The truth confirms the alarm, although no fault was injected."""


@dataclass
class Outcome:
    """Outcome of a run."""

    job: Job
    supervised_s: float = 0.0
    at_s: float = 0.0
    """Start of the hazard, s."""
    alarms: list[Alarm] = field(default_factory=list)
    ending: str = ""
    ended_s: float = math.inf
    """End of the drive since boot, s."""
    by_device: bool = False
    """The device had stopped by itself, cause ``hardware``."""
    by_check: bool = False
    """A check of the run stopped it, cause ``supervise``. The rules only report."""

    @property
    def caught_s(self) -> float | None:
        """Return the time from the hazard's start to its detection, s, or None if undetected."""
        hazard = self.job.hazard
        assert hazard is not None
        end_s = hazard.ends_s(self.at_s) + GRACE_S
        times = [
            alarm.at_s - self.at_s
            for alarm in self.alarms
            if alarm.rule in hazard.rules and self.at_s <= alarm.at_s <= end_s
        ]
        return min(times, default=None)

    @property
    def ended_it(self) -> bool:
        """Return whether device, session or a check ended the run after the hazard began."""
        lost = self.ending.startswith("the device was lost and is back")
        hazard = self.job.hazard
        reset = lost and hazard is not None and "reset" in hazard.rules
        return self.ended_s >= self.at_s and (self.by_device or self.by_check or reset)


class Alarms:
    """A sink that keeps the alarms and the robot's true poses."""

    def __init__(self) -> None:
        """Start without alarms."""
        self.found: list[Alarm] = []
        self._poses: list[tuple[float, Pose2]] = []

    def write(self, record: Record) -> None:
        """Keep the relevant records."""
        if isinstance(record, TruthRecord):
            self._poses.append(((record.log_ns - EPOCH_NS) * 1e-9, record.pose))
        elif isinstance(record, EventRecord) and record.source == "supervise":
            at_s = (record.log_ns - EPOCH_NS) * 1e-9
            true = self._borne_out(at_s, record.data)
            self.found.append(Alarm(at_s, record.kind, record.text, true))

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Do nothing: there is nothing to close."""

    def _borne_out(self, at_s: float, data: Mapping[str, Any]) -> bool:
        """Return whether the truth confirms that the device's lane length D is wrong."""
        if "D_m" not in data or "for_s" not in data:
            return False
        path_m = lane_path_m(self._poses, at_s - float(data["for_s"]), at_s)
        off_m = abs(float(data["D_m"]) - path_m)
        return off_m > SuperviseSettings().disagreement.distance_m


def lane_path_m(poses: list[tuple[float, Pose2]], begun_s: float, end_s: float) -> float:
    """Return the true length of a straight lane, m; nan if unknown."""
    within = [pose for at_s, pose in poses if begun_s <= at_s <= end_s]
    if not within:
        return math.nan
    return max(within[0].distance_m(pose) for pose in within)
