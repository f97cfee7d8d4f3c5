"""Comparison of two versions of the code run by run, and of other values of the constants."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import pytest

from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.motion.estimation.drift_model import DriftModel
from bridge.motion.estimation.wall_map import WallTuning
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST
from tools.experiment.paired_differences import difference, matched
from tools.experiment.sensitivity import sensitivity_table, sensitivity_trials
from tools.experiment.settings import Settings, constants, groups, inner, scaled, settings_of
from tools.experiment.span import planner_of
from tools.experiment.store import LINES, ExperimentFolderError
from tools.experiment.trials import Trial, TrialKind
from tools.experiment.version_comparison import (
    losses_table,
    read_rows,
    version_of,
    versions_tables,
)

if TYPE_CHECKING:
    from pathlib import Path

    from _typeshed import DataclassInstance


def row(room: str, mouth: float, time_ratio: float = 1.5, **more: object) -> dict[str, Any]:
    return {
        "key": "k",
        "version": "1",
        "kind": "run",
        "room": room,
        "planner": "recovery",
        "noise": "typical",
        "seed": 0,
        "robot": "",
        "robot_hash": "",
        "options": "",
        "mouth_sweepable": mouth,
        "time_ratio": time_ratio,
        "path_ratio": 1.3,
        "collisions": 2,
        "outcome": "complete",
        **more,
    }


BEFORE = [row("a", 0.990, 1.5), row("b", 0.980, 1.7), row("c", 0.970, 1.6)]
AFTER = [row("a", 0.992, 1.4), row("b", 0.984, 1.6), row("c", 0.960, 1.5, outcome="timeout")]


def test_the_difference_is_that_of_pairs_with_its_margin() -> None:
    pairs = matched(BEFORE, AFTER)
    time = difference(pairs, "time_ratio")
    assert time.mean == pytest.approx(-0.1)
    assert time.margin == pytest.approx(0.0, abs=1e-9)
    assert time.certain
    mouth = difference(pairs, "mouth_sweepable")
    # mean of 2, 4 and -10 per mille; s = 7.572, t = 4.3027 for two degrees of freedom
    assert mouth.mean == pytest.approx(-0.004 / 3.0)
    assert mouth.margin == pytest.approx(4.3027 * 0.0075719 / 3.0**0.5, rel=1e-3)
    assert mouth.text(100.0) == "-0.13 ± 1.88"
    assert difference(pairs[:1], "mouth_sweepable").text(100.0) == "+0.20"
    assert difference([], "mouth_sweepable").mean == 0.0


def test_pairs_have_room_robot_planner_noise_and_seed_in_common() -> None:
    others = [
        row("a", 0.9, seed=1),
        row("a", 0.9, planner="paper"),
        row("a", 0.9, noise="harsh"),
        row("a", 0.9, robot_hash="f00"),
        {**row("d", 0.9), "mouth_sweepable": 0.5},
    ]
    assert matched(BEFORE, others) == []
    old = {name: value for name, value in BEFORE[0].items() if name != "options"}
    assert matched([old], AFTER)[0] == (old, AFTER[0]), "rows of an old version have no options"


def test_the_tables_of_two_versions() -> None:
    table, losses = versions_tables(matched(BEFORE, AFTER), "old", "new")
    assert table.title == "new against old, run by run"
    (line,) = table.rows
    cells = dict(zip(table.head, line, strict=False))
    assert (cells["pairs"], cells["better / worse"], cells["worst"]) == ("3", "2 / 1", "-1.00")
    assert cells["ends changed"] == "1 complete to timeout"
    assert [each[0] for each in losses.rows] == ["c", "a", "b"]
    assert losses_table([]).rows == []
    assert versions_tables([], "old", "new")[0].rows == [("0",)]


def test_results_of_another_version_are_read_as_they_are(tmp_path: Path) -> None:
    lines = [json.dumps(each) for each in BEFORE]
    (tmp_path / LINES).write_text("\n".join([*lines, '{"key": "cut']))
    rows = read_rows(tmp_path)
    assert rows == BEFORE
    assert version_of([*rows, row("a", 0.9, version="2")]) == "1, 2"


@pytest.mark.parametrize("text", [None, "", "[]\n"])
def test_a_folder_without_results_is_an_error(text: str | None, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / LINES).write_text(text)
    with pytest.raises(ExperimentFolderError):
        read_rows(tmp_path)


# ---- constants -------------------------------------------------------------------------------


def test_every_number_of_the_configs_is_a_constant() -> None:
    known = constants()
    assert known["planner.min_rate"] == RecoveryOptions().min_rate
    assert known["drift.wheel_scale"] == DriftModel().wheel_scale
    assert known["walls.gate_m"] == WallTuning().gate_m
    assert known["follow.lookahead_m"] == 0.11, "the value that the executor uses"
    assert "motion.follow" not in known
    assert "planner.search_lengths_m" not in known


def test_every_group_has_a_name_of_its_own() -> None:
    """Of two groups with one name, a change would reach both."""

    def named(config: DataclassInstance) -> list[str]:
        found = list(inner(config))
        return found + [name for value in inner(config).values() for name in named(value)]

    names = named(Settings())
    assert sorted(names) == sorted(groups(Settings()))
    assert {"planner", "motion", "follow", "track", "walls", "frames"} <= set(names)


def test_a_scaled_constant_stays_of_its_kind_and_changes() -> None:
    assert scaled("planner.min_rate", 0.7) == pytest.approx(0.075)
    assert scaled("planner.max_fruitless", 0.7) == 14
    assert [scaled("planner.blocks_to_close", factor) for factor in (0.7, 1.1)] == [1, 3]


@pytest.mark.parametrize("name", constants())
def test_a_changed_constant_reaches_its_config_alone(name: str) -> None:
    value = scaled(name, 1.4)
    changed, default = settings_of(f"{name}={value:.6g}"), Settings()
    assert changed != default
    group, _, field = name.partition(".")
    assert getattr(groups(changed)[group], field) == pytest.approx(value, rel=1e-5)
    assert settings_of("") == default


def test_the_planner_computes_with_the_braking_of_the_executor() -> None:
    """Ahead of a table leg the planner allows less speed if the wheels respond later."""
    limits = []
    for options in ("planner.max_attempts=2", "braking.lag_s=0.3"):
        planner = planner_of(Trial("empty", "recovery", "none", 0, options=options), RobotModel())
        assert isinstance(planner, RecoveryPlanner)
        planner.start(AT_REST)
        planner.context.evidence_map.add_point(0.22, 0.0)
        planner.observe(AT_REST)
        limits.append(planner.speed_limit_m_s)
    assert limits[1] < limits[0] < math.inf


def test_trials_of_a_screening_are_the_defaults_and_each_change() -> None:
    base = [Trial(room, "recovery", "typical", 0) for room in ("case-1", "empty")]
    trials = sensitivity_trials(base, ["planner.max_attempts", "planner.min_rate"], [0.7, 1.4])
    assert trials[:2] == base
    assert len(trials) == 2 * (1 + 4)
    assert {t.kind for t in trials[2:]} == {TrialKind.SENSITIVITY}
    assert len({t.key for t in trials}) == len(trials)
    assert "planner.max_attempts=1" in trials[2].label


def test_the_constant_with_the_largest_effect_comes_first() -> None:
    def varied(options: str, *shares: float) -> list[dict[str, Any]]:
        return [
            row(room, share, kind="sensitivity", options=options)
            for room, share in zip("abc", shares, strict=True)
        ]

    table = sensitivity_table(
        [
            *BEFORE,
            *varied("planner.max_attempts=1", 0.990, 0.980, 0.970),
            *varied("planner.min_rate=0.15", 0.990, 0.980, 0.940),
        ]
    )
    assert [line[0] for line in table.rows] == ["planner.min_rate", "planner.max_attempts"]
    cells = dict(zip(table.head, table.rows[0], strict=False))
    assert (cells["pairs"], cells["worst"], cells["not complete"]) == ("3", "-3.00", "0")
