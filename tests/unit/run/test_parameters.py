"""Parameters with name, unit and range, as the host shows and checks them."""

from __future__ import annotations

import json
import math

import pytest

from bridge.errors import ParameterError
from bridge.session.parameters import Parameter, closest
from protocol.messages.device import ParameterValue

# IEEE 754 binary32, computed by hand: 0.5 = 2^-1, 0.25 = 2^-2, 2.0 = 2^1.
HALF, QUARTER, TWO = 0x3F00_0000, 0x3E80_0000, 0x4000_0000


def reported(kind: int, flags: int = 0, *values: int, name: str = "top_speed m/s") -> Parameter:
    value, default, low, high = values or (HALF, HALF, QUARTER, TWO)
    return Parameter.from_message(
        ParameterValue(4, 13, kind, flags, value, default, low, high, name)
    )


def test_a_float() -> None:
    speed = reported(2, 0b1011)
    assert (speed.number, speed.name, speed.unit, speed.kind) == (4, "top_speed", "m/s", "f32")
    assert (speed.value, speed.low, speed.high) == (0.5, 0.25, 2.0)
    assert (speed.stored, speed.changed, speed.read_only, speed.needs_reboot) == (
        *(True, True, False, True),
    )
    assert speed.raw(0.25) == QUARTER
    assert speed.raw("2") == TWO
    assert Parameter.from_dict(speed.to_dict()) == speed


@pytest.mark.parametrize("value", [0.2, 2.1, math.inf, math.nan, 1e300, "fast", "nan"])
def test_values_that_a_float_rejects(value: float | str) -> None:
    with pytest.raises(ParameterError, match="top_speed"):
        reported(2).raw(value)


def test_the_range_is_reported_with_its_unit() -> None:
    with pytest.raises(ParameterError, match=r"3 is not in 0\.25 to 2 m/s"):
        reported(2).raw(3)


def test_a_whole_number_is_whole() -> None:
    counts = reported(0, 0, 1560, 1560, 4, 1_000_000)
    assert counts.raw("1560") == 1560
    with pytest.raises(ParameterError, match="whole"):
        counts.raw(1560.5)


def test_values_that_cannot_be_set() -> None:
    with pytest.raises(ParameterError, match="read-only"):
        reported(0, 0b100, 1, 1, 1, 15).raw(2)


def test_a_name_that_there_is_not() -> None:
    assert "did you mean max_speed?" in closest("max_sped", ["max_speed", "node"])
    assert "use one of node" in closest("zzz", ["node"])


@pytest.mark.parametrize("kind", [0, 1, 2])
@pytest.mark.parametrize("value", [True, False])
def test_a_truth_value_is_no_number(kind: int, value: bool) -> None:  # noqa: FBT001 - the value
    """The value ``true`` of JSON must not set a top speed of 1 m/s."""
    number = reported(kind, 0, *(HALF, HALF, 0, TWO))
    with pytest.raises(ParameterError, match=rf"{value} is not a number"):
        number.raw(value)


def test_numbers_that_json_lacks_are_texts_in_it() -> None:
    odd = reported(2, 0, *(0x7FC0_0000, HALF, 0xFF80_0000, 0x7F80_0000))
    text = json.dumps(odd.to_dict(), allow_nan=False)
    fields = json.loads(text)
    assert (fields["value"], fields["low"], fields["high"]) == ("nan", "-inf", "inf")
    again = Parameter.from_dict(fields)
    assert math.isnan(again.value)
    assert (again.default, again.low, again.high) == (0.5, -math.inf, math.inf)
    with pytest.raises(ParameterError, match="invalid parameter object"):
        Parameter.from_dict(fields | {"value": "fast"})
