"""Interface of the object that decides the velocity of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from bridge.coverage.planner import PlannerEvent, PlannerState
    from bridge.motion.observation import Observation, VelocityCommand


class Runner(Protocol):
    """Decides the velocity while the robot may move."""

    @property
    def finished(self) -> bool:
        """True if the runner has ended by itself."""

    @property
    def finish_reason(self) -> str | None:
        """Reason of the runner's end; None before its end."""

    @property
    def turns(self) -> int:
        """Number of turns in place."""

    @property
    def lane_length_m(self) -> float:
        """Total length of the lanes driven, m (eq. 8)."""

    @property
    def state(self) -> PlannerState:
        """State for the log."""

    @property
    def target(self) -> VelocityCommand:
        """Target velocity before smoothing."""

    def step(self, obs: Observation) -> VelocityCommand:
        """Return the velocity setpoint of one control step."""

    def drain_events(self) -> list[PlannerEvent]:
        """Return the events since the last call."""


@runtime_checkable
class Pausable(Protocol):
    """A runner that can pause its plan."""

    def pause(self) -> None:
        """Stop the robot; the plan can be continued later."""

    def resume(self) -> None:
        """Continue the plan."""


def hold(runner: object) -> None:
    """Pause the runner if it can pause."""
    if isinstance(runner, Pausable):
        runner.pause()


def release(runner: object) -> None:
    """Resume the runner if it can pause."""
    if isinstance(runner, Pausable):
        runner.resume()


def follows_plan(runner: object) -> bool:
    """Return the runner's ``follows_plan``: a plan of the host drives the robot. Default: False."""
    return bool(getattr(runner, "follows_plan", False))
