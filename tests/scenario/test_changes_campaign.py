"""A small part of the campaign over changes of the world; ``campaign.changes`` runs all of it."""

from __future__ import annotations

import numpy as np
import pytest

from campaign.changes import (
    CHANGES,
    MODEL,
    Change,
    Job,
    Observer,
    Result,
    jobs_of,
    run,
    violations,
)
from campaign.changes_page import page
from tools.cli.rooms import load_room
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.run import run_virtual

pytestmark = pytest.mark.slow


def change(name: str) -> Change:
    return next(each for each in CHANGES if each.name == name)


@pytest.mark.parametrize("name", ["wheels spin freely", "one wheel spins freely"])
def test_spinning_wheels_stop_the_run_within_ten_seconds(name: str) -> None:
    result = run(Job(change(name), 1))
    assert result.outcome == "stopped"
    assert any(word in result.reason for word in ("differ", "stayed", "stands"))
    assert 0.0 < result.ended_s - result.at_s < 10.0


def test_another_start_is_reported_with_its_place() -> None:
    result = run(Job(change("started elsewhere"), 0))
    assert result.events == ["start"]
    assert result.start_error_m is not None
    assert result.start_error_m < 0.1


def test_a_displaced_robot_claims_no_floor_that_it_has_not_swept() -> None:
    result = run(Job(change("displaced, unfelt"), 0))
    assert result.outcome == "stopped"
    assert "the robot was moved" in result.reason
    assert "displaced" in result.events
    assert result.claimed_wrongly_m2 < 0.1


def test_a_lifted_robot_is_not_driven_on() -> None:
    result = run(Job(change("lifted, put down elsewhere"), 0))
    assert result.outcome == "stopped"
    assert "lifted" in result.reason
    assert result.ended_s - result.at_s < 2.0
    assert result.claimed_wrongly_m2 < 0.02


def test_furniture_that_holds_the_robot_stops_the_run() -> None:
    room, observer, at_s = load_room("case-1"), Observer(), 40.0
    run_virtual(room, MODEL, "recovery", observer, noise="typical", max_time_s=at_s)
    robot = next(pose for ns, pose in observer.truth if ns >= HOST_BOOT_NS + at_s * 1e9)
    x_m, y_m = np.mean(room.obstacles[0], axis=0)
    dx_m, dy_m = robot.x_m - x_m, robot.y_m - y_m
    fault = f"obstacle@{at_s}:index=0,dx={dx_m:.3f},dy={dy_m:.3f}"
    result = run(Job(change("furniture moved"), 0), fault)
    assert result.held
    assert result.outcome == "stopped"
    assert "something holds or turns the robot" in result.reason
    assert 0.0 < result.ended_s - result.at_s < 10.0
    assert result.claimed_wrongly_m2 < 0.1


@pytest.mark.parametrize(("name", "seed"), [("furniture moved", 1), ("a person walks by", 0)])
def test_what_moves_in_the_room_does_not_end_the_run(name: str, seed: int) -> None:
    result = run(Job(change(name), seed))
    assert not result.held
    assert result.outcome == "complete"
    assert result.events == []
    assert result.coverage > 0.95


def test_a_pit_at_harsh_noise_is_not_taken_for_being_lifted() -> None:
    result = run(Job(change("cliff, harsh"), 0))
    assert result.outcome == "complete"
    assert not result.fell


def test_the_page_has_a_row_for_each_change() -> None:
    good = Result("complete", "done", ended_s=100.0, coverage=0.99)
    bad = Result("stopped", "wheels and gyro differ by 59°", "", 20.0, 25.0, ["start"], 0.5)
    bad.start_error_m, bad.fell, bad.held = 0.03, True, True
    text = page([("one", good), ("one", bad), ("other", good)], 7)
    assert "| one | 2 | 1 | 1 | 1 | 5.0 s | 5.0 s | 0.250 m² | 0.500 m² | 99.0 % |" in text
    assert "Seeds: 7 to 8" in text
    assert "1 runs named the real start, with an error of 3 cm" in text
    assert "1 runs drove a wheel over a pit" in text
    assert "In 1 runs the moved furniture was put on the robot and held it; 1 of them" in text
    assert "- one: 1 x wheels and gyro differ by N°" in text


def test_what_a_run_must_not_do_is_named() -> None:
    spinning = Job(change("wheels spin freely"), 1)
    late, in_time = (Result("stopped", "so", "", 20.0, ended_s) for ended_s in (31.0, 24.0))
    assert violations(spinning, late) == [f"{spinning.name}: not stopped within 10 s: stopped"]
    assert not violations(spinning, in_time)
    assert violations(Job(change("lifted, put down elsewhere"), 1), Result("complete", ended_s=9.0))
    assert violations(Job(change("started elsewhere"), 1), Result("complete"))
    assert violations(Job(change("none"), 1), Result("stopped", "wheels and gyro differ"))
    assert violations(Job(change("displaced, unfelt"), 1), Result("stopped", "moved")) == []
    assert violations(Job(change("furniture moved"), 1), Result("complete", fell=True))


def test_every_change_is_run_with_every_seed() -> None:
    jobs = jobs_of(range(3))
    assert len({job.name for job in jobs}) == 3 * len(CHANGES)
