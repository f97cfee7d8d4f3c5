"""How the ``recovery`` planner drives: along walls, lanes and ways, and what it makes of a stop."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from bridge.coverage.recovery import planner_events
from bridge.coverage.recovery.choice import Choice
from bridge.coverage.recovery.occlusions import MIN_M, OccludedRegion, OccludedRegions
from bridge.coverage.recovery.stretches import SIGHT_M
from bridge.coverage.recovery.watch import CLOSED_M, WatchfulPlanner
from bridge.coverage.recovery.way import BEND_RAD, course, end_speed
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import Drive, FollowWall, Leg, LegResult, Rest, StopReason, Turn

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Step
    from bridge.coverage.recovery.stretches import Start
    from bridge.coverage.recovery.window import Point
    from bridge.motion.observation import Observation

    Found = TypeVar("Found")
    Part = Generator[Leg, Step, LegResult]

_QUARTER = 0.5 * math.pi
_AHEAD_BAND_M = (0.02, 0.075)
_SAME_PLACE_M = 0.15
_REFUSAL_M, _AGAIN = 0.03, 2
_ALONG_M, _WORTH_M2 = 0.4, 0.03
"""Followed at least of what refused the robot twice at one place: round a door's edge, through; for
a wall, or so much new floor: it takes 5 s."""
_WALL_M, _WALL_CELLS = 0.2, 12
"""So many cells (24 cm of wall) known so near to what refused it: a leg leads round itself."""
FLOOR_CELLS = 250
"""New cells (a tenth of a square metre), after which what was in vain may be tried again."""
_MAX_BACK, _CLEAR_M = 5, 0.05
"""From an edge: times that floor is waited for, and the way from there on until it can turn."""
_NO_LEG_M = 0.01
"""A centimetre is no way to go."""
_NO_WAY_M = 0.02
_MAX_STUCK = 8
"""Attempts in a row that each gained less than ``_NO_WAY_M`` along a wall."""
_UNCERTAIN_RAD = math.radians(0.8)
"""Of the heading, from which on a wall is gone to: 2 m of a lane end 3 cm aside."""
_APART_S = 20.0
"""From one run along a wall to the next; twice as long after each that took no doubt away."""
_HELPED = 0.75
"""What is left of the doubt where a run along a wall was of use."""
_REPORTED_RAD = math.radians(0.6)
"""A way that leaves no more doubt of the heading makes the run along the wall needless."""
_SIGHT_M_S, _READ_S = 0.15, 0.15
"""Slow, for more readings; the last of them is on its way when the robot stands."""
_NEAR_M = 0.15
"""Whoever meets something so near to a wall's beginning is there: his place is in doubt, too."""
_TOUCHED = frozenset({StopReason.RANGE, StopReason.BUMPER, StopReason.STALLED})
_MIN_AWAY_RAD = math.radians(12.0)
"""From the wall that is followed, which may be taken for what was met: not any more where it is met
again within ``_SAME_BUMP_M``. So many times as far, then."""
_SAME_BUMP_M = 0.06
_STOPS_S = 0.5
"""From a brisk pace to a standstill before what was met: whoever went so fast was not grazing a
corner, as he may who goes round one."""
_MIN_TURN_RAD = math.radians(2.0)


