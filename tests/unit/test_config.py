"""Robot files: every error is named by its key."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from bridge.config import (
    MAX_FILE_BYTES,
    load_robot,
    parse_robot,
    robot_cautions,
    to_toml,
)
from bridge.errors import ConfigError
from bridge.motion.robot_model import RangerMount, RobotModel
from campaign.robot_sizes import SIZES, robot_of_size


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
                low, high = field.metadata["range"]
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
def test_errors_are_named(text: str, key: str) -> None:
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
def test_invalid_toml_is_reported(text: str) -> None:
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


def test_a_file_names_everything_that_is_wrong_in_one_line() -> None:
    text = """
        whel_base_m = 0.2
        wheel_diameter_m = 7
        [ultrasonic]
        x_m = 1.0
        [infrared_left]
        max_rnge_m = 3
        [supervise.stal]
        reaction = "stop"
        [supervise.slip]
        reaction = "scream"
    """
    with pytest.raises(ConfigError) as caught:
        parse_robot(text)
    line = str(caught.value)
    assert "\n" not in line
    for printed in (
        "whel_base_m: no such key; did you mean wheel_base_m?",
        "wheel_diameter_m: 7 is out of range",
        "ultrasonic.x_m, ultrasonic.y_m: the sensor at (1, 0)",
        "infrared_left.max_rnge_m: no such key; did you mean infrared_left.max_range_m?",
        "supervise.stal: no such key; did you mean supervise.stall?",
        "supervise.slip.reaction: 'scream'",
    ):
        assert printed in line
    assert len(caught.value.problems) == 6


def test_a_file_of_thousands_of_wrong_keys_is_still_reported_in_a_short_line() -> None:
    with pytest.raises(ConfigError) as caught:
        parse_robot("\n".join(f"wheel_{number} = 1" for number in range(3000)))
    assert len(caught.value.problems) == 3000
    assert "and 2988 more" in str(caught.value)
    assert len(str(caught.value)) < 5000


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("[ultrasonic]\nx_m = 1.0", "ultrasonic.x_m"),
        ("[ultrasonic]\nyaw_rad = 3.14", "ultrasonic.yaw_rad"),
        ("[infrared_left]\ny_m = 0.26", "infrared_left.y_m"),
        ("[infrared_right]\nyaw_rad = 1.57", "infrared_right.yaw_rad"),
        ("mouth_offset_m = 0.2", "mouth_offset_m"),
        # 0.45 − 0.1 = 350 mm
        (
            "robot_diameter_m = 0.9\n[infrared_right]\nmax_range_m = 0.4",
            "infrared_left: a wall that touches the robot is 350 mm from the sensor, beyond its",
        ),
        ("wheel_diameter_m = 0.4", "wheel_diameter_m"),
        ("battery_v = 4.0\ndriver_drop_v = 4.5", "driver_drop_v"),
    ],
)
def test_a_robot_that_cannot_work_is_rejected_by_name(text: str, key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_robot(text)
    assert key in str(caught.value)
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        # 0.16 − 0.14 = 20 mm
        ("[infrared_left]\ny_m = 0.14", "infrared_left: a wall that touches the robot is 20 mm"),
        ("[infrared_left]\nyaw_rad = 1.55", None),
        ("[infrared_left]\nyaw_rad = 0.7854", "infrared_left.yaw_rad: the sensor does not look"),
        ("[ultrasonic]\nx_m = 0.15", "ultrasonic: a wall that touches the robot is 10 mm"),
        # the ultrasonic at 0.12 m, a radius of 0.1 m
        (
            "robot_diameter_m = 0.2\nwheel_base_m = 0.15",
            "ultrasonic: the sensor is 20 mm outside the footprint",
        ),
        # hypot(0.12, 0.14) − 0.16 = 24 mm
        ("cleaning_width_m = 0.28\nmouth_offset_m = 0.12", "24 mm outside the footprint"),
        ("", None),
    ],
)
def test_unsuitable_values_are_cautions_with_numbers(text: str, printed: str | None) -> None:
    found = robot_cautions(parse_robot(text))
    if printed is None:
        assert found == []
    else:
        assert any(printed in caution for caution in found)


@pytest.mark.parametrize("diameter_m", [0.20, 0.22, 0.32, 0.35, 0.42, 0.50])
def test_a_robot_to_scale_is_accepted(diameter_m: float) -> None:
    scale = diameter_m / 0.32
    text = f"""
        robot_diameter_m = {diameter_m}
        wheel_base_m = {0.23 * scale}
        cleaning_width_m = {0.16 * scale}
        [ultrasonic]
        x_m = {0.12 * scale}
        [infrared_left]
        y_m = {0.10 * scale}
        [infrared_right]
        y_m = {-0.10 * scale}
    """
    assert parse_robot(text).robot_diameter_m == diameter_m


@pytest.mark.parametrize("name", SIZES)
def test_only_the_blind_robot_of_the_table_of_sizes_has_cautions(name: str) -> None:
    model = robot_of_size(name)
    assert parse_robot(to_toml(model)) == model
    assert bool(robot_cautions(model)) == (name == "blind")


def test_a_sensor_that_is_not_fitted_is_a_caution_and_nothing_of_it_is_checked() -> None:
    model = parse_robot("[ultrasonic]\nfitted = false\nx_m = 0.5\nyaw_rad = 3.0\n")
    assert not model.ultrasonic.fitted
    assert list(model.fitted_rangers) == ["infrared_left", "infrared_right"]
    assert parse_robot(to_toml(model)) == model
    (caution,) = robot_cautions(model)
    assert caution.startswith("ultrasonic.fitted: without this sensor the robot detects a new")


@pytest.mark.parametrize("value", ["1", "'no'", "[true]"])
def test_fitted_is_true_or_false(value: str) -> None:
    with pytest.raises(ConfigError, match=r"ultrasonic\.fitted: must be true or false"):
        parse_robot(f"[ultrasonic]\nfitted = {value}\n")


def test_a_tilted_sensor_that_is_too_near_has_two_cautions() -> None:
    tilted, near = robot_cautions(parse_robot("[infrared_left]\nx_m = 0.11\nyaw_rad = 1.3"))
    assert tilted.startswith("infrared_left.yaw_rad: the sensor does not look straight")
    assert near.startswith("infrared_left: a wall that touches the robot is 34 mm")
