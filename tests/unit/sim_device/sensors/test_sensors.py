"""The sensors, compared with the plant's true motion and with closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from protocol.imu import GRAVITY_M_S2
from sim_device.noise import NOISE_LEVELS, NoiseLevel, UnknownNoiseLevelError, noise_level
from sim_device.sensors.rangers import Rangers, Ranges
from support.sim_body import box, duty, plant, room, sensors, world

if TYPE_CHECKING:
    from sim_device.world.world import World

MODEL = RobotModel()
CENTRE = room((10.0, 10.0, 0.0))
CRUISE = duty(0.2)


def rangers(level: NoiseLevel = NOISE_LEVELS["none"], seed: int = 1) -> Rangers:
    return Rangers(MODEL, level, np.random.default_rng(seed))


def waiting(device: Rangers, ping: int, pose: Pose2, made: World) -> Ranges:
    """Return the reading of a robot at rest when the echo of this ping has arrived."""
    return device.read(60 * ping + 59, pose, made)


def looking(pose: Pose2, made: World) -> Ranges:
    return waiting(rangers(), 0, pose, made)


# Encoders.


def test_counts_are_those_of_the_wheels_angle() -> None:
    body = plant(CENTRE)
    suite = sensors(body)
    assert suite.encoders() == (0, 0)
    body.set_duty(CRUISE, 0.5 * CRUISE)
    body.advance_ms(2000)
    left, right = body.wheel_angles_rad
    per_rad = MODEL.counts_per_turn / (2.0 * math.pi)
    assert suite.encoders() == (math.floor(left * per_rad), math.floor(right * per_rad))


def test_counts_wrap_at_16_bits_both_ways() -> None:
    body = plant(CENTRE)
    suite = sensors(body)
    body.set_duty(-CRUISE, CRUISE)
    body.advance_ms(30)
    left, right = suite.encoders()
    assert 65_000 < left <= 65_535
    assert 0 < right < 500
    total, before = 0, right
    while body.truth.right_rad * MODEL.counts_per_turn / (2.0 * math.pi) < 70_000:
        body.advance_ms(1000)
        _, now = suite.encoders()
        total += (now - before) & 0xFFFF
        before = now
    exact = body.truth.right_rad * MODEL.counts_per_turn / (2.0 * math.pi)
    assert total + right == math.floor(exact)
    assert before == math.floor(exact) - 65_536


# Inertial.


def test_at_rest_it_feels_gravity_only() -> None:
    body = plant(CENTRE)
    suite = sensors(body)
    body.advance_ms(10)
    temperature = round((25.0 - 36.53) * 340.0)
    assert suite.imu() == (0, 0, 16384, temperature, 0, 0, 0)
    body.advance_ms(600_000)
    assert suite.imu().temperature == pytest.approx((30.2 - 36.53) * 340.0, abs=20)


def test_a_known_yaw_rate_gives_its_counts() -> None:
    body = plant(CENTRE)
    suite = sensors(body)
    body.set_duty(-duty(0.1), duty(0.1))
    body.advance_ms(3000)
    suite.imu()
    body.advance_ms(10)
    assert suite.imu().gyro_z == round(math.degrees(0.2 / MODEL.wheel_base_m) * 131.0)


def test_in_a_bend_it_feels_the_centripetal_acceleration() -> None:
    body = plant(CENTRE)
    suite = sensors(body)
    body.set_duty(duty(0.15), duty(0.25))
    body.advance_ms(3000)
    suite.imu()
    body.advance_ms(10)
    v, omega = 0.2, 0.1 / MODEL.wheel_base_m
    counts = suite.imu()
    assert counts.accel_x == pytest.approx(0, abs=1)
    assert counts.accel_y == pytest.approx(v * omega / GRAVITY_M_S2 * 16384.0, abs=1)


def test_its_mean_acceleration_is_the_change_of_speed() -> None:
    body = plant(CENTRE)
    suite = sensors(body)
    body.set_duty(duty(0.05), duty(0.05))
    v_before = 0.0
    for _ in range(20):
        body.advance_ms(10)
        v_after = body.truth.v_m_s
        expected = (v_after - v_before) / 0.01 / GRAVITY_M_S2 * 16384.0
        assert suite.imu().accel_x == pytest.approx(expected, abs=1)
        v_before = v_after


def test_the_gyros_sum_is_the_turn() -> None:
    body = plant(CENTRE)
    suite = sensors(body)
    total = 0.0
    for i in range(300):
        body.set_duty(0.5 * math.sin(0.1 * i), 0.6 * math.cos(0.07 * i))
        body.advance_ms(10)
        total += 0.01 * suite.imu().gyro_z / 131.0
    # Rounding adds at most half a count per sample; as a random walk, far less in total.
    assert total == pytest.approx(math.degrees(body.truth.heading_rad), abs=0.005)


def test_a_bump_is_felt_and_saturates_at_two_g() -> None:
    body = plant(room((1.7, 1.0, 0.0), walls=box(0.0, 0.0, 2.0, 2.0)))
    suite = sensors(body)
    body.set_duty(1.0, 1.0)
    lowest = 0
    for _ in range(100):
        body.advance_ms(10)
        lowest = min(lowest, suite.imu().accel_x)
    assert lowest == -32768


def test_a_fast_spin_saturates_the_gyro() -> None:
    body = plant(CENTRE)
    suite = sensors(body)
    body.set_duty(-1.0, 1.0)
    body.advance_ms(2000)
    suite.imu()
    body.advance_ms(10)
    rate = math.degrees(body.truth.yaw_rate_rad_s)
    assert suite.imu().gyro_z == min(32767, round(rate * 131.0))


def test_reads_within_a_sample_are_equal() -> None:
    body = plant(CENTRE)
    suite = sensors(body, level="harsh")
    first = suite.imu()
    assert suite.imu() == first
    body.advance_ms(9)
    assert suite.imu() == first
    body.advance_ms(1)
    assert suite.imu() != first


def test_gyro_noise_has_the_datasheets_density() -> None:
    body = plant(CENTRE, level="typical")
    suite = sensors(body, level="typical")
    samples = []
    for _ in range(4000):
        body.advance_ms(10)
        samples.append(suite.imu().gyro_z / 131.0)
    assert np.std(samples) == pytest.approx(0.005 * math.sqrt(50.0), rel=0.05)


def test_a_rest_removes_the_turn_on_bias_but_not_the_motion_bias() -> None:
    level = noise_level("typical")
    left = []
    for seed in range(6):
        body = plant(CENTRE, level="none")
        suite = sensors(body, level="typical", seed=seed)
        rest = []
        for _ in range(1000):
            body.advance_ms(10)
            rest.append(suite.imu().gyro_z / 131.0)
        bias = float(np.mean(rest))
        body.set_duty(CRUISE, CRUISE)
        driving = []
        for _ in range(4000):
            body.advance_ms(10)
            driving.append(suite.imu().gyro_z / 131.0 - bias)
            if not 3.0 < body.pose.x_m < 17.0:
                body.set_duty(0.0, 0.0)
        left.append(abs(float(np.mean(driving))))
        assert abs(bias) <= level.gyro_turn_on_deg_s + 0.1
    assert float(np.median(left)) == pytest.approx(level.gyro_motion_bias_deg_s, rel=0.3)


# Rangers.


@pytest.mark.parametrize("distance", [0.04, 0.3, 1.234, 3.9])
def test_square_on_it_reads_the_distance(distance: float) -> None:
    pose = Pose2(20.0 - 0.12 - distance, 10.0, 0.0)
    assert looking(pose, world(CENTRE)).ultrasonic_m == pytest.approx(distance, abs=1e-12)


def test_beyond_its_range_there_is_no_echo() -> None:
    assert looking(Pose2(20.0 - 0.12 - 4.01, 10.0, 0.0), world(CENTRE)).ultrasonic_m is None


@pytest.mark.parametrize("angle_deg", [5.0, 7.5, 20.0, 33.0])
def test_a_wall_aslant_reads_its_nearest_part_within_the_cone(angle_deg: float) -> None:
    pose = Pose2(18.0, 10.0, math.radians(angle_deg))
    face_x = pose.transform(0.12, 0.0)[0]
    nearest = (20.0 - face_x) / math.cos(math.radians(max(0.0, angle_deg - 7.5)))
    reading = looking(pose, world(CENTRE)).ultrasonic_m
    assert reading == pytest.approx(nearest, rel=3e-4)


@pytest.mark.parametrize("angle_deg", [36.0, 45.0, -45.0, 60.0])
def test_a_too_oblique_wall_gives_no_echo(angle_deg: float) -> None:
    pose = Pose2(18.0, 10.0, math.radians(angle_deg))
    assert looking(pose, world(CENTRE)).ultrasonic_m is None


def test_the_rooms_corner_echoes_where_its_walls_do_not() -> None:
    pose = Pose2(18.0, 18.0, math.radians(45.0))
    expected = math.hypot(2.0, 2.0) - 0.12
    assert looking(pose, world(CENTRE)).ultrasonic_m == pytest.approx(expected)


@pytest.mark.parametrize(("distance", "seen"), [(1.4, True), (1.6, False)])
def test_an_obstacles_corner_echoes_only_when_near(distance: float, seen: bool) -> None:  # noqa: FBT001 - a table's column
    half = 0.1 * math.sqrt(2.0)
    tip = 10.0 + 0.12 + distance
    diamond = (
        (tip, 10.0),
        (tip + half, 10.0 - half),
        (tip + 2 * half, 10.0),
        (tip + half, 10.0 + half),
    )
    made = world(room((10.0, 10.0, 0.0), obstacles=(diamond,)))
    reading = looking(made.plan.start, made).ultrasonic_m
    assert reading == (pytest.approx(distance) if seen else None)


def test_a_mirror_wall_still_hides_obstacles_behind_it() -> None:
    slanted = ((10.5, 9.0), (11.5, 9.0), (13.5, 11.0), (12.5, 11.0))
    behind = box(13.0, 9.0, 13.2, 11.0)
    made = world(room((10.0, 10.0, 0.0), obstacles=(slanted,)))
    assert looking(made.plan.start, made).ultrasonic_m is None
    both = world(room((10.0, 10.0, 0.0), obstacles=(slanted, behind)))
    assert looking(both.plan.start, both).ultrasonic_m is None
    alone = world(room((10.0, 10.0, 0.0), obstacles=(behind,)))
    assert looking(alone.plan.start, alone).ultrasonic_m == pytest.approx(2.88)


def test_a_thin_leg_near_the_axis_is_seen() -> None:
    made = world(room((10.0, 10.0, 0.0), obstacles=(box(11.0, 9.98, 11.04, 10.02),)))
    assert looking(made.plan.start, made).ultrasonic_m == pytest.approx(0.88)


def test_infrared_reads_its_own_side() -> None:
    made = world(room((1.0, 0.26, 0.0)))
    reading = looking(made.plan.start, made)
    assert reading.infrared_right_m == pytest.approx(0.16)
    assert reading.infrared_left_m is None
    turned = looking(Pose2(1.0, 0.26, math.pi), made)
    assert turned.infrared_left_m == pytest.approx(0.16)
    assert turned.infrared_right_m is None


def test_infrared_ends_at_its_range_and_reads_about_five_centimetres_in_contact() -> None:
    made = world(room((1.0, 1.0, 0.0)))
    assert looking(Pose2(1.0, 0.399, 0.0), made).infrared_right_m == pytest.approx(0.299)
    assert looking(Pose2(1.0, 0.401, 0.0), made).infrared_right_m is None
    assert looking(Pose2(1.0, 0.16, 0.0), made).infrared_right_m == pytest.approx(0.06)
    assert looking(Pose2(1.0, 0.135, 0.0), made).infrared_right_m == 0.04


def test_range_noise_and_dropouts_are_those_of_the_level() -> None:
    made = world(room((1.0, 0.2, math.pi)))
    # The walls are white, and there is no crosstalk: both have separate tests.
    level = replace(
        noise_level("typical"), ultrasonic_crosstalk=0.0, infrared_reflectance_spread=0.0
    )
    device = rangers(level)
    readings = [waiting(device, ping, made.plan.start, made) for ping in range(3000)]
    sonar = [r.ultrasonic_m for r in readings if r.ultrasonic_m is not None]
    left = [r.infrared_left_m for r in readings if r.infrared_left_m is not None]
    assert 1.0 - len(sonar) / len(readings) == pytest.approx(level.ultrasonic_dropout, rel=0.5)
    assert np.std(sonar) == pytest.approx(level.ultrasonic_sigma_m, rel=0.05)
    assert np.mean(sonar) == pytest.approx(0.88, abs=2e-4)
    assert np.std(left) == pytest.approx(level.infrared_sigma_m, rel=0.05)
    near = [
        waiting(device, ping, Pose2(1.0, 0.16, math.pi), made).infrared_left_m
        for ping in range(3000, 4000)
    ]
    assert np.std([r for r in near if r is not None]) < 0.0015


# Power, noise table, independence.


def test_power_reads_the_rails_and_both_motors() -> None:
    body = plant(CENTRE, battery=None)
    suite = sensors(body)
    body.set_duty(CRUISE, -CRUISE)
    body.advance_ms(2000)
    reading = suite.power()
    assert 15.9 < reading.battery_v < 16.0
    assert reading.rail_v == 5.0
    # The current of a freely rolling wheel only overcomes friction.
    assert (reading.left_a, reading.right_a) == pytest.approx((0.0625, -0.0625), rel=0.02)
    body.set_duty(-CRUISE, CRUISE)
    assert sensors(body).power().left_a < -1.0


def test_levels_grow_and_none_is_free_of_noise() -> None:
    from dataclasses import fields  # noqa: PLC0415 - only for this test

    assert list(NOISE_LEVELS) == ["none", "paper", "typical", "harsh"]
    for entry in fields(NOISE_LEVELS["none"]):
        if entry.name == "name":
            continue
        values = [getattr(level, entry.name) for level in NOISE_LEVELS.values()]
        assert values[0] == 0.0
        assert values == sorted(values), entry.name


def test_an_unknown_level_is_named() -> None:
    with pytest.raises(UnknownNoiseLevelError, match="'loud' is not one of none, paper"):
        noise_level("loud")


def test_one_sensors_reads_shift_no_others() -> None:
    def run(*, with_ranges: bool) -> list[object]:
        body = plant(CENTRE, level="typical")
        suite = sensors(body, level="typical")
        body.set_duty(CRUISE, 0.9 * CRUISE)
        out: list[object] = []
        for _ in range(20):
            body.advance_ms(10)
            if with_ranges:
                suite.ranges()
                suite.power()
            out += [suite.imu(), suite.encoders(), body.truth]
        return out

    assert run(with_ranges=True) == run(with_ranges=False)
