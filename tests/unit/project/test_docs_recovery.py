"""docs/recovery-planner.md lists all states and events; every picture of the docs is drawn."""

from __future__ import annotations

import re

import pytest

from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.coverage.runner import PlanRunner
from bridge.motion.observation import HALT
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, FastWorld
from support.root import ROOT
from tools.cli.rooms import load_room
from tools.dev.behaviour_pictures.__main__ import PICTURES
from tools.dev.pin_pictures import BOARDS

PAGE = (ROOT / "docs" / "recovery-planner.md").read_text("utf-8")
MODEL = RobotModel()


@pytest.fixture(scope="module")
def seen() -> tuple[set[str], set[str]]:
    """Return states and events of a noisy run with bumps, blocked transits and heading fixes."""
    world = FastWorld(load_room("columns", MODEL.radius_m), MODEL, 2, LEVELS["harsh"])
    runner = PlanRunner(RecoveryPlanner(MODEL), MODEL)
    states: set[str] = set()
    kinds: set[str] = set()
    obs = world.step(HALT)
    while not runner.finished:
        obs = world.step(runner.step(obs))
        states.add(runner.state.state)
        kinds.update(event.kind for event in runner.drain_events())
    return states, kinds


def test_every_state(seen: tuple[set[str], set[str]]) -> None:
    (sentence,) = re.findall(r"`/planner` carries the state: (.*?)\. The topic", PAGE, re.DOTALL)
    states, _ = seen
    assert len(states) > 5
    assert states <= set(re.findall(r"`([\w-]+)`", sentence))


def test_every_kind_of_event(seen: tuple[set[str], set[str]]) -> None:
    cells = re.findall(r"^\| (`[^|]+`) \|", PAGE, re.MULTILINE)
    _, kinds = seen
    assert len(kinds) > 10
    assert kinds <= {kind for cell in cells for kind in re.findall(r"`([\w-]+)`", cell)}


def test_every_picture_is_on_a_page_and_the_other_way_round() -> None:
    pages = (
        "estimation",
        "wall-map",
        "control",
        "wall-following",
        "recovery-planner",
        "recovery-reactions",
        "paper",
    )
    shown = {
        name
        for page in pages
        for name in re.findall(
            r"\(images/([\w-]+)\.png\)", (ROOT / "docs" / f"{page}.md").read_text("utf-8")
        )
    }
    assert shown == set(PICTURES)
    assert {path.stem for path in (ROOT / "docs" / "images").glob("*.png")} == shown | set(BOARDS)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["control-turn", "recovery-phases", "recovery-occluded"])
def test_a_picture_is_drawn_from_a_run(name: str) -> None:
    figure = PICTURES[name]()
    assert all(axes.lines for axes in figure.axes)
    assert all(axes.get_xlabel().endswith(")") for axes in figure.axes)
