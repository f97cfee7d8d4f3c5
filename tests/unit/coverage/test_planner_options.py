"""A planner's options by name: numbers, words, yes or no; an invalid value is a one-line error."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.coverage.baselines.lanes import LaneOptions
from bridge.coverage.baselines.paper import PaperOptions, PaperPlanner
from bridge.coverage.baselines.random_bounce import RandomOptions, RandomPlanner
from bridge.coverage.planner_options import (
    NoOptions,
    PlannerOptionError,
    option_names,
    parse_options,
)
from bridge.coverage.registry import make_planner
from bridge.motion.robot_model import RobotModel

MODEL = RobotModel()


def test_omitted_values_stay_unchanged() -> None:
    assert parse_options(PaperOptions, ()) == PaperOptions()
    assert parse_options(PaperOptions, ["equal_tolerance_m=0.01"]) == PaperOptions(
        equal_tolerance_m=0.01
    )


def test_numbers_words_and_yes_or_no() -> None:
    printed = ["side=right", "max_lanes=12", "clear_after_recovery=False", "count_turns=on_equal"]
    assert parse_options(PaperOptions, printed) == PaperOptions(
        side="right", max_lanes=12, clear_after_recovery=False, count_turns="on_equal"
    )


def test_every_ambiguity_of_the_paper_can_be_set() -> None:
    names = option_names(PaperOptions)
    assert {"end", "count_turns", "between", "recovery_lanes", "return_by", "side"} <= set(names)
    assert names == list(PaperOptions.__dataclass_fields__), "none is left out"


@given(st.text() | st.sampled_from(option_names(LaneOptions)), st.text())
def test_any_text_is_taken_or_reported_in_one_line(name: str, value: str) -> None:
    reported = ""
    try:
        parse_options(LaneOptions, [f"{name}={value}"])
    except PlannerOptionError as error:
        reported = str(error)
    assert "\n" not in reported
    assert reported or name in option_names(LaneOptions)


@given(st.sampled_from(["stop_gap_m", "rest_s"]), st.floats(0.0, 1e6))
def test_a_number_comes_back_to_the_digit(name: str, value: float) -> None:
    assert getattr(parse_options(LaneOptions, [f"{name}={value!r}"]), name) == value


@pytest.mark.parametrize(
    ("printed", "reported"),
    [
        (["end"], "'end' is not NAME=VALUE"),
        (["fin=never"], "no option 'fin'; there are: side, end, stop_gap_m"),
        (["end=soon"], "'end=soon': not one of last_partial_lane, blocked_step, never"),
        (["rest_s=-1"], "'rest_s=-1': not a number from 0"),
        (["rest_s=nan"], "not a number from 0"),
        (["rest_s=inf"], "not a number from 0"),
        (["max_lanes=1.5"], "'max_lanes=1.5': not a whole number from 0"),
        (["side=left", "side=right"], "side is given twice"),
    ],
)
def test_what_cannot_be(printed: list[str], reported: str) -> None:
    with pytest.raises(PlannerOptionError) as error:
        parse_options(LaneOptions, printed)
    assert reported in str(error.value)


def test_the_planners_take_theirs() -> None:
    rng = random.Random(0)
    paper = make_planner("paper", MODEL, rng, ["return_by=nearest"])
    bounce = make_planner("random", MODEL, rng, ["max_time_s=7"])
    assert isinstance(paper, PaperPlanner)
    assert isinstance(bounce, RandomPlanner)
    assert paper.options == PaperOptions(return_by="nearest")
    assert bounce.options == RandomOptions(max_time_s=7.0)
    assert parse_options(NoOptions, ()) == NoOptions()
    with pytest.raises(PlannerOptionError, match="there are: none"):
        make_planner("recovery", MODEL, rng, ["cell_m=0.01"])
