"""State that the behaviours of the recovery planner share during one plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.observing import ObservationMonitor
from bridge.coverage.recovery.occlusions import OccludedRegion, OccludedRegions
from bridge.coverage.recovery.stuck import StuckPolicy
from bridge.coverage.recovery.wall_segments import WallSegments
from bridge.motion.legs import Dwell

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import PlannerReports, Step
    from bridge.coverage.recovery.geometry import PlannerGeometry
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.coverage.recovery.search import Chooser
    from bridge.motion.control.tuning import MotionTuning
    from bridge.motion.geometry import Pose2
    from bridge.motion.legs import Leg
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel

    Found = TypeVar("Found")


@dataclass(slots=True, eq=False)
class RecoveryContext:
    """The map, the helpers and the progress of one plan."""

    model: RobotModel
    options: RecoveryOptions
    evidence_map: EvidenceMap
    chooser: Chooser
    record: PlannerReports
    wall_segments: WallSegments
    occlusions: OccludedRegions
    monitor: ObservationMonitor
    stuck: StuckPolicy
    recovering: OccludedRegion | None = None
    """Occluded region that the present lane revisits; None: the lane revisits no region."""
    lane_m: float = 0.0
    """Length of the last lane, m."""
    searches: int = 0
    """Number of searches that were started."""

    @classmethod
    def begin(  # noqa: PLR0913 - the parts of the planner
        cls,
        model: RobotModel,
        options: RecoveryOptions,
        chooser: Chooser,
        record: PlannerReports,
        obs: Observation,
        *,
        motion: MotionTuning,
    ) -> RecoveryContext:
        """Begin a plan at the pose of ``obs`` with an empty map."""
        evidence_map, segments = EvidenceMap(model, options, obs.pose), WallSegments(options)
        return cls(
            model,
            options,
            evidence_map,
            chooser,
            record,
            segments,
            OccludedRegions(options, model.cleaning_width_m),
            ObservationMonitor(
                model, options, evidence_map, record, segments, obs=obs, motion=motion
            ),
            StuckPolicy(options, evidence_map, record),
        )

    @property
    def geometry(self) -> PlannerGeometry:
        """The sizes of the robot."""
        return self.evidence_map.geometry

    @property
    def obs(self) -> Observation:
        """The last observation."""
        return self.monitor.obs

    @property
    def pose(self) -> Pose2:
        """The last estimated pose."""
        return self.monitor.obs.pose

    def enter(self, phase: str, target: tuple[float, float] | None = None) -> None:
        """Report the phase of the plan, and the point to which the robot drives, m."""
        if self.recovering is not None and phase in {"transit", "lane"}:
            phase = f"recovery-{phase}"
        state = self.record.state
        if (phase, target) != (state.state, state.target):
            self.record.change(state=phase, target=target)

    def in_slices(self, search: Generator[None, None, Found]) -> Generator[Leg, Step, Found]:
        """Run a search. Stand still for one control step after each slice."""
        self.searches += 1
        while True:
            try:
                next(search)
            except StopIteration as stop:
                found: Found = stop.value
                return found
            self.enter("think")
            yield Dwell(0.0, purpose="think")
