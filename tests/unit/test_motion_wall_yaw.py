"""Lines fitted to the infrared's hits, and the heading errors that walls seen again tell."""

from __future__ import annotations

import math
import random

import pytest

from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.motion.wall_yaw import (
    MAX_REFERENCES,
    MIN_HITS,
    MIN_SPAN_M,
    LineTracker,
    WallYaw,
    YawFix,
    fit_line,
)

MODEL = RobotModel()
SIDE = MODEL.infrared_left
STEP_M = 0.01
"""Between two readings: 20 Hz at cruise speed."""
DEGREE = math.radians(1.0)
SURE = 0.0
"""Variance of a heading that is exactly known."""
DOUBT = math.radians(2.0) ** 2


def wall(
    span_m: float,
    angle_rad: float = 0.0,
    *,
    noise_m: float = 0.0,
    bow_m: float = 0.0,
    seed: int = 0,
) -> list[tuple[float, float]]:
    """Hits every centimetre; ``bow_m``: how far the middle stands out."""
    rng = random.Random(seed)
    count = round(span_m / STEP_M) + 1
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    hits = []
    for i in range(count):
        along = i * STEP_M - span_m / 2
        across = rng.gauss(0, noise_m) + bow_m * (1 - (2 * along / span_m) ** 2)
        hits.append((3 + along * c - across * s, -2 + along * s + across * c))
    return hits


# ---- the line --------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [-89, -45, -3, 0, 17, 45, 88])
def test_a_line_is_found_at_any_angle(degrees: int) -> None:
    line = fit_line(wall(0.3, degrees * DEGREE))
    assert line is not None
    assert math.remainder(line.angle_rad - degrees * DEGREE, math.pi) == pytest.approx(0, abs=1e-9)
    assert line.span_m == pytest.approx(0.3)


def test_noise_is_averaged_and_admitted() -> None:
    """The error is as large as the line says, over many draws."""
    ratios = []
    for seed in range(200):
        line = fit_line(wall(0.3, 0.2, noise_m=0.0015, seed=seed))
        if line is not None:
            ratios.append((line.angle_rad - 0.2) / line.sigma_rad)
    assert len(ratios) > 190
    rms = math.sqrt(sum(r * r for r in ratios) / len(ratios))
    assert 0.3 < rms < 1.0, "never better than it says"
    assert max(map(abs, ratios)) < 3.0


def test_a_longer_line_is_better_known() -> None:
    short, long = fit_line(wall(0.12)), fit_line(wall(0.5))
    assert short is not None
    assert long is not None
    assert long.sigma_rad < short.sigma_rad


def test_a_bow_is_no_wall() -> None:
    assert fit_line(wall(0.2, bow_m=0.0005)) is not None
    assert fit_line(wall(0.2, bow_m=0.006)) is None
    assert fit_line(wall(0.2, bow_m=-0.006)) is None


@pytest.mark.parametrize("radius_m", [0.05, 0.15, 0.35])
def test_a_column_is_no_wall(radius_m: float) -> None:
    """As the infrared sees it going by, with its limited range."""
    for reach_m in (0.12, 0.2, 0.3):
        half = min(reach_m / 2, 0.9 * radius_m)
        hits = [
            (x, math.sqrt(radius_m**2 - x * x)) for x in (-half + i * half / 10 for i in range(21))
        ]
        if 2 * half >= MIN_SPAN_M:
            assert fit_line(hits) is None


def test_rough_hits_are_no_wall() -> None:
    assert fit_line(wall(0.3, noise_m=0.01)) is None


def test_too_few_or_too_short() -> None:
    assert fit_line([]) is None
    assert fit_line([(0.1 * i, 0.0) for i in range(MIN_HITS - 1)]) is None
    assert fit_line([(0.0, 0.0)] * 20) is None
    assert fit_line([(0.005 * i, 0.0) for i in range(20)]) is None


# ---- stretches -------------------------------------------------------------------------


