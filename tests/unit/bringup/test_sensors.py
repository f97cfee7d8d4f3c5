"""Calibration of gyro and range sensors from handmade values."""

from __future__ import annotations

import math
import random

import pytest

from bridge.bringup.gyro import AxisBias, biases, complaint
from bridge.bringup.ranging import Point, fit, point
from bridge.bringup.wheel_step import as_text, judge_step, wheel_speeds, wheel_steps
from bridge.errors import BridgeError


def at_rest(
    seconds: float, bias: float, sigma: float = 0.0005
) -> list[tuple[float, tuple[float, float, float]]]:
    rng = random.Random(4)
    return [
        (0.01 * i, (rng.gauss(0.0, sigma), rng.gauss(-0.01, sigma), rng.gauss(bias, sigma)))
        for i in range(round(100 * seconds))
    ]


def test_the_bias_is_the_mean_and_as_sure_as_its_noise_allows() -> None:
    x, y, z = biases(at_rest(20.0, 0.02))
    assert [axis.name for axis in (x, y, z)] == ["x", "y", "z"]
    assert z.bias_rad_s == pytest.approx(0.02, abs=4 * 0.0005 / math.sqrt(2000))
    assert y.bias_rad_s == pytest.approx(-0.01, abs=5e-5)
    assert z.sigma_rad_s == pytest.approx(0.0005 / math.sqrt(2000), rel=0.5)
    assert complaint(z) is None


def test_a_robot_that_is_touched_is_not_measured() -> None:
    shaken = at_rest(3.0, 0.0)
    shaken[150] = (1.5, (0.0, 0.0, 1.0))
    with pytest.raises(BridgeError, match="was moved: the z rate"):
        biases(shaken)
    with pytest.raises(BridgeError, match="only 50 gyro samples"):
        biases(at_rest(0.5, 0.0))


def test_a_bias_beyond_the_data_sheet_is_no_bias() -> None:
    printed = complaint(AxisBias("z", math.radians(25.0), 0.0, 0.0))
    assert printed is not None
    assert "+25.0 °/s" in printed


def test_two_distances_give_scale_and_offset() -> None:
    """A reading is 0.98 times the distance plus 4 mm, so the distance is (reading - 0.004)/0.98."""
    points = [Point(d, 0.98 * d + 0.004, 0.0, 40) for d in (0.2, 0.5, 1.0)]
    found = fit(points)
    assert found.scale == pytest.approx(1.0 / 0.98)
    assert found.offset_m == pytest.approx(-0.004 / 0.98)
    assert found.after_m < 1e-12
    assert found.before_m == pytest.approx(
        math.sqrt(sum((0.004 - 0.02 * d) ** 2 for d in (0.2, 0.5, 1.0)) / 3)
    )


def test_the_devices_own_correction_is_included() -> None:
    """The raw value is r, the device sends 1.1 r - 0.01, the true distance is 1.05 r + 0.002."""
    points = [Point(1.05 * r + 0.002, 1.1 * r - 0.01, 0.0, 40) for r in (0.1, 0.3)]
    found = fit(points, 1.1, -0.01)
    assert found.scale == pytest.approx(1.05)
    assert found.offset_m == pytest.approx(0.002)


def test_one_distance_gives_an_offset_alone() -> None:
    found = fit([Point(0.1, 0.107, 0.0, 40)])
    assert found.scale == 1.0
    assert found.offset_m == pytest.approx(-0.007)


def test_impossible_values_are_rejected() -> None:
    with pytest.raises(BridgeError, match="from the face of the sensor"):
        fit([Point(0.1, 0.2, 0.0, 40), Point(0.2, 0.5, 0.0, 40)])
    with pytest.raises(BridgeError, match="the same at every distance"):
        fit([Point(0.1, 0.2, 0.0, 40), Point(0.3, 0.2, 0.0, 40)])
    with pytest.raises(BridgeError, match="no distance"):
        fit([])


def test_a_stray_echo_is_not_counted() -> None:
    readings = [0.50, 0.501, 0.499, 0.50, 1.9, None, 0.50]
    found = point(0.5, readings)
    assert found.read_m == pytest.approx(0.5, abs=3e-4)
    assert found.readings == 5
    with pytest.raises(BridgeError, match="only 2 of 8 readings are valid"):
        point(0.5, [0.5, 0.5, *[None] * 6])


# ---- step response of a wheel -----------------------------------------------------------


def counted(speed: float, other: float, *, gain: float = 1000.0) -> list[tuple[float, int, int]]:
    """Return counts of two wheels that start at 1 s: one at once, one with a lag of 0.1 s."""
    found = []
    for i in range(300):
        t = 0.01 * i
        since = max(0.0, t - 1.0)
        lagged = since - 0.1 * (1.0 - math.exp(-since / 0.1))
        found.append((t, round(gain * speed * since) & 0xFFFF, round(gain * other * lagged)))
    return found


def test_a_steps_figures_are_those_of_the_curve() -> None:
    left, right = wheel_steps(counted(0.2, 0.2), 1.0, 0.2, 0.001)
    assert left.steady_m_s == pytest.approx(0.2, rel=0.03)
    assert left.rise_s <= 0.05
    assert right.rise_s == pytest.approx(0.1 * math.log(9.0), abs=0.03)  # for a first-order lag
    assert left.settled_s < right.settled_s
    assert judge_step(left).ok is True
    picture = as_text((left, right))
    assert "+0.200" in picture
    assert {"l", "r", "x"} & set(picture)


def test_a_wheel_that_falls_short_or_runs_away_is_named() -> None:
    slow, still = wheel_steps(counted(0.15, 0.0), 1.0, 0.2, 0.001)
    assert "does not reach" in judge_step(slow).advice
    assert "does not follow" in judge_step(still).text
    backwards, _ = wheel_steps(counted(-0.5, 0.0), 1.0, 0.2, 0.001)
    assert "runs away" in judge_step(backwards).text


def test_speeds_unwrap_counters() -> None:
    samples = [(0.01 * i, (65500 + 10 * i) & 0xFFFF, (100 - 10 * i) & 0xFFFF) for i in range(20)]
    for _, left, right in wheel_speeds(samples, 0.001):
        assert left == pytest.approx(1.0)
        assert right == pytest.approx(-1.0)
