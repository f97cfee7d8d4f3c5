"""An invalid planner from outside: it fails before any motion, with the reason."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from typing import Any

import numpy as np
import pytest

from bridge.coverage.planner import Finish, PlannerError, PlannerState
from bridge.coverage.runner import PlanRunner
from bridge.motion.legs import Drive, Dwell, GoTo, Leg, Turn
from bridge.motion.robot_model import RobotModel
from protocol.messages.values import StopCause
from tools.virtual.settings import SweeperSettings
from tools.virtual.simulated_sweeper import SimulatedSweeper

MODEL = RobotModel()


class Whole:
    """A complete planner whose plan ends at once."""

    state = PlannerState()

    def start(self, obs: object) -> Finish:  # noqa: ARG002 - the interface of every planner
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
def test_missing_parts_are_named(name: str) -> None:
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
        ({"observe": lambda _self, _obs: False}, "lacks speed_limit_m_s"),
        ({"speed_limit_m_s": 0.2}, r"lacks observe\(\)"),
    ],
)
def test_a_planner_that_observes_by_half_is_rejected(
    members: dict[str, object], lacks: str
) -> None:
    planner = type("Half", (Whole,), members)()
    with pytest.raises(PlannerError, match=lacks):
        PlanRunner(planner, MODEL)


def test_a_simulated_run_fails_before_it_begins() -> None:
    sweeper = SimulatedSweeper(SweeperSettings())
    before = sweeper.truth.pose, sweeper.time_s
    with pytest.raises(PlannerError, match="drain_events"):
        sweeper.clean(without("drain_events"))  # type: ignore[arg-type]  # it is none
    assert (sweeper.truth.pose, sweeper.time_s) == before
    assert sweeper.clean(Whole())["outcome"] == "complete", "a whole one runs"


class Once(Whole):
    """Planner that returns one given leg."""

    def __init__(self, leg: object) -> None:
        self.leg = leg

    def start(self, obs: object) -> Any:  # noqa: ANN401, ARG002 - invalid legs, too
        return self.leg


@pytest.mark.parametrize(
    ("kind", "field", "value", "wanted"),
    [
        (Drive, "heading_rad", math.nan, "a finite number"),
        (Drive, "distance_m", "1", "a finite number or None"),
        (Drive, "wary", "no", "True or False"),
        (GoTo, "y_m", math.inf, "a finite number"),
        (Dwell, "duration_s", None, "a finite number"),
        (Drive, "speed_m_s", 0.0, "at least 0.001"),
        (Drive, "speed_m_s", -0.1, "at least 0.001"),
        (Dwell, "duration_s", -1.0, "at least 0"),
        (Dwell, "duration_s", True, "a finite number"),
        (Turn, "purpose", 7, "a text"),
    ],
)
def test_a_leg_with_a_wrong_field_ends_the_run_as_a_fault_that_names_it(
    kind: type[Leg], field: str, value: object, wanted: str
) -> None:
    needed = {each.name: 0.0 for each in fields(kind) if each.default is MISSING}
    leg = kind(**needed | {field: value})  # type: ignore[arg-type]  # some are of no such type
    summary = SimulatedSweeper(SweeperSettings()).clean(Once(leg))
    problem = f"Once: its leg {kind.__name__} has {field} = {value!r}; it must be {wanted}"
    assert summary["outcome"] == "fault"
    assert f"PlannerError: {problem})" in summary["reason"]


@pytest.mark.parametrize("leg", [(0.0, 1.0), None])
def test_an_invalid_leg_ends_the_run_as_a_fault_that_names_it(leg: object) -> None:
    summary = SimulatedSweeper(SweeperSettings()).clean(Once(leg))
    assert summary["outcome"] == "fault"
    assert f"Once gave {leg!r}; a leg is one of Drive, Turn, GoTo, Dwell" in summary["reason"]


def test_an_integer_beyond_every_number_is_named() -> None:
    summary = SimulatedSweeper(SweeperSettings()).clean(Once(Dwell(10**400)))
    assert "has duration_s = 100000000000000000...0000000000000000000; it must" in summary["reason"]


def test_numbers_of_numpy_are_numbers() -> None:
    planner = Once(Drive(np.float32(0.0), np.float64(0.1), wary=np.False_))  # type: ignore[arg-type]
    summary = SimulatedSweeper(SweeperSettings()).clean(planner)
    assert summary["outcome"] == "complete", summary["reason"]


class Raises(Whole):
    def start(self, obs: object) -> Finish:  # noqa: ARG002 - the interface of every planner
        raise ZeroDivisionError("no lanes")


def test_a_planner_that_raises_ends_the_run_as_a_fault() -> None:
    """``simulate`` ends such a run as a fault too. The sweeper can be used afterwards."""
    sweeper = SimulatedSweeper(SweeperSettings())
    summary = sweeper.clean(Raises())
    assert summary["outcome"] == "fault"
    assert "ZeroDivisionError: no lanes" in summary["reason"]
    assert "the device has confirmed the stop" in summary["reason"]
    assert sweeper.stop_cause == StopCause.SUPERVISE
    before_s = sweeper.time_s
    assert sweeper.clean(Whole(), clear_stop=True)["outcome"] == "complete"
    assert sweeper.time_s > before_s
