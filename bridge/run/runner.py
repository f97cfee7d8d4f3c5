"""What a run needs of whatever decides the velocity."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from bridge.coverage.planner import PlannerEvent, PlannerState
    from bridge.motion.observation import Observation, VelocityCommand


class Runner(Protocol):
    """What decides the velocity while the robot is free to move."""

    @property
    def finished(self) -> bool:
        """True when it has come to an end by itself."""

    @property
    def finish_reason(self) -> str | None:
        """Why it ended."""

    @property
    def turns(self) -> int:
        """Turns in place so far."""

    @property
    def lane_length_m(self) -> float:
        """Sum of the lanes driven (eq. 8)."""

    @property
    def state(self) -> PlannerState:
        """For the log."""

    @property
    def target(self) -> VelocityCommand:
        """The velocity wanted, before smoothing."""

    def step(self, obs: Observation) -> VelocityCommand:
        """The velocity for one control step."""

    def drain_events(self) -> list[PlannerEvent]:
        """Decisions since the last call."""


@runtime_checkable
class Pausable(Protocol):
    """A runner whose plan can be held, and gone on with."""

    def pause(self) -> None:
        """Hold: nothing moves, the plan is kept."""

    def resume(self) -> None:
        """Go on where it was held."""


def hold(runner: object) -> None:
    """Hold a plan, where it can be held."""
    if isinstance(runner, Pausable):
        runner.pause()


def release(runner: object) -> None:
    """Go on with a plan that was held."""
    if isinstance(runner, Pausable):
        runner.resume()
