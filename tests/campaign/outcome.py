"""What came of a run of the campaign over supervision, and what the truth says of its alarms."""

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
        """Told apart from every other."""
        where = (
            f"{self.room} {self.planner} seed {self.seed} {'device' if self.onboard else 'host'}"
        )
        what = "none" if self.hazard is None else self.hazard.name
        return f"{what}, {where}, {self.max_s:g} s"


@dataclass(frozen=True)
class Alarm:
    """What a rule said."""

    at_s: float
    """Since boot."""
    rule: str
    text: str
    true: bool = False
    """The truth bears it out, though nobody has injected anything."""


@dataclass
class Outcome:
    """What came of it."""

    job: Job
    supervised_s: float = 0.0
    at_s: float = 0.0
    """When the hazard began."""
    alarms: list[Alarm] = field(default_factory=list)
    ending: str = ""
    by_device: bool = False
    """It had stopped by itself, cause ``hardware``."""

    @property
    def caught_s(self) -> float | None:
        """How long after its beginning the hazard was found; None: it was not."""
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
        """Whether device or session stopped the run because of it, before any rule spoke."""
        lost = self.ending.startswith("the device was lost and is back")
        hazard = self.job.hazard
        return self.by_device or (lost and hazard is not None and "reset" in hazard.rules)


class Alarms:
    """A sink that keeps what the rules said, and where the robot truly was."""

    def __init__(self) -> None:
        """Nothing has been said."""
        self.found: list[Alarm] = []
        self._poses: list[tuple[float, Pose2]] = []

    def write(self, record: Record) -> None:
        """Keep what matters."""
        if isinstance(record, TruthRecord):
            self._poses.append(((record.log_ns - EPOCH_NS) * 1e-9, record.pose))
        elif isinstance(record, EventRecord) and record.source == "supervise":
            at_s = (record.log_ns - EPOCH_NS) * 1e-9
            true = self._borne_out(at_s, record.data)
            self.found.append(Alarm(at_s, record.kind, record.text, true))

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Nothing is open."""

    def _borne_out(self, at_s: float, data: Mapping[str, Any]) -> bool:
        """Of a disagreement over D: whether the device's D is off the true lane too."""
        if "D_m" not in data or "for_s" not in data:
            return False
        way_m = lane_way_m(self._poses, at_s - float(data["for_s"]), at_s)
        off_m = abs(float(data["D_m"]) - way_m)
        return off_m > SuperviseSettings().disagreement.distance_m


def lane_way_m(poses: list[tuple[float, Pose2]], begun_s: float, end_s: float) -> float:
    """How far a straight lane got from where it truly began; nan where nothing is known of it."""
    within = [pose for at_s, pose in poses if begun_s <= at_s <= end_s]
    if not within:
        return math.nan
    return max(within[0].distance_m(pose) for pose in within)
