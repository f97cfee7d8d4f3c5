"""Heading fix: a drive along a known straight wall if the heading is uncertain."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.coverage.recovery.behaviours.obstacle_following import drive
from bridge.coverage.recovery.behaviours.perimeter import turn
from bridge.coverage.recovery.behaviours.transit import transit
from bridge.coverage.recovery.search import Choice
from bridge.motion.legs import Drive, Dwell

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.coverage.recovery.wall_segments import Start
    from bridge.coverage.recovery.window import Point
    from bridge.motion.legs import Leg


class HeadingFix:
    """Decides when and where to fix the heading."""

    def __init__(self) -> None:
        """Allow the first fix immediately."""
        self.due_s = -math.inf
        """Earliest time of the next fix, s."""
        self._failed = 0
        """Number of fixes in a row without effect."""

    def take(self, context: RecoveryContext) -> Generator[Leg, Step, bool]:
        """Fix an uncertain heading at a known wall nearby. Return True if a fix was attempted."""
        obs, starts = context.obs, context.wall_segments.starts()
        apart_s = context.options.heading_fix_apart_s
        if (
            not starts
            or obs.heading_sigma_rad < context.options.fix_uncertain_rad
            or obs.time_s < self.due_s
        ):
            return False
        points = [(start.x_m, start.y_m) for start in starts]
        found = yield from context.in_slices(
            context.chooser.path_to(context.evidence_map, obs.pose, points)
        )
        if found is None:
            self.due_s = context.obs.time_s + apart_s
            return False
        k, path = found
        start = starts[k]
        context.record.decide(
            "heading-fix",
            "heading uncertain: drive along a known wall",
            x_m=round(start.x_m, 3),
            y_m=round(start.y_m, 3),
            uncertainty_deg=round(math.degrees(obs.heading_sigma_rad), 2),
        )
        begun_rad = yield from self.drive_along(context, start, path)
        left_rad = context.obs.heading_sigma_rad
        helped = left_rad < context.options.fix_helped * obs.heading_sigma_rad
        self._failed = 0 if helped else self._failed + 1
        if begun_rad is not None:  # a blocked transit does not mean that the wall is unsuitable
            useful = left_rad < max(
                context.options.fix_helped * begun_rad, context.options.fix_enough_rad
            )
            context.wall_segments.tried(start, helped=useful)
        self.due_s = context.obs.time_s + apart_s * 2**self._failed
        return True

    def drive_along(
        self, context: RecoveryContext, start: Start, path: tuple[Point, ...]
    ) -> Generator[Leg, Step, float | None]:
        """Drive straight along a wall. The noisy infrared measures the heading but does not steer.

        Returns:
            Heading standard deviation at the beginning of the drive, rad. None: the robot did not
            drive along the wall, because the transit was blocked or already fixed the heading.

        """
        choice = Choice("heading-fix", path, start.heading_rad, context.options.fix_run_m)
        arrived = yield from transit(context, choice)
        begun_rad = context.obs.heading_sigma_rad
        if not arrived or begun_rad < context.options.fix_enough_rad:
            return None
        yield from turn(context, start.heading_rad)
        context.enter("heading-fix", path[-1])
        leg = Drive(
            start.heading_rad,
            context.options.fix_run_m,
            speed_m_s=context.options.fix_run_m_s,
            stop_range_m=context.geometry.stop_range_m,
            wary=True,
            purpose="heading-fix",
        )
        yield from drive(context, leg)
        yield Dwell(context.options.fix_read_s, purpose="heading-fix")
        return begun_rad
