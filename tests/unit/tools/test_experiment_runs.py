"""Short trials of each kind, and properties that every trial has."""

from __future__ import annotations

from itertools import pairwise
from multiprocessing.context import SpawnProcess
from typing import TYPE_CHECKING

import pytest

from bridge.floor_plan.floor_plan import FloorPlanError
from bridge.motion.robot_model import RobotModel
from tools.experiment.paper_trials import RANGE_LEVEL, TOLERANCES
from tools.experiment.runs import run_all
from tools.experiment.store import Store
from tools.experiment.trials import (
    OPEN_FLOOR,
    PERFECT,
    Trial,
    TrialKind,
    grid_trials,
    room_of,
    with_robots,
)
from tools.experiment.unswept_causes import CAUSES
from tools.experiment.worker import run_trial
from tools.rooms.generator import distance_m

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

MODEL = RobotModel()


def test_a_cycle_ends_near_where_it_should_and_speed_is_smoothed() -> None:
    row = run_trial(Trial(OPEN_FLOOR, "u-cycles", "paper", 0, 33.0, TrialKind.CYCLES))
    (first,) = row["offsets"]
    assert first["cycle"] == 1
    # at most at cruise speed: two lanes of 1.77 m, two steps of 0.16 m; and four turns
    assert 2 * (1.77 + 0.16) / MODEL.cruise_speed_m_s < first["time_s"] < 33.0
    assert first["offset_mm"] ** 2 == pytest.approx(
        first["along_mm"] ** 2 + first["across_mm"] ** 2, abs=0.05
    )
    assert first["offset_mm"] < 3.0
    xs, ys = zip(*row["path"], strict=True)
    assert (xs[0], ys[0]) == pytest.approx((10.0, 10.0), abs=0.01)
    assert max(xs) - min(xs) == pytest.approx(1.77, abs=0.01)
    assert max(ys) - min(ys) == pytest.approx(2 * 0.16, abs=0.01)
    sent = [after for _, _, after in row["smoothing"]]
    wanted = [before for _, before, _ in row["smoothing"]]
    # speeds are sent every 20 ms and rounded to 0.1 mm/s; without smoothing, starts are steps
    maximum = MODEL.max_accel_m_s2 * 0.02 + 2e-4
    assert max(b - a for a, b in pairwise(sent)) <= maximum
    assert max(b - a for a, b in pairwise(wanted)) > 5 * maximum


def test_ranges_with_noise_move_the_ends_of_lanes_by_the_seed() -> None:
    def ends(noise: str, seed: int) -> float:
        """Return the x coordinate of the end of the first lane."""
        trial = Trial("case-1", next(iter(TOLERANCES)), noise, seed, 16.0, TrialKind.RANGES)
        return float(max(x for x, _ in run_trial(trial)["path"]))

    assert ends("none", 0) == ends("none", 1)
    noisy = [ends(RANGE_LEVEL.name, seed) for seed in range(3)]
    # with a range error of 1 cm, the robot stops a few centimetres early, or touches the wall
    assert len(set(noisy)) == 3
    assert noisy == pytest.approx([ends("none", 0)] * 3, abs=0.05)


def test_a_perfect_pose_is_the_truth_and_the_loss_is_all_that_is_missing() -> None:
    row = run_trial(Trial("case-1", "u-shape", PERFECT, 3, 6.0, TrialKind.LIMITS))
    # the remaining error is the motion in the 21 ms since the encoder sample
    assert row["pose_error_max_m"] <= 0.021 * MODEL.max_speed_m_s
    assert list(row["loss"]) == list(CAUSES)
    assert row["loss"]["pose"] == pytest.approx(0.0, abs=1e-3)
    assert row["loss"]["false evidence"] == 0.0  # this planner has no map
    assert sum(row["loss"].values()) == pytest.approx(1.0 - row["mouth_sweepable"], abs=1e-3)


