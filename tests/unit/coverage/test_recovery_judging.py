"""What a fruitless trip speaks against: the place that was gone for, or a passage on the way."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import pytest

from bridge.coverage.recovery.choice import Choice
from bridge.coverage.recovery.evidence import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, LegResult, StopReason
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Scalar, Step
    from bridge.motion.legs import Leg
    from bridge.motion.observation import Observation

MODEL = RobotModel()
PLACE = (1.5, 0.0)


class Judge(RecoveryPlanner):
    """Stands somewhere, and judges."""

    def __init__(self, x_m: float) -> None:
        super().__init__(MODEL)
        pose = Pose2(x_m, 0.0, 0.0)
        self._memory = EvidenceMap(MODEL, RecoveryOptions(), pose)
        self._obs = AT_REST._replace(pose=pose)

    def blames(self, *, arrived: bool, fruitless: int = 0, new_cells: int = 0) -> bool:
        """Whether the place that was gone for has one try less."""
        choice = Choice("lane", (PLACE,), 0.0, 0.5, new_m2=0.06)
        self._judge(choice, new_cells, fruitless, arrived=arrived)
        column, row = self.memory.to_cells(*PLACE)
        reported = [event.kind for event in self.drain_events()] == ["abandon"]
        assert reported == bool(self.memory.tried[int(row), int(column)])
        return reported


@pytest.mark.parametrize(("x_m", "blamed"), [(0.0, False), (1.0, False), (1.2, True), (1.5, True)])
def test_a_block_far_off_does_not_count_against_the_target(x_m: float, *, blamed: bool) -> None:
    assert Judge(x_m).blames(arrived=False) is blamed


def test_a_place_that_gave_nothing_is_blamed_wherever_the_robot_ended() -> None:
    assert Judge(0.0).blames(arrived=True)
    assert not Judge(0.0).blames(arrived=True, new_cells=100)


def test_it_is_spared_eight_times_in_a_row_so_that_the_plan_comes_to_an_end() -> None:
    assert [Judge(0.0).blames(arrived=False, fruitless=n) for n in (0, 7, 8, 19)] == [
        False,
        False,
        True,
        True,
    ]


class Blocked(RecoveryPlanner):
    """Goes for a far place again and again, and is bumped at one place on the way each time."""

    def __init__(self, floor: int = 0) -> None:
        """``floor``: new cells by each attempt's way."""
        super().__init__(MODEL)
        self.floor = floor
        self.tries = 0
        self.uncertain_m: set[Scalar | None] = set()
        """Where evidence was doubted."""
        self.why: set[str] = set()
        """... and why, before the colon."""

    def _first_wall(self, obs: Observation) -> Generator[Leg, Step]:  # noqa: ARG002 - none is near
        yield from ()

    def _think(self) -> Generator[Leg, Step, Choice | None]:
        yield from ()
        return Choice("lane", (PLACE,), 0.0, 0.5, new_m2=0.06)

    def _lane(self, choice: Choice) -> Generator[Leg, Step, bool]:
        yield from ()
        self.tries += 1
        self.memory.new_cells += self.floor
        leg = Drive(choice.heading_rad, 1.0)
        self._on_blocked(LegResult(leg, StopReason.BUMPER, 0.1, 1.0, Pose2(0.1, 0.0, 0.0)), 0.0)
        return False

    def run(self, maximum: int) -> tuple[str | None, Counter[str]]:
        """Why it ended, if it did in so many attempts; and what was decided how often."""
        here = AT_REST
        self.options = RecoveryOptions(max_decisions=maximum)
        end: str | None = None
        script = self.script(here)
        try:
            next(script)
        except StopIteration as stop:
            end = stop.value
        events = self.drain_events()
        self.uncertain_m = {e.data.get("x_m") for e in events if e.kind == "clear"}
        self.why = {e.reason.split(":")[0] for e in events if e.kind == "clear"}
        return end, Counter(event.kind for event in events)


def test_a_place_that_blocks_seven_times_is_cleared_before_the_target_is_abandoned() -> None:
    planner = Blocked()
    _, reported = planner.run(21)
    assert reported["clear"] == 2
    assert planner.uncertain_m == {0.1}  # where it was refused
    assert reported["abandon"] == 0
    planner = Blocked()
    _, reported = planner.run(24)
    assert planner.tries == 3 * 7
    assert reported["clear"] == 3


def test_when_nothing_is_left_to_forget_the_far_place_is_blamed_and_then_it_ends() -> None:
    planner = Blocked()
    end, reported = planner.run(100)
    assert end == "shut in: nothing that was tried led anywhere"
    assert reported["clear"] == 3
    assert planner.tries == 3 * 7 + 20
    assert reported["abandon"] == 20 - 8


def test_abandoned_targets_do_not_count_after_new_floor() -> None:
    end, reported = Blocked(floor=100).run(100)
    assert end is not None
    assert end.startswith("100 decisions")
    assert reported["clear"] > 3


class AmongLegs(Blocked):
    """A leg is known beside where it is refused, and another farther off."""

    LEGS = ((0.1, 0.25), (0.1, 0.55))

    def _first_wall(self, obs: Observation) -> Generator[Leg, Step]:  # noqa: ARG002 - none is near
        for leg in self.LEGS:
            self.memory.add_point(*leg)
        yield from ()

    def known(self) -> list[int]:
        """Cells of each leg that are still occupied."""
        return [self.memory.occupied(*leg, 0.03) for leg in self.LEGS]

    def shut(self) -> bool:
        """Whether any place is still forbidden because the robot was refused."""
        return bool(self.memory.lens.any())


class Fruitless(AmongLegs):
    """Nothing refuses it, and nothing comes of anything."""

    def _lane(self, choice: Choice) -> Generator[Leg, Step, bool]:  # noqa: ARG002 - any
        yield from ()
        return False


def test_after_one_block_only_evidence_near_it_is_cleared() -> None:
    planner = AmongLegs()
    _, reported = planner.run(7)
    assert (reported["clear"], planner.known(), planner.shut()) == (0, [1, 1], True)
    _, reported = planner.run(8)
    assert (reported["clear"], planner.known(), planner.shut()) == (1, [0, 1], False)
    assert planner.why == {"it refuses the robot"}
    shut_in = Fruitless()
    _, reported = shut_in.run(21)
    assert (reported["clear"], shut_in.known()) == (1, [0, 0])
    assert shut_in.why == {"nothing leads anywhere"}


class Wavering(Blocked):
    """Nothing comes of twenty lanes; then nothing is worth it, then something is."""

    def _first_wall(self, obs: Observation) -> Generator[Leg, Step]:
        self.memory.add_bump(obs.pose, left=True, right=True)
        yield from ()

    def _think(self) -> Generator[Leg, Step, Choice | None]:
        self.thoughts = getattr(self, "thoughts", 0) + 1
        choice = yield from super()._think()
        return None if self.thoughts == 21 else choice

    def _lane(self, choice: Choice) -> Generator[Leg, Step, bool]:  # noqa: ARG002 - any
        yield from ()
        self.tries += 1
        return False


def test_what_is_found_after_bumps_were_cleared_is_tried() -> None:
    planner = Wavering()
    _, reported = planner.run(23)
    assert reported["clear"] == 1
    assert planner.tries == 22
