"""Supervision rules in a robot file and as a command-line option."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.config import load_supervise, parse_robot
from bridge.errors import ConfigError
from bridge.supervise import Level, SuperviseSettings, parse_rule, settings_from

if TYPE_CHECKING:
    from pathlib import Path


def test_an_empty_table_gives_the_defaults() -> None:
    assert settings_from({}) == SuperviseSettings()
    assert load_supervise(None) == SuperviseSettings()


def test_a_robot_file_changes_only_its_keys(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        "wheel_diameter_m = 0.066\n"
        "[supervise]\npause_limit_s = 20\n"
        '[supervise.stall]\nreaction = "stop"\ncurrent_a = 1\n'
        "[supervise.fence]\npolygon = [[0, 0], [2, 0], [2.0, 3]]\n"
    )
    settings = load_supervise(path)
    assert settings.pause_limit_s == 20.0
    assert settings.stall.reaction is Level.STOP
    assert settings.stall.current_a == 1.0
    assert settings.stall.then is SuperviseSettings().stall.then
    assert settings.fence.polygon == ((0.0, 0.0), (2.0, 0.0), (2.0, 3.0))
    assert settings.slip == SuperviseSettings().slip
    assert parse_robot(path.read_text()).wheel_diameter_m == 0.066


@pytest.mark.parametrize(
    ("table", "named"),
    [
        ({"stal": {}}, "supervise.stal: no such key"),
        ({"stall": {"current": 1}}, "supervise.stall.current: no such key"),
        ({"stall": 3}, "supervise.stall: must be a table"),
        ({"stall": {"reaction": 2}}, "supervise.stall.reaction: 2 is not one of off, report"),
        ({"stall": {"reaction": "halt"}}, "supervise.stall.reaction: 'halt' is not one of"),
        ({"stall": {"current_a": "1"}}, "supervise.stall.current_a: '1' is not a number"),
        ({"stall": {"current_a": True}}, "supervise.stall.current_a: True is not a number"),
        ({"stall": {"current_a": 0.01}}, "supervise.stall.current_a: 0.01 is out of range"),
        ({"stall": {"current_a": float("nan")}}, "supervise.stall.current_a: nan is out of range"),
        ({"stall": {"after_s": -1}}, "supervise.stall.after_s: -1 is out of range 0..3600"),
        ({"slow_factor": 0}, "supervise.slow_factor: 0 is out of range 0.05..1"),
        ({"fence": {"polygon": [[0, 0], [1, 1]]}}, "supervise.fence.polygon: must be a list of 3"),
        ({"fence": {"polygon": 3}}, "supervise.fence.polygon: must be a list"),
        (
            {"fence": {"polygon": [[0, 0], [1], [2, 2]]}},
            "supervise.fence.polygon[1]: must be [x, y]",
        ),
        (
            {"fence": {"polygon": [[0, 0], [1, "a"], [2, 2]]}},
            "supervise.fence.polygon[1]: 'a' is not",
        ),
        ({"fence": {"polygon": [[0, 0], [1, 1], [2, 2]]}}, "the corners enclose no area"),
        ({"fence": {"polygon": [[0, 0]] * 257}}, "a list of 3 to 256 corners"),
        (7, "supervise: must be a table"),
    ],
)
def test_errors_are_named(table: object, named: str) -> None:
    with pytest.raises(ConfigError) as error:
        settings_from(table)
    assert named in str(error.value)
    assert "\n" not in str(error.value)


def test_a_robot_file_with_a_wrong_rule_is_rejected_before_any_run() -> None:
    with pytest.raises(ConfigError, match=r"supervise\.bump\.count"):
        parse_robot("[supervise.bump]\ncount = 0\n")


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("stall.reaction=pause", "stall.reaction", Level.PAUSE),
        ('stall.reaction="stop"', "stall.reaction", Level.STOP),
        ("stall.current_a = 0.7", "stall.current_a", 0.7),
        ("fence.radius_m=2", "fence.radius_m", 2.0),
        (
            "fence.polygon=[[0,0],[1,0],[1,1]]",
            "fence.polygon",
            ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)),
        ),
        ("pause_limit_s=5", "pause_limit_s", 5.0),
    ],
)
def test_one_setting_as_an_option(text: str, key: str, value: object) -> None:
    found: object = parse_rule(SuperviseSettings(), text)
    for part in key.split("."):
        found = getattr(found, part)
    assert found == value


@pytest.mark.parametrize(
    "text", ["stall", "stall.reaction", "=3", "stall.=3", ".reaction=report", ""]
)
def test_an_option_that_names_nothing(text: str) -> None:
    with pytest.raises(ConfigError, match=r"RULE\.KEY=VALUE"):
        parse_rule(SuperviseSettings(), text)


def test_an_option_is_checked_like_the_file() -> None:
    with pytest.raises(ConfigError, match=r"supervise\.stall\.reaction: 'loud'"):
        parse_rule(SuperviseSettings(), "stall.reaction=loud")
    first = parse_rule(SuperviseSettings(), "stall.reaction=report")
    second = parse_rule(first, "slip.reaction=off")
    assert (second.stall.reaction, second.slip.reaction) == (Level.REPORT, Level.OFF)


def test_the_defaults_as_the_page_has_them() -> None:
    """The defaults equal the table in docs/supervise.md."""
    rules = SuperviseSettings()
    graded = {
        name: (rule.reaction.name, rule.after_s, rule.then.name, rule.then_s)
        for name, rule in rules.rules.items()
    }
    assert graded == {
        "stall": ("PAUSE", 0.6, "STOP", 1.0),
        "slip": ("SLOW", 0.3, "PAUSE", 3.0),
        "tilt": ("STOP", 0.3, "STOP", 1.0),
        "lifted": ("STOP", 0.0, "STOP", 1.0),
        "bump": ("REPORT", 0.0, "PAUSE", 10.0),
        "cliff": ("REPORT", 0.0, "STOP", 3.0),
        "battery": ("REPORT", 0.5, "STOP", 3600.0),
        "silence": ("REPORT", 0.0, "STOP", 0.3),
        "progress": ("PAUSE", 0.0, "STOP", 60.0),
        "fence": ("STOP", 0.0, "STOP", 1.0),
        "disagreement": ("PAUSE", 0.0, "STOP", 5.0),
        "sensor": ("PAUSE", 0.0, "PAUSE", 1.0),
        "reset": ("STOP", 0.0, "STOP", 1.0),
    }
    assert (rules.slip.difference_m_s, rules.slip.share) == (0.015, 0.25)
    assert (rules.tilt.angle_deg, rules.cliff.ahead_m) == (12.0, 0.05)
    assert (rules.bump.count, rules.bump.window_s, rules.bump.held_s) == (18.0, 15.0, 5.0)
    assert (rules.battery.low_v, rules.battery.empty_v) == (12.8, 12.0)
    assert (rules.silence.silent_s, rules.silence.stream_s) == (0.4, 1.0)
    assert (rules.progress.window_s, rules.progress.min_side_m) == (60.0, 0.10)
    assert (rules.disagreement.distance_m, rules.disagreement.equal_m) == (0.03, 0.02)
    assert (rules.slow_factor, rules.slow_for_s, rules.pause_limit_s) == (0.5, 5.0, 60.0)
