"""The robot file and the device: the parameter for each key, and edits of a file in place."""

from __future__ import annotations

import dataclasses
import struct

import pytest

from bridge.bringup.values import ParameterDifference, differences, edited, file_values, robot_key
from bridge.config import parse_robot
from bridge.errors import ConfigError
from bridge.motion.robot_model import RobotModel
from bridge.session.parameters import Parameter
from sim_device.device.parameters import ParameterStore, table

MODEL = RobotModel()


def device(**changes: float) -> list[Parameter]:
    store = ParameterStore(table(dataclasses.replace(MODEL, **changes), 1), {})  # type: ignore[arg-type]  # keys are its own
    found = []
    for number in range(len(store.parameters)):
        message = store.describe(number)
        assert message is not None
        found.append(Parameter.from_message(message))
    return found


def test_every_parameter_of_the_model_has_its_key() -> None:
    """The device's table gives the model's field for each parameter."""
    named = {p.name: robot_key(p) for p in device()}
    for parameter in table(MODEL, 1):
        if parameter.model_key is not None:
            assert named[parameter.name] == parameter.model_key


def test_equal_values_do_not_differ_for_their_rounding() -> None:
    assert differences(device(), MODEL) == []


def test_differences_are_reported_with_both_values() -> None:
    found = differences(device(wheel_base_m=0.2345, counts_per_turn=1440), MODEL)
    rounded = struct.unpack("<f", struct.pack("<f", 0.2345))[0]
    assert found == [
        ParameterDifference("wheel_base", "m", rounded, 0.23),
        ParameterDifference("counts_per_turn", "count", 1440, 1560),
    ]


FILE = """\
# my robot
name = "bert"   # the red one
wheel_base_m=0.23 # measured

[ultrasonic]
x_m = 0.11
# the end
"""


def test_a_value_is_changed_where_it_stands() -> None:
    assert edited(FILE, {"wheel_base_m": 0.23125}) == FILE.replace("=0.23 ", "=0.23125 ")
    assert edited(FILE, {"ultrasonic.x_m": 0.12}) == FILE.replace("0.11", "0.12")


def test_new_keys_are_added_in_place() -> None:
    text = edited(FILE, {"wheel_diameter_m": 0.0651, "infrared_left.y_m": 0.09})
    model = parse_robot(text)
    assert (model.name, model.wheel_base_m) == ("bert", 0.23)
    assert (model.wheel_diameter_m, model.ultrasonic.x_m) == (0.0651, 0.11)
    assert model.infrared_left.y_m == 0.09
    assert "# the red one" in text
    assert "# the end" in text


def test_an_empty_file_takes_values_too() -> None:
    assert edited("", {"wheel_base_m": 0.2}) == "wheel_base_m = 0.2\n"


def test_a_path_that_cannot_be_a_file_is_rejected() -> None:
    with pytest.raises(ConfigError, match="wheel_base_m"):
        edited(FILE, {"wheel_base_m": 7.0})


@pytest.mark.parametrize(
    "text",
    [
        "'wheel_base_m' = 0.23 # a quoted key\n",
        "ultrasonic = { x_m = 0.11 }\n",
        "ultrasonic.x_m = 0.11\n",
        "[ultrasonic]\nx_m = 0.11\n\n[infrared_left]\ny_m = 0.1\n",
        'name = "[ultrasonic]"\n',
    ],
)
def test_every_way_to_write_a_key_is_understood(text: str) -> None:
    model = parse_robot(edited(text, {"wheel_base_m": 0.22, "ultrasonic.x_m": 0.1}))
    assert (model.wheel_base_m, model.ultrasonic.x_m) == (0.22, 0.1)


def test_a_file_that_is_no_toml_is_one_clear_error() -> None:
    with pytest.raises(ConfigError, match="not valid TOML"):
        edited("wheel_base_m = = 1\n", {"wheel_base_m": 0.2})


def test_a_tables_values_are_parameters_too() -> None:
    plain = table(MODEL, 1)
    names = {robot_key(p) for p in device()} & set(file_values(MODEL))
    assert {"ultrasonic_scale", "ultrasonic_offset_m", "infrared_left_offset_m"} <= names
    mount = dataclasses.replace(MODEL.ultrasonic, offset_m=-0.01)
    found = differences(device(), dataclasses.replace(MODEL, ultrasonic=mount))
    assert [(d.name, d.device, d.file) for d in found] == [("ultrasonic_offset", 0.0, -0.01)]
    assert len(plain) == len({p.name for p in plain})
