"""UMBmark's equations, compared with a square in closed form that shares no code with them."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bridge.bringup.umbmark import (
    Benchmark,
    Correction,
    SquareRun,
    benchmark,
    borenstein,
    refine,
    refutation,
    scatter_m,
    straight_scale,
)
from bridge.motion.robot_model import RobotModel

MODEL = RobotModel()
SIDE_M = 2.0
PARTS = 40


def true_square(ratio: float, base: float, *, clockwise: bool, scale: float = 1.0) -> SquareRun:
    """Return a square drive with wrong wheel sizes that looks exact in the odometry.

    The positions are complex numbers, and each leg is an exact arc. The host's odometry is not
    used.
    """
    per_count = math.pi * MODEL.wheel_diameter_m / MODEL.counts_per_turn
    left_m = scale * per_count * 2.0 / (1.0 + ratio)
    right_m = scale * per_count * 2.0 * ratio / (1.0 + ratio)
    base_m = base * MODEL.wheel_base_m
    side = SIDE_M / per_count
    turn = 0.5 * math.pi * 0.5 * MODEL.wheel_base_m / per_count
    sign = -1 if clockwise else 1
    place, heading = 0j, 0.0
    counts: list[tuple[int, int]] = []
    for _ in range(4):
        for left, right in ((side, side), (-sign * turn, sign * turn)):
            whole = [round(n * (i + 1) / PARTS) for n in (left, right) for i in range(PARTS)]
            lefts, rights = [0, *whole[:PARTS]], [0, *whole[PARTS:]]
            for i in range(PARTS):
                step = lefts[i + 1] - lefts[i], rights[i + 1] - rights[i]
                counts.append(step)
                way_left, way_right = left_m * step[0], right_m * step[1]
                angle = (way_right - way_left) / base_m
                way = 0.5 * (way_left + way_right)
                # The chord of an arc with this length is the integral of e^(iθ), as a complex
                # number.
                chord = (
                    way
                    if angle == 0.0
                    else way * ((complex(math.cos(angle), math.sin(angle)) - 1.0) / (1j * angle))
                )
                place += chord * complex(math.cos(heading), math.sin(heading))
                heading += angle
    return SquareRun(clockwise, tuple(counts), place.real, place.imag)


def both(ratio: float, base: float) -> list[SquareRun]:
    return [true_square(ratio, base, clockwise=cw) for cw in (True, False)]


def test_a_perfect_robot_ends_where_it_began() -> None:
    runs = both(1.0, 1.0)
    assert benchmark(MODEL, runs).worst_m < 1e-6
    found = refine(MODEL, runs, borenstein(MODEL, runs, SIDE_M))
    assert found.wheel_ratio == pytest.approx(1.0, abs=1e-7)
    assert found.base_factor == pytest.approx(1.0, abs=1e-7)


def test_the_closed_form_is_borensteins_to_the_first_order() -> None:
    """For small errors and nearly equal wheels, α = 90° (1 - 1/E_b) and β = L (E_d - 1)/b."""
    wide = borenstein(MODEL, both(1.0, 1.001), SIDE_M)
    assert wide.alpha_rad == pytest.approx(0.5 * math.pi * 0.001, rel=0.02)
    assert wide.beta_rad == pytest.approx(0.0, abs=1e-5)
    assert wide.base_factor == pytest.approx(1.001, abs=3e-5)
    uneven = borenstein(MODEL, both(1.0005, 1.0), SIDE_M)
    assert uneven.beta_rad == pytest.approx(SIDE_M * 0.0005 / MODEL.wheel_base_m, rel=0.02)
    assert uneven.wheel_ratio == pytest.approx(1.0005, abs=1e-5)


def test_signs_of_the_return_errors() -> None:
    """The signs must equal those in the figures of the UMBmark paper for each single error."""
    a = 0.5 * math.pi * 0.002  # the base is too wide, so the robot turns too little
    wide = benchmark(MODEL, both(1.0, 1.002))
    for got in (wide.clockwise[0], wide.counter_clockwise[0]):
        assert got == pytest.approx(-2.0 * SIDE_M * a, rel=0.05)
    b = SIDE_M * 0.0005 / MODEL.wheel_base_m
    uneven = benchmark(MODEL, both(1.0005, 1.0))
    assert uneven.clockwise[0] == pytest.approx(-2.0 * SIDE_M * b, rel=0.05)
    assert uneven.counter_clockwise[0] == pytest.approx(2.0 * SIDE_M * b, rel=0.05)


@pytest.mark.parametrize(
    ("ratio", "base"),
    [(1.01, 1.0), (1.0, 0.99), (1.01, 1.02), (0.985, 1.01), (0.99, 0.97), (1.003, 0.998)],
)
def test_errors_of_per_cents_are_recovered_exactly(ratio: float, base: float) -> None:
    runs = both(ratio, base)
    first = borenstein(MODEL, runs, SIDE_M)
    found = refine(MODEL, runs, first)
    assert found.wheel_ratio == pytest.approx(ratio, rel=1e-6)
    assert found.base_factor == pytest.approx(base, rel=1e-6)
    before = benchmark(MODEL, runs).worst_m
    assert benchmark(first.applied_to(MODEL), runs).worst_m < 0.35 * before
    assert benchmark(found.applied_to(MODEL), runs).worst_m < 1e-5 * before


def test_a_measuring_error_of_millimetres_costs_hundredths_of_a_per_cent() -> None:
    runs = both(1.006, 1.01)
    off = [r._replace(end_x_m=r.end_x_m + 0.003, end_y_m=r.end_y_m - 0.002) for r in runs]
    found = refine(MODEL, off, borenstein(MODEL, off, SIDE_M))
    assert found.wheel_ratio == pytest.approx(1.006, rel=2e-4)
    assert found.base_factor == pytest.approx(1.01, rel=1e-3)


def test_a_correction_is_on_top_of_the_one_before() -> None:
    reported = replace(MODEL, wheel_ratio=1.002, wheel_base_m=0.231)
    after = Correction(1.001, 1.01, 0.0, 0.0).applied_to(reported)
    assert after.wheel_ratio == pytest.approx(1.002 * 1.001)
    assert after.wheel_base_m == pytest.approx(0.231 * 1.01)
    # the mean wheel diameter is unchanged
    mean = 0.5 * (after.left_metres_per_count + after.right_metres_per_count)
    assert mean == pytest.approx(MODEL.metres_per_count)


def test_one_direction_is_not_enough() -> None:
    with pytest.raises(ValueError, match="both directions"):
        borenstein(MODEL, [true_square(1.0, 1.0, clockwise=True)], SIDE_M)


def test_the_scale_of_a_straight_path() -> None:
    counts = [(1560, 1560)] * 10  # ten turns of each wheel
    reported_m = 10.0 * math.pi * MODEL.wheel_diameter_m
    assert straight_scale(MODEL, counts, 1.01 * reported_m) == pytest.approx(1.01)
    with pytest.raises(ValueError, match="did not move"):
        straight_scale(MODEL, [(0, 0)], 1.0)


def missing(worst_mm: float) -> Benchmark:
    return Benchmark((0.001 * worst_mm, 0.0), (0.0, 0.0005 * worst_mm))


@pytest.mark.parametrize(
    ("before", "after", "verified", "scatter", "printed"),
    [
        (300.0, 39.9, 122.8, 0.0, "new squares is 122.8 mm; predicted were 39.9 mm"),
        (300.0, 39.9, 84.0, 0.0, None),
        (300.0, 39.9, 122.8, 30.0, None),  # three standard errors are 90 mm
        (300.0, 2.0, 50.0, 15.0, None),
        (300.0, 2.0, 53.0, 15.0, "at most 52.0 mm would confirm that"),
        (20.0, 15.0, 26.0, 0.0, "new squares is 26.0 mm; with the old values it was 20.0 mm"),
        (3.0, 1.0, 4.5, 0.0, None),  # a tape measure cannot distinguish these
        (0.0, 0.0, 0.0, 0.0, None),
    ],
)
def test_a_result_is_refuted_by_squares_that_miss_by_more_than_scatter(
    before: float, after: float, verified: float, scatter: float, printed: str | None
) -> None:
    found = refutation(missing(before), missing(after), missing(verified), 0.001 * scatter)
    assert (found is None) is (printed is None)
    assert printed is None or printed in (found or "")


def test_the_scatter_is_that_about_the_centre_of_each_direction() -> None:
    def ended(x_m: float, *, clockwise: bool) -> SquareRun:
        return SquareRun(clockwise, (), x_m, 0.0)

    one_each = [ended(0.5, clockwise=True), ended(-0.5, clockwise=False)]
    assert scatter_m(MODEL, one_each) == 0.0, "not known"
    runs = [*one_each, ended(0.52, clockwise=True), ended(-0.46, clockwise=False)]
    assert scatter_m(MODEL, runs) == pytest.approx(math.sqrt((0.0002 + 0.0008) / 2))
