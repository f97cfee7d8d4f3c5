"""Robot files: what is wrong is named by its key."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from bridge.config import _RANGES, MAX_FILE_BYTES, load_robot, parse_robot, to_toml
from bridge.errors import ConfigError
from bridge.motion.robot_model import RangerMount, RobotModel


def test_an_empty_file_is_the_papers_robot() -> None:
    assert parse_robot("") == RobotModel()
    assert load_robot(None) == (RobotModel(), to_toml(RobotModel()))


def test_the_model_reads_back_as_it_was_written() -> None:
    model = RobotModel(
        name='a "quoted" \\ name\n\t\x7f ü 🤖',
        wheel_diameter_m=0.0648,
        counts_per_turn=1600,
        ultrasonic=RangerMount(0.1, -0.01, 0.05, 0.03, 3.0, 0.2),
    )
    assert parse_robot(to_toml(model)) == model


def test_every_number_of_the_model_has_a_range() -> None:
    for cls in (RobotModel, RangerMount):
        for field in dataclasses.fields(cls):
            if field.type in {"float", "int"}:
                low, high = _RANGES[field.name]
                assert low < high


def test_values_reach_the_model() -> None:
    model = parse_robot("wheel_base_m = 0.25\n[infrared_left]\nmax_range_m = 0.2\n")
    assert model.wheel_base_m == 0.25
    assert model.infrared_left == dataclasses.replace(RobotModel().infrared_left, max_range_m=0.2)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("wheel_bas_m = 0.2", "wheel_bas_m"),
        ("wheel_base_m = 'wide'", "wheel_base_m"),
        ("wheel_base_m = true", "wheel_base_m"),
        ("wheel_base_m = nan", "wheel_base_m"),
        ("wheel_base_m = inf", "wheel_base_m"),
        ("wheel_base_m = -0.2", "wheel_base_m"),
        ("wheel_base_m = 2026-01-01", "wheel_base_m"),
        ("wheel_base_m = [0.2]", "wheel_base_m"),
        ("counts_per_turn = 1560.5", "counts_per_turn"),
        ("counts_per_turn = 0", "counts_per_turn"),
        pytest.param(f"counts_per_turn = 0x{'f' * 5000}", "counts_per_turn", id="huge"),
        ("name = ''", "name"),
        ("name = 3", "name"),
        (f"name = '{'x' * 65}'", "name"),
        ("ultrasonic = 3", "ultrasonic"),
        ("[ultrasonic]\nx = 1", "ultrasonic.x"),
        ("[ultrasonic]\ncone_rad = 9.0", "ultrasonic.cone_rad"),
        ("[infrared_left]\nmin_range_m = 0.5", "infrared_left.min_range_m"),
        ("cruise_speed_m_s = 0.31", "cruise_speed_m_s"),
        ("cleaning_width_m = 0.4", "cleaning_width_m"),
        ("wheel_base_m = 0.4", "wheel_base_m"),
    ],
)
def test_what_is_wrong_is_named(text: str, key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_robot(text)
    assert key in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500
    assert caught.value.exit_status == 2


@pytest.mark.parametrize(
    "text",
    ["wheel_base_m =", "= 3", "[", f"counts_per_turn = {'1' * 5000}", "x = " + "[" * 20_000],
    ids=["no value", "no key", "open table", "5000 digits", "deep"],
)
def test_what_is_no_toml_is_said_so(text: str) -> None:
    with pytest.raises(ConfigError, match="not valid TOML"):
        parse_robot(text)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    big = tmp_path / "big.toml"
    big.write_text("#" * (MAX_FILE_BYTES + 1))
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe")
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("colour = 'red'")
    for path in (tmp_path / "none.toml", tmp_path, big, binary, wrong, Path("/dev/zero")):
        with pytest.raises(ConfigError) as caught:
            load_robot(path)
        assert str(path) in str(caught.value)
