"""A planner of one's own that is none: it fails before anything moves, and says what it lacks."""

from __future__ import annotations

from typing import Any

import pytest

from bridge.coverage.planner import Finish, PlannerError, PlannerState
from bridge.coverage.runner import PlanRunner
from bridge.motion.robot_model import RobotModel
from tools.virtual.settings import Settings
from tools.virtual.sweeper import SimulatedSweeper

MODEL = RobotModel()


class Whole:
    """Everything that a planner needs, and an end at once."""

    state = PlannerState()

    def start(self, obs: object) -> Finish:  # noqa: ARG002 - of every planner
        return Finish("nothing to do")

    def next(self, result: object, obs: object) -> Finish:  # noqa: ARG002 - of every planner
        return Finish("nothing to do")

    def drain_events(self) -> list[Any]:
        return []


def without(name: str) -> object:
    members = {key: value for key, value in vars(Whole).items() if not key.startswith("_")}
    del members[name]
    return type("Mine", (), members)()


@pytest.mark.parametrize("name", ["start", "next", "drain_events", "state"])
def test_what_is_missing_is_named(name: str) -> None:
    with pytest.raises(PlannerError, match=rf"Mine is no planner: it lacks {name}"):
        PlanRunner(without(name), MODEL)  # type: ignore[arg-type]  # it is none


def test_everything_that_is_missing_is_named_at_once() -> None:
    with pytest.raises(PlannerError, match=r"object is no planner: it lacks start\(\), next\(\), "):
        PlanRunner(object(), MODEL)  # type: ignore[arg-type]  # it is none


def test_a_class_in_place_of_a_planner_is_named() -> None:
    with pytest.raises(PlannerError, match="Whole is a class"):
        PlanRunner(Whole, MODEL)  # type: ignore[arg-type]  # it is none


@pytest.mark.parametrize(
    ("members", "lacks"),
    [
        ({"watch": lambda _self, _obs: False}, "lacks most_m_s"),
        ({"most_m_s": 0.2}, r"lacks watch\(\)"),
    ],
)
def test_half_a_watcher_is_not_ignored(members: dict[str, object], lacks: str) -> None:
    planner = type("Half", (Whole,), members)()
    with pytest.raises(PlannerError, match=lacks):
        PlanRunner(planner, MODEL)


def test_a_simulated_run_fails_before_it_begins() -> None:
    sweeper = SimulatedSweeper(Settings())
    before = sweeper.truth.pose, sweeper.time_s
    with pytest.raises(PlannerError, match="drain_events"):
        sweeper.clean(without("drain_events"))  # type: ignore[arg-type]  # it is none
    assert (sweeper.truth.pose, sweeper.time_s) == before
    assert sweeper.clean(Whole())["outcome"] == "complete", "a whole one runs"
