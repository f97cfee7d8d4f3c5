"""A small part of the supervision campaign; ``campaign.supervise`` runs all of it."""

from __future__ import annotations

import json

import pytest

from bridge.motion.geometry import Pose2
from bridge.session.records import EventRecord, Severity, TruthRecord
from bridge.supervise.settings import SuperviseSettings
from campaign.hazards import HAZARDS, ROOMS
from campaign.outcome import Alarm, Alarms, Job, Outcome, lane_path_m
from campaign.supervise import from_stored, hazard_jobs, run, to_stored
from campaign.supervise_page import page
from tools.cli.rooms import shipped_rooms
from tools.virtual.run import EPOCH_NS

pytestmark = pytest.mark.slow

SHARE = ("wheel stuck, one", "one wheel slips by 30 %")


@pytest.mark.parametrize("hazard", [h for h in HAZARDS if h.name in SHARE], ids=lambda h: h.name)
def test_an_injected_hazard_is_caught(hazard: object) -> None:
    (job,) = hazard_jobs([7], [hazard])  # type: ignore[list-item]  # of HAZARDS
    outcome = run(Job("case-1", job.planner, 7, job.onboard, job.hazard))
    assert outcome.caught_s is not None, outcome
    assert not [alarm for alarm in outcome.alarms if alarm.at_s < outcome.at_s]


def test_a_run_without_any_raises_no_alarm() -> None:
    """The run is long enough for U-turns, on which the robot drives during a turn."""
    outcome = run(Job("empty", "recovery", 5, max_s=120.0))
    assert outcome.supervised_s > 115.0
    assert outcome.alarms == []


def test_the_page_counts_missed_hazards_and_false_alarms() -> None:
    hazard = HAZARDS[0]
    caught = Outcome(Job("case-1", "paper", 1, hazard=hazard), at_s=10.0)
    caught.alarms = [Alarm(9.0, "stall", ""), Alarm(11.5, "slip", ""), Alarm(12.0, "stall", "")]
    assert caught.caught_s == pytest.approx(2.0)
    late = Outcome(Job("case-1", "paper", 2, hazard=hazard), at_s=10.0)
    late.alarms = [Alarm(10.0 + hazard.lasts_s + 2.1, "stall", "")]
    assert late.caught_s is None
    clean = Outcome(Job("case-1", "paper", 3), supervised_s=3600.0)
    clean.alarms = [Alarm(5.0, "slip", ""), Alarm(7.0, "disagreement", "", true=True)]
    text, good = page([caught, clean])
    assert good
    assert "**1 false alarms, 1.00 per hour**" in text
    assert f"| {hazard.name} | stall | 1 | 1 | 0 | 0 | 1.00 | 2.0 s | 2.0 s |" in text
    # The stall rule raised three alarms, and the slip rule two; each rule raised one false alarm.
    assert "| stall | 2 | 1 | 0 | 1 | 0.500 |" in text
    assert "| slip | 2 | 0 | 1 | 1 | 0.500 |" in text
    assert "| disagreement | 1 | 1 | 0 | 0 | 1.000 |" in text
    assert not page([caught, late])[1]
    clean.alarms.append(Alarm(6.0, "bump", ""))
    assert not page([caught, clean])[1]
    late.by_check = True
    assert page([caught, late])[1], "a check of the run stopped it"
    late.ended_s = 9.0
    assert not page([caught, late])[1], "a stop before the hazard is not its end"
    stopped = Outcome(Job("case-1", "paper", 4), supervised_s=1800.0, by_check=True)
    text, good = page([caught, stopped])
    assert "| check of the run | 1 | 0 | 2.00 |" in text
    assert not good


@pytest.mark.parametrize(("reported_m", "true"), [(1.02, False), (0.98, False), (1.04, True)])
def test_an_alarm_about_d_is_compared_with_the_true_lane(reported_m: float, *, true: bool) -> None:
    """The robot drives a metre ahead within 5 s, and then 2 cm back.

    The turn before this motion is not part of the lane.
    """
    sink = Alarms()
    ways = [(1.0, -3.0), (2.0, 0.0), (3.0, 0.4), (6.0, 1.0), (6.5, 0.98)]
    for at_s, x in ways:
        sink.write(TruthRecord(EPOCH_NS + round(at_s * 1e9), Pose2(x, 5.0, 0.0)))
    data = {"D_m": reported_m, "odometry_m": 1.0, "for_s": 5.0}
    at_ns = EPOCH_NS + 7_000_000_000
    sink.write(EventRecord(at_ns, Severity.INFO, "supervise", "disagreement", "", data))
    sink.write(EventRecord(at_ns, Severity.INFO, "supervise", "bump", "", {"count": 18}))
    assert [alarm.true for alarm in sink.found] == [true, False]
    assert lane_path_m([], 0.0, 1.0) != lane_path_m([], 0.0, 1.0), "nan: not known"


def test_an_outcome_can_be_stored() -> None:
    done = Outcome(Job("case-1", "paper", 1, hazard=HAZARDS[0]), at_s=10.0, ending="so")
    done.alarms = [Alarm(12.0, "stall", "it stands")]
    assert from_stored(done.job, json.loads(json.dumps(to_stored(done)))) == done


def test_every_rule_has_a_hazard() -> None:
    tried = frozenset[str]().union(*(hazard.rules for hazard in HAZARDS))
    assert tried == SuperviseSettings().rules.keys()


def test_every_room_that_ships_is_tried_and_every_hazard_has_one() -> None:
    assert sorted(ROOMS) == shipped_rooms()
    for hazard in HAZARDS:
        assert hazard.rooms, hazard.name
        assert hazard.rules, hazard.name
