"""Checks that the estimate of a planned run fits the real robot, with or without supervision.

The checks find three errors that neither planner nor estimator can find: wheels that spin, a robot
that was moved, and a wrong start pose. The first two end the run. A wrong start pose is only
reported, once: the estimate is still correct relative to the real start.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.errors import ExitStatus
from bridge.run.displaced_start import RoomCheck
from bridge.run.ending import Ending
from bridge.run.spinning import SpinCheck
from protocol.messages.values import StopCause

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel
    from bridge.run.displaced_start import RoomFit
    from bridge.run.localisation import Localisation
    from bridge.supervise import RuleInputs

PERIOD_NS = 60_000_000
"""Period of the wheel check, ns: three control steps."""
ROOM_PERIOD_NS = 2_000_000_000
"""Period of the comparison with the room, ns."""


_MOVED = "the robot was moved, and its position is unknown: {}; put it at its start and begin again"


class FailedCheck(NamedTuple):
    """Result of a check that failed."""

    text: str
    ends: bool = False
    """True if the run must end."""
    displaced: bool = False
    """True if the robot was moved by hand during the run. Its last poses are then uncertain."""

    @property
    def ending(self) -> Ending:
        """Return the end of the run."""
        return Ending("stopped", self.text, ExitStatus.STOPPED, StopCause.SUPERVISE)


class Plausibility:
    """The checks of one run."""

    def __init__(self, model: RobotModel, plan: FloorPlan | None) -> None:
        """Check a run in the room ``plan``; None: the room is unknown."""
        self._spin = SpinCheck(model)
        self.plan = plan
        """The room; None: it is unknown."""
        self._room = None if plan is None else RoomCheck(plan)
        self._next_ns = self._room_ns = 0
        self._fitted = False
        """True once the walls have fitted the room."""
        self.fit: RoomFit | None = None
        """Last comparison in which the walls did not fit the room; None: they fit, or there was no
        comparison."""
        self.displaced = False
        """True if the robot was moved during the run."""

    @property
    def placed(self) -> bool:
        """True if no check shows that the run's poses are wrong in the room."""
        return self.fit is None and not self.displaced

    def restart(self) -> None:
        """Discard the measurements from before a pause."""
        self._spin.restart()

    def due(self, now_ns: int) -> bool:
        """True if :meth:`step` is due."""
        return now_ns >= self._next_ns

    def step(
        self, inputs: RuleInputs, localisation: Localisation, now_ns: int
    ) -> FailedCheck | None:
        """Check the run; return a failed check, or None. A wrong start is returned once."""
        self._next_ns = now_ns + PERIOD_NS
        if localisation.displaced:
            self.displaced = True
            return FailedCheck(
                _MOVED.format("there are walls where it has driven"), ends=True, displaced=True
            )
        spinning = self._spin.step(inputs, stands=localisation.estimator.stands)
        if spinning is not None:
            return FailedCheck(spinning, ends=True)
        if self._room is not None and self.plan is not None and now_ns >= self._room_ns:
            self._room_ns = now_ns + ROOM_PERIOD_NS
            return self._compare(localisation, self._room, self.plan)
        return None

    def _compare(
        self, localisation: Localisation, room: RoomCheck, plan: FloorPlan
    ) -> FailedCheck | None:
        """Compare the walls with the room."""
        known = self._fitted or self.fit is not None
        fit = room.fit(localisation.measured_walls(), seek=not known)
        if fit is None:
            return None
        if fit.share >= room.tuning.fits:
            self._fitted, self.fit = True, None
            return None
        text = f"{100.0 * fit.share:.0f} % of the walls match {plan.name}"
        if self._fitted and fit.share < room.tuning.moved_fits:
            self.displaced = True
            return FailedCheck(_MOVED.format(f"now {text}"), ends=True, displaced=True)
        if known:
            return None
        self.fit = fit
        where = "this is another room, or the robot did not start at the room's start"
        if fit.start is not None:
            off_m, off_rad = fit.off(plan.start)
            where = (
                f"the robot started {off_m:.2f} m away from the room's start, turned by "
                f"{math.degrees(off_rad):.0f}°"
            )
        return FailedCheck(f"{text}: {where}; map and coverage do not fit the room")
