"""What a fruitless trip speaks against: the place that was gone for, or a passage on the way."""

from __future__ import annotations

import pytest

from bridge.coverage.recovery.choice import Choice
from bridge.coverage.recovery.evidence import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.motion.geometry import Pose2
from bridge.motion.observation import Observation
from bridge.motion.robot_model import RobotModel

MODEL = RobotModel()
PLACE = (1.5, 0.0)


class Judge(RecoveryPlanner):
    """Stands somewhere, and judges."""

    def __init__(self, x_m: float) -> None:
        super().__init__(MODEL)
        pose = Pose2(x_m, 0.0, 0.0)
        self._memory = EvidenceMap(MODEL, RecoveryOptions(), pose)
        self._obs = Observation(*(0.0, pose, 0.0, 0.0, None, None, None), *[False] * 3)

    def blames(self, *, arrived: bool, futile: int = 0, new_cells: int = 0) -> bool:
        """Whether the place that was gone for has one try less."""
        choice = Choice("lane", (PLACE,), 0.0, 0.5, new_m2=0.06)
        self._judge(choice, new_cells, futile, arrived=arrived)
        column, row = self.memory.to_cells(*PLACE)
        told = [event.kind for event in self.drain_events()] == ["set-aside"]
        assert told == bool(self.memory.tried[int(row), int(column)])
        return told


@pytest.mark.parametrize(("x_m", "blamed"), [(0.0, False), (1.0, False), (1.2, True), (1.5, True)])
def test_what_refused_the_robot_far_off_is_no_fault_of_the_place(
    x_m: float, *, blamed: bool
) -> None:
    assert Judge(x_m).blames(arrived=False) is blamed


def test_a_place_that_gave_nothing_is_blamed_wherever_the_robot_ended() -> None:
    assert Judge(0.0).blames(arrived=True)
    assert not Judge(0.0).blames(arrived=True, new_cells=100)


def test_it_is_spared_eight_times_in_a_row_so_that_the_plan_comes_to_an_end() -> None:
    assert [Judge(0.0).blames(arrived=False, futile=n) for n in (0, 7, 8, 19)] == [
        False,
        False,
        True,
        True,
    ]