def test_a_step_in_range_ends_a_stretch() -> None:
    tracker = LineTracker(SIDE)
    lines = [
        tracker.add(Pose2(i * STEP_M, 0, 0), 0.10 if i < 20 else 0.14, straight=True)
        for i in range(40)
    ]
    found = [(i, line) for i, line in enumerate(lines) if line is not None]
    assert [i for i, _ in found] == [20]
    assert found[0][1].span_m == pytest.approx(0.19)
    rest = tracker.end()
    assert rest is not None
    assert rest.span_m == pytest.approx(0.19)


def test_a_turn_or_nothing_seen_ends_a_stretch() -> None:
    for straight, range_m in ((False, 0.1), (True, None)):
        tracker = LineTracker(SIDE)
        for i in range(20):
            assert tracker.add(Pose2(i * STEP_M, 0, 0), 0.1, straight=True) is None
        assert tracker.add(Pose2(0.2, 0, 0), range_m, straight=straight) is not None
        assert tracker.end() is None, "nothing is kept"


def test_a_long_wall_comes_in_stretches() -> None:
    tracker = LineTracker(SIDE)
    lines = [tracker.add(Pose2(i * STEP_M, 0, 0), 0.1, straight=True) for i in range(200)]
    assert sum(line is not None for line in lines) == 3


# ---- walls seen again ------------------------------------------------------------------


class Corridor:
    """Drives past walls: the wall at an angle in the world, the estimate's heading off by some."""

    def __init__(self, seed: int = 0) -> None:
        self.walls = WallYaw(MODEL)
        self.rng = random.Random(seed)

    def past(  # noqa: PLR0913 - what a pass by a wall can be
        self,
        error_rad: float = 0.0,
        *,
        wall_rad: float = 0.0,
        heading_rad: float | None = None,
        length_m: float = 0.4,
        variance: float = SURE,
        noise_m: float = 0.0,
        v_m_s: float = 0.2,
        yaw_rate_rad_s: float = 0.0,
    ) -> list[YawFix]:
        """One pass along a wall on the left; the estimate believes ``error_rad`` too much."""
        heading = wall_rad if heading_rad is None else heading_rad
        fixes = []
        slope = math.tan(wall_rad - heading)
        for i in range(round(length_m / STEP_M) + 1):
            along = i * STEP_M
            believed = heading + error_rad
            pose = Pose2(along * math.cos(believed), along * math.sin(believed), believed)
            left_m = 0.15 + slope * along + self.rng.gauss(0, noise_m)
            fixes += self.walls.update(pose, v_m_s, yaw_rate_rad_s, left_m, None, variance)
        fixes += self.walls.update(Pose2(0, 0, 0), v_m_s, 0.0, None, None, variance)
        return fixes


def test_the_first_wall_is_the_reference() -> None:
    corridor = Corridor()
    assert corridor.walls.grid_rad is None
    assert corridor.past() == []
    assert corridor.walls.grid_rad == pytest.approx(0.0, abs=1e-9)


def test_a_short_wall_is_no_reference_but_corrects() -> None:
    corridor = Corridor()
    corridor.past(length_m=0.15)
    assert corridor.walls.grid_rad is None
    corridor.past(length_m=0.4)
    assert len(corridor.past(DEGREE, length_m=0.15, variance=DOUBT)) == 1


@pytest.mark.parametrize("quarter", [-1, 0, 1, 2])
@pytest.mark.parametrize("degrees", [-3.0, -0.5, 0.5, 3.0])
def test_drift_is_told_by_walls_at_right_angles(quarter: int, degrees: float) -> None:
    corridor = Corridor()
    corridor.past()
    (fix,) = corridor.past(degrees * DEGREE, wall_rad=quarter * math.pi / 2, variance=DOUBT)
    assert fix.error_rad == pytest.approx(degrees * DEGREE, abs=1e-6)
    assert 0 < math.sqrt(fix.variance) < DEGREE


def test_driving_askew_does_not_matter() -> None:
    corridor = Corridor()
    corridor.past(heading_rad=0.1)
    (fix,) = corridor.past(DEGREE, heading_rad=-0.08, variance=DOUBT)
    assert fix.error_rad == pytest.approx(DEGREE, abs=1e-6)


