"""Ultrasonic and infrared rangers, compared with closed forms and their datasheets."""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import fmean

import numpy as np
import pytest

from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from sim_device.noise import NOISE_LEVELS, Draws, NoiseLevel
from sim_device.sensors.infrared import Infrared, Reflectances, metres, volts
from sim_device.sensors.rangers import Rangers
from sim_device.sensors.ultrasonic import Ultrasonic
from support.sim_body import box, room, world

NONE = NOISE_LEVELS["none"]
MODEL = RobotModel()
CENTRE = world(room((10.0, 10.0, 0.0)))
"""A world with walls at 0 and 20 m."""
FACE_M = 0.12
"""Distance of the ultrasonic sensor's face ahead of the axle, m."""
MS_PER_M = 2000.0 / 343.0


def sonar(level: NoiseLevel = NONE, seed: int = 1) -> Ultrasonic:
    return Ultrasonic(MODEL.ultrasonic, level, Draws(np.random.default_rng(seed)))


def before_wall(distance_m: float) -> Pose2:
    """Return a pose that faces the wall at 20 m, perpendicular to it."""
    return Pose2(20.0 - FACE_M - distance_m, 10.0, 0.0)


def pings(device: Ultrasonic, count: int, distance_m: float) -> list[float | None]:
    return [device.read(60 * i + 59, before_wall(distance_m), CENTRE) for i in range(count)]


def within(count: int, of: int, p: float, sigmas: float = 4.0) -> bool:
    """Return whether a binomial count is within a number of standard deviations of its mean."""
    return abs(count - of * p) <= sigmas * math.sqrt(of * p * (1.0 - p))


# The time of a measurement.


