"""Rests between legs, which measure the gyro bias."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import pytest

from bridge.coverage.gyro_standstill import GyroStandstill
from bridge.coverage.planner import Finish
from bridge.coverage.runner import PlanRunner
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, Turn
from bridge.motion.observation import HALT, Observation
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST

if TYPE_CHECKING:
    from bridge.coverage.planner import PlannerEvent
    from bridge.motion.legs import Leg, LegResult

UNCERTAIN, SURE = math.radians(0.02), math.radians(0.004)


def seen(time_s: float, uncertainty: float, x: float = 0.0) -> Observation:
    pose = Pose2(x, 0.0, 0.0)
    return AT_REST._replace(time_s=time_s, pose=pose, gyro_bias_sigma_rad_s=uncertainty)


def test_a_rest_lasts_until_the_bias_is_sure() -> None:
    rest = GyroStandstill()
    assert not rest.holds(seen(0.0, SURE))
    assert rest.holds(seen(1.0, UNCERTAIN))
    assert rest.held
    assert rest.holds(seen(2.0, UNCERTAIN))
    assert not rest.holds(seen(2.1, SURE))
    assert not rest.held


def test_a_rest_without_effect_ends_and_is_not_repeated_at_once() -> None:
    rest = GyroStandstill()
    times = [0.1 * k for k in range(400) if rest.holds(seen(0.1 * k, UNCERTAIN))]
    assert 2.0 < sum(t < 20.0 for t in times) * 0.1 < 3.0
    assert not any(3.0 < t < 20.0 for t in times)
    assert any(t > 20.0 for t in times), "but once more, later"


class Legs:
    """Planner with two short legs and without observations during the legs."""

    state = None

    def __init__(self) -> None:
        self.asked: list[float] = []

    def start(self, obs: Observation) -> Leg:
        return self._leg(obs)

    def next(self, _result: LegResult, obs: Observation) -> Leg:
        return self._leg(obs)

    def drain_events(self) -> list[PlannerEvent]:
        return []

    def _leg(self, obs: Observation) -> Leg:
        self.asked.append(obs.time_s)
        return Drive(0.0, 0.02, purpose="lane")


class Watching(Legs):
    """Planner that observes during its legs, like ``recovery``."""

    speed_limit_m_s = 1.0

    def observe(self, _obs: Observation) -> bool:
        return False


def test_only_a_planner_that_watches_is_held_and_only_between_its_legs() -> None:
    for planner, holds in ((Watching(), True), (Legs(), False)):
        runner = PlanRunner(planner, RobotModel())  # type: ignore[arg-type]  # no state to report
        x, moved = 0.0, []
        for k in range(300):
            now_s = 0.02 * k
            uncertainty = UNCERTAIN if 0.5 < now_s < 3.0 else SURE
            command = runner.step(seen(now_s, uncertainty, x))
            x += 0.02 * command.v_m_s
            if command != HALT:
                moved.append(now_s)
        kinds = [event.kind for event in runner.drain_events()]
        assert kinds == (["rest"] if holds else [])
        assert runner.drain_events() == []
        asked = [t for t in planner.asked if 0.5 < t < 3.0]
        assert (not asked) is holds, "no leg is begun in a rest"
        assert any(0.5 < t < 0.9 for t in moved), "the leg that it came in is brought to its end"
        assert any(t > 3.1 for t in moved)


class Flowing(Watching):
    """Planner whose only leg and whose plan end in motion; the gyro may be uncertain then."""

    def _leg(self, obs: Observation) -> Leg:
        self.asked.append(obs.time_s)
        if len(self.asked) > 1:
            return Finish("done")  # type: ignore[return-value]  # as a plan may
        return Drive(0.0, 0.5, end_m_s=0.12)


@pytest.mark.parametrize("uncertainty", [SURE, UNCERTAIN])
def test_a_plan_that_ends_or_rests_in_motion_brakes_within_the_limit(uncertainty: float) -> None:
    planner = Flowing()
    runner = PlanRunner(planner, RobotModel())  # type: ignore[arg-type]  # no state to tell
    x = v = 0.0
    sent = []
    for k in range(500):
        obs = seen(0.02 * k, uncertainty if x > 0.3 else SURE, x)._replace(v_m_s=v)
        v = runner.step(obs).v_m_s
        sent.append(v)
        x += 0.02 * v
    assert runner.finished
    assert sent[-1] == 0.0
    assert 0.49 < x < 0.53
    handed_on = min(v for v in sent[sent.index(max(sent)) :] if v > 0.1)
    assert handed_on == pytest.approx(0.12, abs=0.02), "it came to the leg's end in motion"
    steps = [abs(b - a) for a, b in itertools.pairwise(sent)]
    assert max(steps) <= RobotModel().max_accel_m_s2 * 0.02 + 0.01


class Circling(Watching):
    """Planner that, after one leg, only turns to its present heading; such turns end at once."""

    def _leg(self, obs: Observation) -> Leg:
        self.asked.append(obs.time_s)
        return Turn(0.0, flowing=True) if len(self.asked) > 1 else Drive(0.0, 0.5, end_m_s=0.12)


def test_a_plan_that_goes_in_circles_is_ended_and_brakes_within_the_limit() -> None:
    runner = PlanRunner(Circling(), RobotModel())  # type: ignore[arg-type]  # no state to tell
    x = v = 0.0
    sent = []
    for k in range(500):
        v = runner.step(seen(0.02 * k, SURE, x)._replace(v_m_s=v)).v_m_s
        sent.append(v)
        x += 0.02 * v
    assert runner.finish_reason == "planner made no progress"
    assert sent[-1] == 0.0
    steps = [abs(b - a) for a, b in itertools.pairwise(sent)]
    assert max(steps) <= RobotModel().max_accel_m_s2 * 0.02 + 0.01
