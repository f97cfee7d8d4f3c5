"""Checks of every planned run that its estimate is about the real robot, supervised or not.

They find what neither planner nor estimator can: wheels that spin, a robot that was moved, and a
start that is not that of the room file. The first two end the run; the last one is reported once,
because the run itself is right, only its place in the room is not.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.run.ending import Ending
from bridge.run.room_check import RoomCheck
from bridge.run.spinning import SpinCheck
from protocol.messages.values import StopCause

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel
    from bridge.run.localisation import Localisation
    from bridge.run.room_check import RoomFit
    from bridge.supervise import RuleInputs

PERIOD_NS = 60_000_000
"""Period of the check of the wheels, ns: three control steps."""
ROOM_PERIOD_NS = 2_000_000_000
"""Period of the comparison with the room, ns."""


_MOVED = "the robot was moved, and its position is unknown: {}; put it at its start and begin again"


class Finding(NamedTuple):
    """What a check found."""

    text: str
    ends: bool = False
    """Whether it ends the run."""
    displaced: bool = False
    """Whether the robot was moved during the run, so that its last poses are uncertain."""

    @property
    def ending(self) -> Ending:
        """The end of the run."""
        return Ending("stopped", self.text, 5, StopCause.SUPERVISE)


class Plausibility:
    """The checks of one run."""

    def __init__(self, model: RobotModel, plan: FloorPlan | None) -> None:
        """Check a run in a room; None: the room is unknown."""
        self._spin = SpinCheck(model)
        self.plan = plan
        """The room; None: it is unknown."""
        self._room = None if plan is None else RoomCheck(plan)
        self._next_ns = self._room_ns = 0
        self._fitted = False
        """Whether the walls have fitted the room at some time."""
        self.fit: RoomFit | None = None
        """Comparison of the walls with the room from which they were found not to fit; None: they
        fit, or nothing is known."""
        self.displaced = False
        """Whether the robot was moved during the run."""

    @property
    def placed(self) -> bool:
        """Whether the run's poses are poses in the room, as far as is known."""
        return self.fit is None and not self.displaced

    def restart(self) -> None:
        """Discard what was measured before a pause."""
        self._spin.restart()

    def due(self, now_ns: int) -> bool:
        """Whether :meth:`step` has something to do."""
        return now_ns >= self._next_ns

    def step(self, inputs: RuleInputs, localisation: Localisation, now_ns: int) -> Finding | None:
        """Check the run; return what is wrong, once."""
        self._next_ns = now_ns + PERIOD_NS
        if localisation.displaced:
            self.displaced = True
            return Finding(
                _MOVED.format("walls are where it has driven"), ends=True, displaced=True
            )
        spinning = self._spin.step(inputs, stands=localisation.estimator.stands)
        if spinning is not None:
            return Finding(spinning, ends=True)
        if self._room is not None and self.plan is not None and now_ns >= self._room_ns:
            self._room_ns = now_ns + ROOM_PERIOD_NS
            return self._compare(localisation, self._room, self.plan)
        return None

    def _compare(
        self, localisation: Localisation, room: RoomCheck, plan: FloorPlan
    ) -> Finding | None:
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
            return Finding(_MOVED.format(f"now {text}"), ends=True, displaced=True)
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
        return Finding(f"{text}: {where}; map and coverage do not fit the room")
