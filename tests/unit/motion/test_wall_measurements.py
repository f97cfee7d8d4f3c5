"""Measurements of walls: detection of straight segments, their place and their uncertainty."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.relocalise import Relocaliser
from bridge.motion.estimation.wall_measurements import (
    WANDER_BOW,
    FrontMeasurements,
    LineMeasurement,
    MeasurementTuning,
    SideMeasurement,
)
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.walled import DEGREE, ORIGIN

MODEL = RobotModel()
TUNING = MeasurementTuning()


def drive_by(  # noqa: PLR0913 - a wall and a drive
    wall_y: float,
    slope_rad: float,
    *,
    path_m: float = 0.3,
    noise_m: float = 0.0,
    bow_m: float = 0.0,
    wander_m_sqrt_m: float = 0.0,
    seed: int = 0,
) -> LineMeasurement | None:
    """Drive past a wall on the left whose place at x = 0 is ``wall_y``.

    A reading each centimetre.
    """
    rng = random.Random(seed)
    mount = MODEL.infrared_left
    side = SideMeasurement(mount)
    pose = ORIGIN
    for i in range(round(path_m / 0.01) + 1):
        pose = Pose2(0.01 * i, 0.0, 0.0)
        x = pose.x_m + mount.x_m
        bow = bow_m * (1.0 - (2.0 * 0.01 * i / path_m - 1.0) ** 2)
        range_m = wall_y + x * math.tan(slope_rad) - bow - mount.y_m + rng.gauss(0, noise_m)
        side.add(pose, range_m, moving=True, steady=True, wander_m_sqrt_m=wander_m_sqrt_m)
    return side.add(pose, None, moving=True, steady=True, wander_m_sqrt_m=wander_m_sqrt_m)


@pytest.mark.parametrize("degrees", [-6.0, 0.0, 4.0])
def test_a_wall_observation_is_the_walls_line_from_the_last_place(degrees: float) -> None:
    measurement = drive_by(0.2, degrees * DEGREE)
    assert measurement is not None
    assert measurement.normal_rad == pytest.approx(math.pi / 2 + degrees * DEGREE, abs=1e-6)
    # the wall through (0, 0.2) at its slope, seen from (0.3, 0)
    expected = (0.2 + 0.3 * math.tan(degrees * DEGREE)) * math.cos(degrees * DEGREE)
    assert measurement.distance_m == pytest.approx(expected, abs=1e-6)
    assert measurement.span_m == pytest.approx(0.3 / math.cos(degrees * DEGREE), abs=1e-6)
    # to the left of the robot the wall's direction runs backwards: the segment lies behind
    assert measurement.high_m > 0.2
    assert measurement.low_m > -0.1


def test_a_wall_observations_variance_is_that_of_its_errors() -> None:
    """The many noisy passes are at 10 cm, where the two sigmas of 1.5 and 1.2 mm add."""
    measurements = [drive_by(0.2, 0.0, noise_m=0.0019, seed=seed) for seed in range(300)]
    seen = [s for s in measurements if s is not None]
    assert len(seen) > 295
    turn = np.array([s.normal_rad - math.pi / 2 for s in seen])
    off = np.array([s.distance_m - 0.2 for s in seen])
    ahead = 0.10  # from the robot's place at the end to the middle of the segment
    flat = TUNING.flat_m**2 + (ahead * TUNING.flat_rad) ** 2  # averaging cannot remove this
    var_turn = float(np.mean([s.var_normal for s in seen])) - TUNING.flat_rad**2
    var_off = float(np.mean([s.var_distance for s in seen])) - flat
    assert 0.7 < float((turn**2).mean()) / var_turn < 1.3
    assert 0.7 < float((off**2).mean()) / var_off < 1.3
    assert float((turn * off).mean()) * float(np.mean([s.covar for s in seen])) > 0.0


def test_curves_jumps_and_short_stretches_are_no_walls() -> None:
    assert drive_by(0.2, 0.0, bow_m=0.006) is None
    assert drive_by(0.2, 0.0, path_m=0.07) is None
    side = SideMeasurement(MODEL.infrared_left)
    for i in range(12):
        assert side.add(Pose2(0.01 * i, 0, 0), 0.10, moving=True, steady=True) is None
    assert side.add(Pose2(0.12, 0, 0), 0.20, moving=True, steady=True) is None, "or one is noise"
    first = side.add(Pose2(0.13, 0, 0), 0.20, moving=True, steady=True)
    assert first is not None
    assert first.span_m == pytest.approx(0.11)


def test_a_reading_far_off_is_dropped() -> None:
    side = SideMeasurement(MODEL.infrared_left)
    for i in range(31):
        range_m = 0.13 if i in {7, 15, 23} else 0.10
        assert side.add(Pose2(0.01 * i, 0, 0), range_m, moving=True, steady=True) is None
    measurement = side.add(Pose2(0.3, 0, 0), None, moving=True, steady=True)
    assert measurement is not None
    assert measurement.span_m == pytest.approx(0.3)
    assert measurement.normal_rad == pytest.approx(math.pi / 2, abs=1e-6)


def test_a_sensor_four_times_as_noisy_still_measures_walls_with_their_uncertainty() -> None:
    measurements = [drive_by(0.2, 0.0, noise_m=0.0076, seed=seed) for seed in range(300)]
    seen = [s for s in measurements if s is not None and s.span_m > 0.2]
    assert len(seen) > 240
    turn = np.array([s.normal_rad - math.pi / 2 for s in seen])
    assert 0.5 < float((turn**2).mean()) / float(np.mean([s.var_normal for s in seen])) < 2.0


def test_a_short_line_is_as_uncertain_as_the_sensor_was_before() -> None:
    """The residuals of few hits may be small by chance."""
    rng = random.Random(3)
    side = SideMeasurement(MODEL.infrared_left)

    def passes(count: int, hits: int) -> list[LineMeasurement]:
        found = []
        for _ in range(count):
            for i in range(hits):
                range_m = 0.1 + rng.gauss(0.0, 0.0076)
                side.add(Pose2(0.01 * i, 0, 0), range_m, moving=True, steady=True)
            line = side.add(Pose2(0.01 * hits, 0, 0), None, moving=True, steady=True)
            if line is not None and line.span_m > 0.01 * hits - 0.03:
                found.append(line)
        return found

    passes(20, 31)
    short = passes(100, 12)
    sigmas = np.sqrt([line.var_normal for line in short])
    assert len(short) > 80, "and noise ends no line"
    assert sigmas.min() > 0.75 * float(np.median(sigmas))


def test_a_wavy_surface_is_no_wall_however_noisy_the_sensor() -> None:
    rng = random.Random(5)
    for noise_m in (0.0019, 0.005):
        side = SideMeasurement(MODEL.infrared_left)
        for i in range(31):
            range_m = 0.12 + 0.025 * math.sin(i / 5.0) + rng.gauss(0.0, noise_m)
            side.add(Pose2(0.01 * i, 0, 0), range_m, moving=True, steady=True)
        assert side.add(Pose2(0.3, 0, 0), None, moving=True, steady=True) is None


@pytest.mark.parametrize(
    ("bow_m", "path_m", "wander_m_sqrt_m", "flat"),
    [
        # 31 readings of 1.9 mm show a bow to 1.1 mm; lateral slip makes it worse
        (0.004, 0.3, 0.0, False),
        (0.004, 0.3, 0.0026, False),
        (0.004, 0.3, 0.0031, True),
        # 21 show it to 1.2 mm
        (0.005, 0.2, 0.0045, False),
        (0.005, 0.2, 0.0051, True),
        (-0.005, 0.2, 0.0036, False),
        (-0.005, 0.2, 0.0051, True),
    ],
)
def test_with_lateral_slip_a_flat_wall_seems_bowed(
    bow_m: float, path_m: float, wander_m_sqrt_m: float, *, flat: bool
) -> None:
    measurement = drive_by(0.2, 0.0, bow_m=bow_m, path_m=path_m, wander_m_sqrt_m=wander_m_sqrt_m)
    assert (measurement is not None) is flat


@pytest.mark.parametrize(("slip_m_sqrt_m", "known"), [(0.001, 0), (0.002, 0), (0.0038, 1)])
def test_lateral_slip_is_as_the_wheels_show(slip_m_sqrt_m: float, known: int) -> None:
    """A bow of 3.5 mm over 0.3 m is possible on a slippery floor, but not on a good one."""
    estimator = PoseEstimator(MODEL, ORIGIN)
    relocaliser = Relocaliser(MODEL, estimator)
    counts = 0.0
    for tick in range(201):
        driving = 50 <= tick <= 200
        counts += driving * 0.002 / MODEL.metres_per_count
        estimator.on_imu(0.01 * tick, 0.0)
        estimator.on_encoders(0.01 * tick, int(counts), int(counts))
        estimator.ekf.slip_monitor.variance_per_m = slip_m_sqrt_m**2
        if driving and tick % 5 == 0:
            share = 2.0 * (tick - 50) / 150 - 1.0
            range_m = 0.1 - 0.0035 * (1.0 - share * share)
            relocaliser.update(
                None, range_m, None, bumper_left=False, bumper_right=False, t_s=0.01 * tick
            )
    relocaliser.update(None, None, None, bumper_left=False, bumper_right=False, t_s=2.0)
    assert len(relocaliser.walls.walls) == known


def test_a_brownian_path_bows_as_much_as_is_thought() -> None:
    rng = np.random.default_rng(5)
    x = np.linspace(0.0, 1.0, 201)
    paths = np.cumsum(rng.normal(0.0, math.sqrt(x[1]), (4000, x.size)), axis=1)
    bows = np.polyfit(x, paths.T, 2)[0] / 4.0
    assert float(bows.std()) == pytest.approx(WANDER_BOW, rel=0.05)


def test_readings_in_a_fast_turn_are_skipped_and_end_nothing() -> None:
    side = SideMeasurement(MODEL.infrared_left)
    for i in range(31):
        quick = i % 5 == 3
        range_m = 0.15 if quick else 0.10
        pose = Pose2(0.01 * i, 0, 0)
        assert side.add(pose, range_m, moving=True, steady=not quick) is None
    measurement = side.add(pose, 0.10, moving=False, steady=True)  # it stands: the segment ends
    assert measurement is not None
    assert measurement.span_m == pytest.approx(0.30)
    assert measurement.normal_rad == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("gap_m", "turn_deg", "joined"),
    [
        (0.05, 0.0, True),
        (0.05, 12.0, True),
        (0.12, 0.0, False),
        (0.05, 30.0, False),
    ],
)
def test_after_a_long_or_wide_turn_another_wall_may_be_abeam(
    gap_m: float, turn_deg: float, *, joined: bool
) -> None:
    side = SideMeasurement(MODEL.infrared_left)
    for i in range(16):
        side.add(Pose2(0.01 * i, 0, 0), 0.10, moving=True, steady=True)
    assert side.add(Pose2(0.17, 0, 0), 0.10, moving=True, steady=False) is None
    measurement = side.add(
        Pose2(0.15 + gap_m, 0, turn_deg * DEGREE), 0.10, moving=True, steady=True
    )
    assert (measurement is None) is joined


def test_the_front_is_seen_from_where_the_robot_is_now() -> None:
    front = FrontMeasurements(MODEL.ultrasonic)
    found = [front.add(Pose2(0.01 * i, 0, 0), 0.8 - 0.01 * i, steady=True) for i in range(5)]
    assert found[:4] == [None] * 4
    assert found[4] is not None
    assert found[4].range_m == pytest.approx(0.76)
    standing = [front.add(Pose2(0.04, 0, 0), 0.76, steady=True) for _ in range(20)]
    assert standing == [None] * 20, "standing, its errors would repeat"
    edge = [0.7, 0.69, 0.9, 0.89, 0.88]
    moved = [front.add(Pose2(0.1 + 0.01 * i, 0, 0), r, steady=True) for i, r in enumerate(edge)]
    assert moved == [None] * 5
