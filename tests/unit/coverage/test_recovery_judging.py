"""Evidence from a fruitless trip: it counts against the target or against the path to it."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.coverage.planner import Finish
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import Behaviours, RecoveryPlanner
from bridge.coverage.recovery.search import Choice
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, LegResult, StopReason
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST
from support.recovery import context_at, kinds

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Scalar, Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.motion.legs import Leg

MODEL = RobotModel()
PLACE = (1.5, 0.0)


def fruitless(context: RecoveryContext, count: int) -> None:
    """Let consecutive perimeter passes each sweep slightly too little."""
    for _ in range(count):
        choice = Choice("perimeter", (PLACE,), 0.0, 0.5)
        context.stuck.take(choice, 6, Pose2(*PLACE, 0.0), arrived=False)
    for row, column in np.argwhere(context.evidence_map.attempts).tolist():
        context.evidence_map.attempts[row, column] = 0
    context.record.drain()


def blames(x_m: float, *, arrived: bool, fruitless_before: int = 0, new_cells: int = 0) -> bool:
    """Return whether the target loses a try after an attempt that ended at ``x_m``."""
    pose = Pose2(x_m, 0.0, 0.0)
    context = context_at(AT_REST._replace(pose=pose))
    fruitless(context, fruitless_before)
    choice = Choice("lane", (PLACE,), 0.0, 0.5, new_m2=0.06)
    context.stuck.take(choice, new_cells, pose, arrived=arrived)
    column, row = context.evidence_map.to_cells(*PLACE)
    reported = kinds(context) == ["abandon"]
    assert reported == bool(context.evidence_map.attempts[int(row), int(column)])
    return reported


@pytest.mark.parametrize(("x_m", "blamed"), [(0.0, False), (1.0, False), (1.2, True), (1.5, True)])
def test_a_block_far_off_does_not_count_against_the_target(x_m: float, *, blamed: bool) -> None:
    assert blames(x_m, arrived=False) is blamed


def test_a_fruitless_target_is_marked_wherever_the_robot_ended() -> None:
    assert blames(0.0, arrived=True)
    assert not blames(0.0, arrived=True, new_cells=100)


def test_a_target_is_spared_at_most_eight_times_so_that_the_plan_ends() -> None:
    assert [blames(0.0, arrived=False, fruitless_before=n) for n in (0, 7, 8, 19)] == [
        False,
        False,
        True,
        True,
    ]


class Blocked:
    """Drives to a far target repeatedly; each time a bump at the same position blocks the path."""

    def __init__(self, floor: int = 0) -> None:
        """Set ``floor``, the number of new cells in each attempt."""
        self.floor = floor
        self.tries = 0
        self.uncertain_m: set[Scalar | None] = set()
        """Positions (x) at which evidence was cleared, m."""
        self.why: set[str] = set()
        """Reasons of the clearings: the text before the colon."""

    def approach(self, context: RecoveryContext) -> Generator[Leg, Step]:
        """Do nothing, because there is no wall near."""
        self.context = context
        yield from ()

    def choose(self, context: RecoveryContext) -> Generator[Leg, Step, Choice | None]:
        """Always choose the same lane."""
        del context
        yield from ()
        return Choice("lane", (PLACE,), 0.0, 0.5, new_m2=0.06)

    def lane(self, context: RecoveryContext, choice: Choice) -> Generator[Leg, Step, bool]:
        """Report a lane that the robot does not reach."""
        yield from ()
        self.tries += 1
        context.evidence_map.new_cells += self.floor
        leg = Drive(choice.heading_rad, 1.0)
        bumped = LegResult(leg, StopReason.BUMPER, 0.1, 1.0, Pose2(0.1, 0.0, 0.0))
        context.stuck.blocked(bumped, 0.0)
        return False

    def run(self, maximum: int) -> tuple[str, Counter[str]]:
        """Return the reason of the end after at most ``maximum`` attempts, and decision counts."""
        behaviours = Behaviours(self.approach, self.choose, self.lane)
        planner = RecoveryPlanner(MODEL, RecoveryOptions(max_decisions=maximum), behaviours)
        end = planner.start(AT_REST)
        assert isinstance(end, Finish)
        *events, _ = planner.drain_events()
        self.uncertain_m = {e.data.get("x_m") for e in events if e.kind == "clear"}
        self.why = {e.reason.split(":")[0] for e in events if e.kind == "clear"}
        return end.reason, Counter(event.kind for event in events)


def test_a_place_that_blocks_seven_times_is_cleared_before_the_target_is_abandoned() -> None:
    planner = Blocked()
    _, reported = planner.run(21)
    assert reported["clear"] == 2
    assert planner.uncertain_m == {0.1}  # the position of the bumps
    assert reported["abandon"] == 0
    planner = Blocked()
    _, reported = planner.run(24)
    assert planner.tries == 3 * 7
    assert reported["clear"] == 3


def test_without_evidence_to_clear_the_target_is_abandoned_and_then_it_ends() -> None:
    planner = Blocked()
    end, reported = planner.run(100)
    assert end == "enclosed: no target is reachable"
    assert reported["clear"] == 3
    assert planner.tries == 3 * 7 + 20
    assert reported["abandon"] == 20 - 8


def test_abandoned_targets_do_not_count_after_new_floor() -> None:
    end, reported = Blocked(floor=100).run(100)
    assert end is not None
    assert end.startswith("100 decisions")
    assert reported["clear"] > 3


class AmongLegs(Blocked):
    """Adds a known furniture leg near the blocked position, and one farther away."""

    LEGS = ((0.1, 0.25), (0.1, 0.55))

    def approach(self, context: RecoveryContext) -> Generator[Leg, Step]:
        """Enter both legs into the map."""
        for leg in self.LEGS:
            context.evidence_map.add_point(*leg)
        return super().approach(context)

    def known(self) -> list[int]:
        """Return the cells of each leg that are still occupied."""
        return [self.context.evidence_map.count_occupied(*leg, 0.03) for leg in self.LEGS]

    def shut(self) -> bool:
        """Return whether any place is still forbidden because the robot was blocked."""
        return bool(self.context.evidence_map.blocked.any())


class Fruitless(AmongLegs):
    """Nothing blocks it, and no attempt has a result."""

    def lane(self, context: RecoveryContext, choice: Choice) -> Generator[Leg, Step, bool]:
        """Do not arrive."""
        del context, choice
        yield from ()
        return False


def test_after_one_block_only_evidence_near_it_is_cleared() -> None:
    planner = AmongLegs()
    _, reported = planner.run(7)
    assert (reported["clear"], planner.known(), planner.shut()) == (0, [1, 1], True)
    _, reported = planner.run(8)
    assert (reported["clear"], planner.known(), planner.shut()) == (1, [0, 1], False)
    assert planner.why == {"blocked repeatedly at one place"}
    enclosed = Fruitless()
    _, reported = enclosed.run(21)
    assert (reported["clear"], enclosed.known()) == (1, [0, 0])
    assert enclosed.why == {"no target is reachable"}


class Wavering(Blocked):
    """Twenty lanes without a result; then nothing is worth it, then something is."""

    thoughts = 0

    def approach(self, context: RecoveryContext) -> Generator[Leg, Step]:
        """Bump into an obstacle at once."""
        context.evidence_map.add_bump(context.pose, left=True, right=True)
        return super().approach(context)

    def choose(self, context: RecoveryContext) -> Generator[Leg, Step, Choice | None]:
        """Choose nothing at the 21st time."""
        self.thoughts += 1
        choice = yield from super().choose(context)
        return None if self.thoughts == 21 else choice

    def lane(self, context: RecoveryContext, choice: Choice) -> Generator[Leg, Step, bool]:
        """Do not arrive."""
        del context, choice
        yield from ()
        self.tries += 1
        return False


def test_a_target_found_after_clearing_bumps_is_tried() -> None:
    planner = Wavering()
    _, reported = planner.run(23)
    assert reported["clear"] == 1
    assert planner.tries == 22
