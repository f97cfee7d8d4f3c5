"""A planner: drive until something ends the leg, turn by a fixed angle, drive on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.coverage.planner import ScriptedPlanner
from bridge.coverage.planner_options import parse_options
from bridge.motion.geometry import wrap_angle
from bridge.motion.legs import Drive, StopReason, Turn

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from bridge.coverage.planner import Step
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel


@dataclass(frozen=True, slots=True)
class Options:
    """What `--planner-option NAME=VALUE` sets."""

    turn_rad: float = 2.4
    """Turn after each leg; 2.4 rad is the golden angle, so that headings never repeat."""
    legs: int = 40
    """Number of legs after which the plan ends."""
    stop_range_m: float = 0.05
    """Ultrasonic range at which a leg ends before a wall, m."""


class FixedTurnPlanner(ScriptedPlanner):
    """The plan as a coroutine: it yields legs, and is sent how each ended."""

    def __init__(self, model: RobotModel, options: Options) -> None:
        super().__init__(model)
        self.options = options

    def script(self, obs: Observation) -> Generator[Drive | Turn, Step, str]:
        """Plan from the pose in ``obs``."""
        heading = obs.pose.theta_rad
        for _ in range(self.options.legs):
            self.record.change(state="drive")
            result, obs = yield Drive(
                heading, stop_range_m=self.options.stop_range_m, purpose="lane"
            )
            if result.reason in {StopReason.BUMPER, StopReason.CLIFF}:
                yield Drive(heading, -0.05, speed_m_s=0.05, purpose="back-off")
            heading = wrap_angle(heading + self.options.turn_rad)
            self.record.decide("turn", f"leg ended: {result.reason}", heading_rad=heading)
            self.record.change(state="turn", turn_count=self.record.state.turn_count + 1)
            yield Turn(heading)
        return f"{self.options.legs} legs are done"


def make(model: RobotModel, rng: object, options: Sequence[str]) -> FixedTurnPlanner:
    """The entry point: a planner for this robot, with the options of the command line."""
    del rng  # this planner needs no chance
    return FixedTurnPlanner(model, parse_options(Options, options))