class DrivingPlanner(WatchfulPlanner):
    """The parts of a plan, each a generator of legs."""

    _recovering: OccludedRegion | None = None
    """The shadow that is gone back for just now."""
    _lane_m = 0.0
    """Length of the last lane."""
    _occlusions: OccludedRegions

    def _stand(self, state: str, target: tuple[float, float] | None = None) -> None:
        """Say where the planner stands, for the log and for whoever looks on."""
        if self._recovering is not None and state in {"transit", "lane"}:
            state = f"recovery-{state}"
        if (state, target) != (self._state.state, self._state.target):
            self._state = replace(self._state, state=state, target=target)

    def _slices(self, search: Generator[None, None, Found]) -> Generator[Leg, Step, Found]:
        while True:
            try:
                next(search)
            except StopIteration as stop:
                found: Found = stop.value
                return found
            self._stand("think")
            yield Rest(0.0, purpose="think")

    def _take_heading(self) -> Generator[Leg, Step, bool]:
        """Go along a known wall where the heading is in doubt; whether the robot set out."""
        obs, starts = self._seen, self._stretches.starts()
        if not starts or obs.heading_sigma_rad < _UNCERTAIN_RAD or obs.time_s < self._sight_due_s:
            return False
        found = yield from self._slices(
            self._chooser.way_to(self.memory, obs.pose, [(s.x_m, s.y_m) for s in starts])
        )
        if found is None:
            self._sight_due_s = self._seen.time_s + _APART_S
            return False
        k, way = found
        start = starts[k]
        self.decide(
            "heading-fix",
            "the heading is in doubt: along a wall that is known",
            x_m=round(start.x_m, 3),
            y_m=round(start.y_m, 3),
            uncertainty_deg=round(math.degrees(obs.heading_sigma_rad), 2),
        )
        there_rad = yield from self._sight(start, way)
        left_rad = self._seen.heading_sigma_rad
        helped = left_rad < _HELPED * obs.heading_sigma_rad
        self._sights_failed = 0 if helped else self._sights_failed + 1
        if there_rad is not None:  # somebody in the way there does not speak against the wall
            useful = left_rad < max(_HELPED * there_rad, _REPORTED_RAD)
            self._stretches.tried(start, helped=useful)
        self._sight_due_s = self._seen.time_s + _APART_S * 2**self._sights_failed
        return True

    def _sight(self, start: Start, way: tuple[Point, ...]) -> Generator[Leg, Step, float | None]:
        """Straight along a wall, not led by it: a noisy infrared leads to and fro.

        With how much doubt of the heading it was begun; None where it was not driven, for the way
        there was barred, or told the heading already.
        """
        arrived = yield from self._travel(Choice("heading-fix", way, start.heading_rad, SIGHT_M))
        there_rad = self._seen.heading_sigma_rad
        if not arrived or there_rad < _REPORTED_RAD:
            return None
        yield from self._turn(start.heading_rad)
        self._stand("heading-fix", way[-1])
        yield from self._drive(
            Drive(
                start.heading_rad,
                SIGHT_M,
                speed_m_s=_SIGHT_M_S,
                stop_range_m=self.options.stop_range_m,
                wary=True,
                purpose="heading-fix",
            )
        )
        yield Rest(_READ_S, purpose="heading-fix")
        return there_rad

    def _first_wall(self, obs: Observation) -> Generator[Leg, Step]:
        near = 0.28
        left, right = obs.infrared_left_m, obs.infrared_right_m
        if right is not None and right < near and (left is None or right <= left):
            yield from self._follow_perimeter(left=False)
            return
        if left is not None and left < near:
            yield from self._follow_perimeter(left=True)
            return
        result = yield from self._drive(
            Drive(
                obs.pose.theta_rad,
                stop_range_m=self.options.stop_range_m,
                wary=True,
                purpose="lane",
            )
        )
        yield from self._meet(result)

    def _lane(self, choice: Choice) -> Generator[Leg, Step, bool]:
        arrived = yield from self._travel(choice)
        if not arrived:
            return False
        yield from self._turn(choice.heading_rad, BEND_RAD)
        self._stand("lane", choice.way[-1])
        result = yield from self._drive(
            Drive(
                choice.heading_rad,
                choice.length_m + 0.5 * self.options.cell_m,
                speed_m_s=self.options.lane_speed_m_s,
                stop_range_m=self.options.stop_range_m,
                wary=True,
                purpose="lane",
            )
        )
        self._lane_done(result, choice.length_m)
        yield from self._meet(result)
        return True

    def _lane_done(self, result: LegResult, planned_m: float) -> None:
        """Keep the paper's variables, and what an obstacle hid of the lane."""
        self._lane_m = max(result.distance_m, 0.0)
        state = self._state
        self._state = replace(
            state, previous_lane_distance_m=state.lane_distance_m, lane_distance_m=self._lane_m
        )
        cut = result.reason.blocked or result.reason is StopReason.CANCELLED
        if cut and planned_m - self._lane_m > MIN_M:
            heading = result.pose.theta_rad
            occlusion = self._occlusions.found(result.pose, heading, planned_m, self._lane_m)
            self.emit(planner_events.occlusion_found(occlusion))

    def _begin_perimeter(self, choice: Choice) -> Generator[Leg, Step, bool]:
        arrived = yield from self._travel(choice)
        if not arrived:
            return False
        wall = choice.heading_rad - _QUARTER
        pose = self._pose
        ahead_left = self._fresh_along(Pose2(pose.x_m, pose.y_m, wall + _QUARTER), -1)
        ahead_right = self._fresh_along(Pose2(pose.x_m, pose.y_m, wall - _QUARTER), 1)
        left = ahead_right > ahead_left + 0.1
        yield from self._turn(wall - _QUARTER if left else wall + _QUARTER)
        yield from self._follow_perimeter(left=left, touching=True)
        return True

    def _travel(self, choice: Choice) -> Generator[Leg, Step, bool]:
        self._stand("transit", choice.way[-1])
        self._sought_from = None
        for k, (x, y) in enumerate(choice.way):
            heading, way = course(self._pose, x, y)
            if way < _NO_LEG_M:
                continue
            yield from self._turn(heading, BEND_RAD)
            heading, way = course(self._pose, x, y)  # it may have rolled on as it turned
            if way < _NO_LEG_M:
                continue
            result = yield from self._drive(
                Drive(
                    heading,
                    way,
                    speed_m_s=self.options.travel_speed_m_s,
                    stop_range_m=self.options.stop_range_m,
                    end_m_s=end_speed(choice, k, heading),
                    wary=True,
                    purpose="transit",
                )
            )
            if result.reason.blocked and way - result.distance_m > 0.03:  # noqa: PLR2004
                self.decide("blocked", f"the way to the {choice.kind} ended early: {result.reason}")
                if choice.kind == "heading-fix":  # its wall stands about here
                    near = math.dist(self._pose[:2], choice.way[-1]) < _NEAR_M
                    return near and result.reason in _TOUCHED
                if not (yield from self._meet(result)):
                    self._on_blocked(result, heading)
                    yield from self._seek_passage(result, choice.new_m2)
                return False
        return True

    def _on_blocked(self, result: LegResult, heading_rad: float) -> None:
        """Shut a passage that refused the robot again, a little wider each time."""
        pose, last = result.pose, self._blocked_at
        again = last is not None and pose.distance_m(last) < _SAME_PLACE_M
        self._refusals = self._refusals + 1 if again else 1
        self._blocked_at = pose
        if self._refusals >= _AGAIN:
            radius_m = min(_REFUSAL_M * self._refusals, self.model.radius_m)
            c, s = math.cos(heading_rad), math.sin(heading_rad)
            way_m = radius_m + self.options.cell_m
            self.memory.block(pose.x_m + way_m * c, pose.y_m + way_m * s, radius_m)
            self.decide(
                "passage-shut",
                "it refused the robot again and again",
                x_m=round(pose.x_m, 3),
                y_m=round(pose.y_m, 3),
                times=self._refusals,
            )

    def _seek_passage(self, result: LegResult, new_m2: float) -> Generator[Leg, Step]:
        """Follow what refused the robot again, as the Bug algorithms do (Lumelsky, Stepanov 1987).

        A wall leads round a door's edge and through, wherever the robot believes the door to be.
        """
        left, right = result.bumper_left, result.bumper_right
        if result.reason is not StopReason.BUMPER or left == right:
            return
        if self._refusals < _AGAIN or new_m2 <= _WORTH_M2:
            return
        pose, floor = result.pose, self.memory.new_cells
        bearing, rim_m = self._contact(result), self.model.radius_m
        met = pose.transform(rim_m * math.cos(bearing), rim_m * math.sin(bearing))
        if self.memory.occupied(*met, _WALL_M) < _WALL_CELLS:
            return
        for before, side, cells in self._sought:
            if (
                side == left
                and before.distance_m(pose) < _SAME_PLACE_M
                and floor - cells < FLOOR_CELLS
            ):
                return
        self._sought.append((pose, left, floor))
        self._sought_from = pose
        self.decide("passage-sought", "along what refused the robot again")
        away = bearing + (-_QUARTER if left else _QUARTER)
        yield from self._turn(pose.theta_rad + away)
        yield from self._follow_perimeter(left=left, touching=True, min_m=_ALONG_M)

    def _turn(self, heading_rad: float, min_rad: float = _MIN_TURN_RAD) -> Generator[Leg, Step]:
        if abs(wrap_angle(heading_rad - self._pose.theta_rad)) > min_rad:
            yield Turn(wrap_angle(heading_rad), flowing=True)

    def _drive(self, leg: Drive) -> Part:
        """Drive; what stops it becomes evidence, and a bump is backed off from."""
        self._looking, self._aside = leg.purpose == "lane", 0
        before = self.memory.new_cells
        step = yield leg
        self._looking = False
        result = step.result
        if leg.purpose == "lane":
            new_m2 = (self.memory.new_cells - before) * self.options.cell_m**2
            self.emit(planner_events.lane_ended(result, new_m2))
        if result.reason is StopReason.CANCELLED:
            self.decide("obstacle", "beside the lane, its outline not yet followed")
            yield from self._follow_perimeter(left=self._aside > 0)
            return result
        yield from self._note(result, leg.heading_rad)
        return result

    def _note(self, result: LegResult, heading_rad: float) -> Generator[Leg, Step]:
        if result.reason is StopReason.RANGE:
            self.memory.add_point(*result.pose.transform(self.model.radius_m + 0.01, 0.0))
            self.emit(planner_events.obstacle_met(result))
        elif result.reason is StopReason.CLIFF:
            self.memory.add_cliff(self._edge_at or result.pose)
            self.emit(planner_events.obstacle_met(result))
            yield from self._leave_edge(heading_rad)
        elif result.reason in {StopReason.BUMPER, StopReason.STALLED}:
            both = not (result.bumper_left or result.bumper_right)
            self.memory.add_bump(
                result.pose, left=result.bumper_left or both, right=result.bumper_right or both
            )
            self.emit(planner_events.obstacle_met(result))
            yield Drive(heading_rad, -self.options.back_off_m, speed_m_s=0.05, purpose="back-off")

    def _leave_edge(self, heading_rad: float) -> Generator[Leg, Step]:
        """Back off until there is floor ahead, and on: turning before, a wheel would go over it.

        Between two spots an edge may be as near as the outer ones look ahead, 9 cm.
        """
        way = Drive(heading_rad, -self.options.cliff_back_off_m, speed_m_s=0.05, purpose="back-off")
        for _ in range(_MAX_BACK):
            yield way
            if not self._seen.cliff:
                yield replace(way, distance_m=-_CLEAR_M)
                return

    def _meet(self, result: LegResult) -> Generator[Leg, Step, bool]:
        """Follow what ended a drive early, if its outline was not swept yet; whether it was not."""
        if not result.reason.blocked or result.reason is StopReason.CLIFF:
            return False  # an edge of the floor is seen by nothing that could follow it
        pose = result.pose
        bearing = self._contact(result)
        left = bearing > 0.0
        towards = Pose2(pose.x_m, pose.y_m, pose.theta_rad + bearing)
        if self.memory.fresh(towards, _AHEAD_BAND_M, (-0.04, 0.04)) < 0.4:  # noqa: PLR2004
            return False
        away = bearing + (-_QUARTER if left else _QUARTER)
        yield from self._turn(pose.theta_rad + away)
        yield from self._follow_perimeter(left=left, touching=True)
        return True

    def _contact(self, result: LegResult, beside: int = 0) -> float:
        """Bearing from the heading of what ended a leg.

        ``beside``: a wall that is followed on the left (1) or right (-1), and is not what was met.
        """
        left, right = result.bumper_left, result.bumper_right
        if result.reason is not StopReason.BUMPER or left == right:
            return 0.0
        return self.memory.contact_rad(result.pose, left=left, right=right, beside=beside)

    def _follow_perimeter(
        self, *, left: bool, touching: bool = False, min_m: float = CLOSED_M
    ) -> Generator[Leg, Step]:
        """Follow a wall until its outline is closed, not before ``min_m``, or lost."""
        self._min_m = min_m
        self._stand("perimeter")
        self.decide("perimeter-begin", f"wall on the {'left' if left else 'right'}")
        stuck = again = 0
        side, cruise_m_s = 1 if left else -1, self.model.cruise_speed_m_s
        self._followed_m = self._checked_m = 0.0
        bumped_m = -math.inf
        while True:
            self._following, self._last_pose, self._stale = side, None, 0
            begun_m, begun_s = self._followed_m, self._seen.time_s
            gap_m, pace_m_s = self.options.perimeter_gap_m, self.options.perimeter_pace * cruise_m_s
            step = yield FollowWall(left, gap_m, touching=touching, speed_m_s=pace_m_s)
            self._stretches.end(self._pose, side)
            self._following = 0
            result = step.result
            reason = result.reason
            stuck = stuck + 1 if self._followed_m - begun_m < _NO_WAY_M else 0
            if not reason.blocked or reason is StopReason.TIMEOUT or stuck > _MAX_STUCK:
                break
            again = again + 1 if self._followed_m - bumped_m < _SAME_BUMP_M else 0
            bumped_m = self._followed_m
            yield from self._note(result, result.pose.theta_rad)
            if reason is StopReason.CLIFF:
                break
            # turn until what was met is abeam; on the other side, it is an inner corner
            ended_s = begun_s + result.duration_s  # it may have rested since
            ahead_of_it = again or ended_s - self._brisk_s < _STOPS_S
            away = side * self._contact(result, beside=side if ahead_of_it else 0)
            away = max(_QUARTER - away, min(_MIN_AWAY_RAD * (1 + again), _QUARTER))
            heading = result.pose.theta_rad - side * away
            ahead = Pose2(self._pose.x_m, self._pose.y_m, heading)
            if (
                self._followed_m > min_m
                and self._fresh_along(ahead, side) < self.options.fresh_share
            ):
                reason = StopReason.CANCELLED
                break
            yield from self._turn(heading)
            touching = True
        self.emit(planner_events.perimeter_ended(reason, self._followed_m))