def test_a_zimablue_run_is_repeatable_and_within_its_heads_sweep() -> None:
    trial = Trial("empty", "zimablue bsa", "its own", 1, 3.0, TrialKind.ZIMABLUE)
    row = run_trial(trial)
    assert run_trial(trial) == row
    assert row["outcome"] == "timeout"
    robot_radius_m, head_m, speed_m_s = 0.2832, 0.34, 0.9 * 0.32
    assert row["scale"] == pytest.approx(robot_radius_m / MODEL.radius_m, rel=1e-3)
    bound_s = row["sweepable_m2"] / (head_m * speed_m_s)
    assert row["reference_time_s"] == pytest.approx(bound_s, rel=1e-3)
    # the head sweeps at most its width times its path, and the disc of a turn in place
    max_m2 = head_m * row["path_m"] + 3.15 * (head_m / 2) ** 2
    assert 0.0 < row["mouth_sweepable"] * row["sweepable_m2"] <= max_m2
    start = room_of("empty").start
    assert row["path"][0] == pytest.approx([start.x_m, start.y_m], abs=1e-3)


def test_runs_that_are_alike_for_every_seed_are_run_once() -> None:
    levels = ["none", PERFECT, "typical"]
    trials = grid_trials(["case-1"], ["recovery", "random"], levels, range(3), 6.0)
    assert len(set(trials)) == len(trials)
    assert {(t.planner, t.noise, t.seed) for t in trials} == {
        *(("recovery", noise, 0) for noise in ("none", PERFECT)),
        *(("recovery", "typical", seed) for seed in range(3)),
        *(("random", noise, seed) for noise in levels for seed in range(3)),
    }


@pytest.mark.parametrize(
    ("error", "reported"),
    [
        (
            BlockingIOError(11, "Resource temporarily unavailable"),
            "cannot start a worker process: [Errno 11] Resource temporarily unavailable",
        ),
        # the pipe of the pool fails with this error after a worker died
        (
            OSError("handle is closed"),
            "a worker process was killed, or ran out of memory; run the command again",
        ),
    ],
)
def test_workers_that_cannot_start_are_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: OSError, reported: str
) -> None:
    def reject(*_: object) -> None:
        raise error

    monkeypatch.setattr(SpawnProcess, "_Popen", reject)
    trials = [Trial("case-1", "u-shape", "none", 0, 1.0)]
    outcome = run_all(Store(tmp_path, "a version", force=False), trials, 1)
    assert outcome.interrupted
    assert outcome.failed == [reported]


def test_without_noise_a_run_is_the_same_for_every_seed() -> None:
    rows = [run_trial(Trial("case-1", "recovery", "none", seed, 20.0)) for seed in (0, 1)]
    assert rows[0] == rows[1]


def test_a_robot_file_is_an_axis_of_the_grid(tmp_path: Path) -> None:
    small = tmp_path / "small.toml"
    small.write_text("robot_diameter_m = 0.26\ncleaning_width_m = 0.13\nwheel_base_m = 0.19\n")
    trials = grid_trials(["empty"], ["recovery"], ["none"], [0], None)
    with_small = with_robots(trials, [str(small)])
    assert [trial.model.robot_diameter_m for trial in trials + with_small] == [0.32, 0.26]
    assert with_small[0].label.endswith("robot small")
    before = with_small[0].key
    small.write_text(small.read_text() + "name = 'another'\n")
    assert with_robots(trials, [str(small)])[0].key != before


def test_without_noise_a_planner_of_another_package_runs_with_each_seed() -> None:
    assert len(grid_trials(["case-1"], ["mine:Planner"], ["none"], range(3), None)) == 3
    assert len(grid_trials(["case-1"], ["paper"], ["none"], range(3), None)) == 1


def test_a_large_robot_fits_at_the_start_of_a_generated_room() -> None:
    name, radius_m = "generated:legs:4", 0.25
    plan = room_of(name, radius_m)
    start = (plan.start.x_m, plan.start.y_m)
    assert all(distance_m(polygon, *start) > radius_m for polygon in (plan.walls, *plan.obstacles))
    assert room_of(name, 0.10) == room_of(name)


def test_a_robot_that_does_not_fit_at_the_start_is_reported_before_any_run(tmp_path: Path) -> None:
    large = tmp_path / "large.toml"
    large.write_text("robot_diameter_m = 0.5\n")
    (trial,) = with_robots(grid_trials(["case-2"], ["recovery"], ["none"], [0], None), [str(large)])
    with pytest.raises(FloorPlanError, match=r"case-2 .* robot large.*start.*0\.25 m"):
        _ = trial.plan