def test_the_gate_depends_on_the_doubt() -> None:
    sure, unsure = Corridor(), Corridor()
    for corridor in (sure, unsure):
        corridor.past()
    assert sure.past(3 * DEGREE, variance=SURE) == [], "it cannot have drifted so far"
    assert len(unsure.past(3 * DEGREE, variance=DOUBT)) == 1


def test_what_is_neither_seen_again_nor_new_is_passed_over() -> None:
    corridor = Corridor()
    corridor.past()
    for degrees in (5.5, 7.0, 9.5):
        assert corridor.past(wall_rad=degrees * DEGREE, variance=DOUBT) == []
    # and became no reference: an equal one would correct now
    assert corridor.past(wall_rad=7.0 * DEGREE, variance=DOUBT) == []
    (fix,) = corridor.past(2 * DEGREE, variance=DOUBT)
    assert fix.error_rad == pytest.approx(2 * DEGREE, abs=1e-6)


def test_an_oblique_wall_is_a_reference_of_its_own() -> None:
    corridor = Corridor()
    corridor.past()
    assert corridor.past(wall_rad=30 * DEGREE, variance=DOUBT) == [], "new"
    (fix,) = corridor.past(DEGREE, wall_rad=30 * DEGREE)
    assert fix.error_rad == pytest.approx(DEGREE, abs=0.2 * DEGREE)
    assert corridor.walls.grid_rad == pytest.approx(0.0, abs=1e-9), "the grid is the first wall's"


def test_references_are_bounded() -> None:
    corridor = Corridor()
    for i in range(60):
        corridor.past(wall_rad=i * 7 * DEGREE)
    assert len(corridor.walls._references) <= MAX_REFERENCES  # noqa: SLF001 - a bound on memory


def test_columns_on_the_way_do_not_corrupt() -> None:
    """Round things between the first sight of a wall and the second change nothing."""
    corridor = Corridor()
    corridor.past(noise_m=0.0015)
    grid = corridor.walls.grid_rad
    for radius in (0.06, 0.1, 0.15, 0.25):
        for i in range(-30, 31):
            x = i * STEP_M
            inside = radius**2 - x * x
            left = 0.1 + radius - math.sqrt(inside) if inside > 0 else None
            seen = left if left is not None and left < 0.2 else None
            assert corridor.walls.update(Pose2(x, 0, 0), 0.2, 0.0, seen, None, DOUBT) == []
    assert corridor.walls.grid_rad == grid
    (fix,) = corridor.past(DEGREE, noise_m=0.0015, variance=DOUBT)
    assert fix.error_rad == pytest.approx(DEGREE, abs=0.5 * DEGREE)


def test_turning_or_standing_fits_nothing() -> None:
    corridor = Corridor()
    assert corridor.past(yaw_rate_rad_s=0.2) == []
    assert corridor.walls.grid_rad is None
    corridor.past(v_m_s=0.0)
    assert corridor.walls.grid_rad is None


def test_a_well_known_reference_is_not_moved_by_doubtful_headings() -> None:
    corridor = Corridor()
    for _ in range(10):
        corridor.past()
    for _ in range(10):
        corridor.past(2 * DEGREE, variance=DOUBT)
    assert corridor.walls.grid_rad == pytest.approx(0.0, abs=0.25 * DEGREE)


def test_the_right_side_sees_as_well() -> None:
    walls = WallYaw(MODEL)
    for error in (0.0, DEGREE):
        fixes = []
        for i in range(40):
            pose = Pose2(i * STEP_M * math.cos(error), i * STEP_M * math.sin(error), error)
            fixes += walls.update(pose, 0.2, 0.0, None, 0.12, DOUBT)
        fixes += walls.update(Pose2(0, 0, 0), 0.2, 0.0, None, None, DOUBT)
    assert [fix.error_rad for fix in fixes] == [pytest.approx(DEGREE, abs=0.05 * DEGREE)]