def test_a_reading_is_that_of_the_last_ping_whose_echo_is_back() -> None:
    """The robot drives towards a wall at 0.2 m/s, and the test reads the sensor at 20 Hz.

    The test compares each reading with the range at the time of its ping.
    """
    device, start_m, v = sonar(), 2.0, 0.2
    readings = []
    for i in range(40):
        t_ms = 50 * i
        readings.append(device.read(t_ms, before_wall(start_m - v * 0.001 * t_ms), CENTRE))
        known = [
            start_m - v * 0.06 * ping
            for ping in range(t_ms // 60 + 1)
            if 60 * ping + MS_PER_M * (start_m - v * 0.06 * ping) <= t_ms
        ]
        assert readings[-1] == (pytest.approx(known[-1], abs=1e-9) if known else None)
    # There are 33 pings in 2 s. The other readings repeat a range exactly.
    assert readings[0] is None
    assert len(set(readings[1:])) in {32, 33}


def test_a_reading_is_never_older_than_a_cycle_and_its_flight() -> None:
    device, v = sonar(), 0.2
    for i in range(1, 60):
        t_ms = 50 * i
        true_m = 1.0 - v * 0.001 * t_ms * 0.3
        reported = device.read(t_ms, before_wall(true_m), CENTRE)
        assert reported is not None
        late_ms = (reported - true_m) / (0.3 * v) * 1000.0
        assert -1e-6 <= late_ms < 60.0 + MS_PER_M * reported


def test_a_range_has_the_age_of_its_pulse() -> None:
    """At 1 m the echo arrives after 5.8 ms. An earlier reading belongs to the previous ping."""
    device, start_m, v_m_s = Rangers(MODEL, NONE, np.random.default_rng(1)), 1.0, 0.2
    device.read(0, before_wall(start_m), CENTRE)
    for t_ms in range(61, 2000, 7):
        true_m = start_m - 0.001 * t_ms * v_m_s
        seen = device.read(t_ms, before_wall(true_m), CENTRE)
        assert seen.ultrasonic_m == pytest.approx(true_m + 1e-6 * v_m_s * seen.ultrasonic_age_us)
        assert (1000 * t_ms - seen.ultrasonic_age_us) % 60_000 == 0
        assert 0 < seen.ultrasonic_age_us < 66_000


def test_the_last_echo_is_kept_between_pings() -> None:
    device = sonar()
    assert device.read(5, before_wall(1.0), CENTRE) is None  # the echo from 1 m takes 5.8 ms
    assert device.read(6, before_wall(1.0), CENTRE) == pytest.approx(1.0)
    assert device.read(59, before_wall(0.5), CENTRE) == pytest.approx(1.0)
    assert device.read(60, before_wall(0.5), CENTRE) == pytest.approx(1.0)
    assert device.read(62, before_wall(0.5), CENTRE) == pytest.approx(1.0)
    assert device.read(63, before_wall(0.5), CENTRE) == pytest.approx(0.5)


def test_silence_is_detected_after_38_milliseconds() -> None:
    device = sonar()
    assert device.read(30, before_wall(1.0), CENTRE) == pytest.approx(1.0)
    assert device.read(60, before_wall(5.0), CENTRE) == pytest.approx(1.0)
    assert device.read(97, before_wall(5.0), CENTRE) == pytest.approx(1.0)
    assert device.read(98, before_wall(5.0), CENTRE) is None


# Echoes.


def test_nearer_than_its_least_range_it_reads_the_least() -> None:
    assert pings(sonar(), 1, 0.008) == [0.02]


@pytest.mark.parametrize("turn_deg", [0.0, 6.0, -7.0])
def test_a_thin_leg_anywhere_in_the_cone_is_seen(turn_deg: float) -> None:
    bearing = math.radians(turn_deg)
    x, y = 10.12 + 3.5 * math.cos(bearing), 10.0 + 3.5 * math.sin(bearing)
    made = world(room((10.0, 10.0, 0.0), obstacles=(box(x, y - 0.02, x + 0.04, y + 0.02),)))
    reading = sonar().exact(made.plan.start, made)
    assert reading == pytest.approx(3.5, abs=0.02)


def test_outside_the_cone_it_is_not() -> None:
    x, y = 10.12 + 2.0 * math.cos(0.2), 10.0 + 2.0 * math.sin(0.2)
    made = world(room((10.0, 10.0, 0.0), obstacles=(box(x, y, x + 0.04, y + 0.04),)))
    assert sonar().exact(made.plan.start, made) is None


def test_a_walkers_leg_is_seen_where_it_is_nearest() -> None:
    walked = CENTRE.with_walker(12.0, 10.05, 0.06)
    nearest = math.hypot(2.0 - FACE_M, 0.05) - 0.06
    assert sonar().exact(Pose2(10.0, 10.0, 0.0), walked) == pytest.approx(nearest, abs=1e-4)


def test_the_blind_angle_of_a_wall_is_its_mirrors_and_half_the_cone() -> None:
    """The robot turns in front of a wall in steps of 0.1°. The limit is 27° + 7.5°."""
    device = sonar()
    seen = [
        angle
        for angle in np.arange(0.0, 60.0, 0.1)
        if device.exact(Pose2(18.0, 10.0, math.radians(angle)), CENTRE) is not None
    ]
    assert max(seen) == pytest.approx(34.5, abs=0.11)
    assert len(seen) == round(10.0 * max(seen)) + 1


def test_echoes_are_missed_as_often_as_the_level_sets() -> None:
    level = replace(NONE, ultrasonic_dropout=0.05)
    reported = pings(sonar(level), 4000, 0.5)
    assert within(reported.count(None), 4000, 0.05)
    assert all(t == pytest.approx(0.5) for t in reported if t is not None)


def test_spurious_echoes_come_as_often_as_the_level_sets_and_from_anywhere() -> None:
    level = replace(NONE, ultrasonic_crosstalk=0.1)
    reported = [t for t in pings(sonar(level), 4000, 1.0) if t is not None]
    assert len(reported) == 4000
    strange = [t for t in reported if abs(t - 1.0) > 1e-9]
    assert within(len(strange), 4000, 0.1)
    # The false ranges are uniform from 2 cm to 4 m: a quarter is below 1 m, the mean is 2.01 m.
    assert within(sum(t < 1.0 for t in strange), len(strange), 0.98 / 3.98)
    assert fmean(strange) == pytest.approx(2.01, abs=4.0 * 3.98 / math.sqrt(12.0 * len(strange)))


def test_crosstalk_occurs_in_an_empty_room_too() -> None:
    level = replace(NONE, ultrasonic_crosstalk=0.1)
    reported = pings(sonar(level), 1000, 8.0)
    assert within(1000 - reported.count(None), 1000, 0.1)


# Infrared.


class Painted(Reflectances):
    """Walls that all have the same reflectance."""

    def __init__(self, reflectance: float) -> None:
        super().__init__(NONE, Draws(np.random.default_rng(0)))
        self._all = reflectance

    def of(self, edge: int) -> float:
        del edge
        return self._all


def infrared(reflectance: float = 0.9, level: NoiseLevel = NONE) -> Infrared:
    draws = Draws(np.random.default_rng(3))
    return Infrared(MODEL.infrared_left, level, draws, Painted(reflectance))


def test_the_voltage_is_the_datasheets() -> None:
    assert volts(0.30, 0.032) == pytest.approx(0.40)
    assert volts(0.04, 0.032) - volts(0.30, 0.032) == pytest.approx(2.25)
    # The curve is not linear: at half of the distance, the voltage is far below the middle.
    assert volts(0.17, 0.032) == pytest.approx(12.25 / (17.0 + 0.622), abs=1e-3)


@pytest.mark.parametrize("distance", [0.04, 0.05, 0.1, 0.2, 0.299])
def test_the_firmware_inverts_the_curve(distance: float) -> None:
    assert infrared().reading(distance, 0) == pytest.approx(distance)
    assert metres(volts(distance, 0.032)) == pytest.approx(distance)


@pytest.mark.parametrize(
    ("true_cm", "read_cm"),
    [
        (3.6, 4.0),  # between the peak and the minimum range, the minimum is reported
        (3.2, 4.0),
        (2.0, 3.822 * 1.6 - 0.622),  # the voltage is the peak voltage times 2.0/3.2
        (1.0, 3.822 * 3.2 - 0.622),
        (0.3, None),  # the voltage is as low as beyond the range
    ],
)
def test_nearer_than_its_peak_the_reading_folds_back(true_cm: float, read_cm: float | None) -> None:
    reported = infrared().reading(0.01 * true_cm, 0)
    assert reported == (None if read_cm is None else pytest.approx(0.01 * read_cm, abs=1e-5))


@pytest.mark.parametrize("distance", [0.05, 0.10, 0.20])
def test_its_sigma_grows_with_the_square_of_the_distance(distance: float) -> None:
    device = infrared(level=replace(NONE, infrared_sigma_m=0.0015))
    reported = [device.reading(distance, 0) for _ in range(4000)]
    expected = 0.0015 * ((distance + 0.00622) / (0.10 + 0.00622)) ** 2
    assert np.std([t for t in reported if t is not None]) == pytest.approx(expected, rel=0.05)


def test_a_grey_card_reads_two_per_cent_far_and_is_noisier() -> None:
    assert infrared(0.18).reading(0.10, 0) == pytest.approx(0.10 * (1.0 + 0.03 * 0.72))
    level = replace(NONE, infrared_sigma_m=0.0005)
    spread = {}
    for reflectance in (0.9, 0.18):
        device = infrared(reflectance, level)
        reported = [device.reading(0.10, 0) for _ in range(4000)]
        spread[reflectance] = float(np.std([t for t in reported if t is not None]))
    # The factor is √5, and 1.02² because the grey card seems 2 % farther away.
    assert spread[0.18] / spread[0.9] == pytest.approx(math.sqrt(5.0) * 1.04, rel=0.05)


def test_each_wall_keeps_the_reflectance_that_was_drawn_for_it() -> None:
    level = replace(NONE, infrared_reflectance_spread=0.7)
    first, second = (Reflectances(level, Draws(np.random.default_rng(5))) for _ in range(2))
    forwards = [first.of(edge) for edge in range(200)]
    assert [second.of(edge) for edge in reversed(range(200))] == forwards[::-1]
    assert min(forwards) >= 0.2
    assert max(forwards) <= 0.9
    # From 200 uniform values over 0.7, the mean has a standard error of 0.014.
    assert fmean(forwards) == pytest.approx(0.55, abs=0.06)
    assert first.of(-1) == pytest.approx(0.2)


def test_the_walker_is_seen_from_the_side() -> None:
    walked = CENTRE.with_walker(10.05, 10.3, 0.05)
    device = Rangers(MODEL, NONE, np.random.default_rng(1))
    reported = device.read(59, Pose2(10.0, 10.0, 0.0), walked)
    assert reported.infrared_left_m == pytest.approx(0.15)
    assert (reported.ultrasonic_m, reported.infrared_right_m) == (None, None)
