"""The ``recovery`` planner: outlines along the walls, lanes between, back for what was hidden.

The paper's idea kept: remember, cheaply, what an obstacle hid, and go back for it. Its one slot
becomes a map of evidence. A wall that is met is followed until its outline is closed, which
sweeps the band that only an outline can sweep and draws the map; then, again and again, the
lane or outline that sweeps most per time is taken, until nothing is worth its time.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.coverage.recovery import planner_events
from bridge.coverage.recovery.driving import FLOOR_CELLS, DrivingPlanner
from bridge.coverage.recovery.evidence import EvidenceMap
from bridge.coverage.recovery.occlusions import OccludedRegions
from bridge.motion.geometry import Pose2

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Script, Step
    from bridge.coverage.recovery.choice import Choice
    from bridge.motion.legs import Leg
    from bridge.motion.observation import Observation

_FUTILE = 20
"""Decisions in a row that gained nothing, after which the evidence itself is doubted."""
_MAX_BLOCKED = 6
"""Refusals at one place, likewise."""
_SPARED = 8
"""Up to so many of them in a row, a place is not blamed for a passage so far from it that refused
the robot."""
_FAR_M = 0.4
_MAX_CLEARED = 3
_CLEAR_RADIUS_M, _BLOCKED_M = 0.6, 0.3
"""Things are forgotten so far off where nothing leads anywhere, and where one place refused the
robot: what is farther off does not bar it there, and legs that are forgotten are bumped again."""
_UNCERTAIN_M = 0.2


class RecoveryPlanner(DrivingPlanner):
    """See the module."""

    _cleared_at = -FLOOR_CELLS
    """New cells when bumps were doubted last."""

    # -- the plan ------------------------------------------------------------------------------

    def script(self, obs: Observation) -> Script:
        """The plan from the pose in ``obs``."""
        self._reset()
        self._recovering = None
        self._cleared_at = -FLOOR_CELLS
        self._obs = obs
        self._memory = EvidenceMap(self.model, self.options, obs.pose)
        memory = self._memory
        self._occlusions = OccludedRegions(self.model.cleaning_width_m)
        self._stand("approach")
        self.decide("start", "looking for a wall to follow")
        yield from self._first_wall(obs)
        fruitless = cleared = cleared_at = 0
        for _ in range(self.options.max_decisions):
            choice = yield from self._think()
            if choice is None and self._think_again():
                fruitless = 0
                continue
            stuck = fruitless >= _FUTILE or self._chooser.shut_in
            if stuck or self._refusals > _MAX_BLOCKED:
                radius_m = _CLEAR_RADIUS_M if stuck else _BLOCKED_M
                at, self._refusals = self._uncertain_place(), 0
                if memory.new_cells - cleared_at > FLOOR_CELLS:
                    cleared = 0
                if cleared < _MAX_CLEARED:
                    memory.forget(at, radius_m, _CLEAR_RADIUS_M)
                    self.decide(
                        "clear",
                        f"{'nothing leads anywhere' if stuck else 'it refuses the robot'}: "
                        "what is known there is doubted",
                        x_m=round(at.x_m, 3),
                        y_m=round(at.y_m, 3),
                    )
                    fruitless, cleared, cleared_at = 0, cleared + 1, memory.new_cells
                    continue
                if stuck:
                    return self._end("shut in: nothing that was tried led anywhere")
            if choice is None:
                return self._end("no reachable unswept piece is worth its time")
            if (yield from self._take_heading()):
                continue
            before = memory.new_cells
            self.emit(planner_events.chosen(choice))
            part = self._lane if choice.kind == "lane" else self._begin_perimeter
            self._go_back(choice)
            arrived = yield from part(choice)
            gained = memory.new_cells - before
            self._come_back(choice, gained, arrived=arrived)
            self._judge(choice, gained, fruitless, arrived=arrived)
            fruitless = fruitless + 1 if gained < self.options.min_cells else 0
        return self._end(f"{self.options.max_decisions} decisions, the limit")

    def _uncertain_place(self) -> Pose2:
        """Where the evidence is to blame: what parts or refuses the robot; else, where it is."""
        if self._chooser.parted_at is not None:
            return Pose2(*self._chooser.parted_at, 0.0)
        if self._refusals > _MAX_BLOCKED and self._blocked_at is not None:
            return self._blocked_at
        return self._pose

    def _think_again(self) -> bool:
        """Before the end, doubt what only bumps tell; whether there was anything new to doubt."""
        if self.memory.new_cells - self._cleared_at < FLOOR_CELLS:
            return False
        self._cleared_at = self.memory.new_cells
        if not self.memory.clear_bumps(_UNCERTAIN_M):
            return False
        self._refusals = 0
        self.decide("clear", "before the end: what only bumps tell is doubted")
        return True

    def _end(self, reason: str) -> str:
        self._stand("finished")
        area_m2 = self.options.cell_m**2
        self.end_figures = {
            "swept_m2": round(self.memory.new_cells * area_m2, 2),
            "left_cm2": round(self._chooser.left_m2 * 1e4),
            "shadows_open": len(self._occlusions.open),
        }
        return reason

    def _go_back(self, choice: Choice) -> None:
        """Tell where a choice goes back for what an obstacle hid."""
        begin = Pose2(*choice.way[-1], choice.heading_rad)
        self._recovering = None
        if choice.kind == "lane":
            self._recovering = self._occlusions.met(begin, choice.length_m)
        if self._recovering is not None:
            self.emit(planner_events.recovery_begun(self._recovering))

    def _come_back(self, choice: Choice, new_cells: int, *, arrived: bool) -> None:
        occlusion, self._recovering = self._recovering, None
        if occlusion is None:
            return
        begin = Pose2(*choice.way[-1], choice.heading_rad)
        closed = arrived and self._occlusions.swept(occlusion, begin, self._lane_m)
        new_m2 = new_cells * self.options.cell_m**2
        self.emit(planner_events.recovery_ended(occlusion, new_m2, arrived=arrived, closed=closed))

    def _judge(self, choice: Choice, new_cells: int, fruitless: int, *, arrived: bool) -> None:
        """Set a place aside that gave next to nothing, after so many decisions that gave nothing.

        What refused the robot far from there is a passage, and is shut in time (``_on_blocked``):
        there may be another way.
        """
        promised = choice.new_m2 / self.options.cell_m**2
        if choice.kind == "perimeter":
            promised = 40.0
        if new_cells > 0.3 * promised:
            return
        x, y = choice.way[-1]
        at = self._sought_from or self._pose
        far = math.dist(at[:2], (x, y)) > _FAR_M
        if far and not arrived and fruitless < _SPARED:
            return
        c, s = math.cos(choice.heading_rad), math.sin(choice.heading_rad)
        done_m = 0.0
        if arrived:
            # only the part that was driven: what lies beyond an obstacle may be had otherwise
            pose = self._pose
            done_m = min(max((pose.x_m - x) * c + (pose.y_m - y) * s, 0.0), choice.length_m)
        way_m = 0.0
        while way_m <= done_m:
            self.memory.give_up(x + way_m * c, y + way_m * s, 0.5 * self.model.cleaning_width_m)
            way_m += self.model.cleaning_width_m
        reason = "the place gave next to nothing" if arrived else "no way to it was found"
        self.decide("abandon", reason, x_m=round(x, 3), y_m=round(y, 3))

    def _think(self) -> Generator[Leg, Step, Choice | None]:
        """Choose what to do next; on a large floor over some control steps, standing."""
        search = self._chooser.search(self.memory, self._pose, self.grid_rad)
        return (yield from self._slices(search))
