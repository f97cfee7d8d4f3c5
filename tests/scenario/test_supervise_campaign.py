"""A share of the campaign over supervision; the whole is ``campaign.supervise``."""

from __future__ import annotations

import pytest

from campaign.hazards import HAZARDS, ROOMS
from campaign.supervise import Job, Outcome, hazard_jobs, report, run

SHARE = ("wheel stuck, one", "one wheel slips by 30 %")


@pytest.mark.parametrize("hazard", [h for h in HAZARDS if h.name in SHARE], ids=lambda h: h.name)
def test_an_injected_hazard_is_caught(hazard: object) -> None:
    (job,) = hazard_jobs([7], [hazard])  # type: ignore[list-item]  # of HAZARDS
    outcome = run(Job("case-1", job.planner, 7, job.onboard, job.hazard))
    assert outcome.caught_s is not None, outcome
    assert not [alarm for alarm in outcome.alarms if alarm[0] < outcome.at_s]


def test_a_run_without_any_raises_no_alarm() -> None:
    outcome = run(Job("case-1", "recovery", 5, max_s=40.0))
    assert outcome.watched_s > 35.0
    assert outcome.alarms == []


def test_the_report_counts_what_was_missed_and_what_was_false() -> None:
    hazard = HAZARDS[0]
    caught = Outcome(Job("case-1", "paper", 1, hazard=hazard), at_s=10.0)
    caught.alarms = [(9.0, "stall", ""), (11.5, "slip", ""), (12.0, "stall", "")]
    assert caught.caught_s == pytest.approx(2.0)
    late = Outcome(Job("case-1", "paper", 2, hazard=hazard), at_s=10.0)
    late.alarms = [(10.0 + hazard.lasts_s + 2.1, "stall", "")]
    assert late.caught_s is None
    clean = Outcome(Job("case-1", "paper", 3), watched_s=3600.0, alarms=[(5.0, "slip", "")])
    text, good = report([caught, clean])
    assert good
    assert "1 alarms, 1.00 per hour" in text
    assert f"| {hazard.name} | stall | 1 | 1 | 0 | 0 | 2.0 s | 2.0 s |" in text
    assert not report([caught, late])[1]
    clean.alarms.append((6.0, "bump", ""))
    assert not report([caught, clean])[1]


def test_every_rule_has_a_hazard() -> None:
    rules = frozenset[str]().union(*(hazard.rules for hazard in HAZARDS))
    assert len(rules) == 13
    assert len(ROOMS) == 9
