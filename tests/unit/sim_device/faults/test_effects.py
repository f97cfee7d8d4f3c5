"""Effect and end of faults of sensors, wheels and surroundings, by readings and true motion."""

from __future__ import annotations

import math
import statistics

import pytest

from protocol.messages.device import Encoders, Imu, Power, Range
from protocol.messages.values import Contact
from support.rigs import Drive, rig
from support.sim_body import box, room

pytestmark = pytest.mark.usefixtures("target")

AHEAD = room((5.0, 5.0, 0.0), walls=box(4.0, 4.0, 8.0, 6.0), obstacles=(box(7.0, 4.5, 7.2, 5.5),))
"""A room with an obstacle 2 m ahead of the robot's centre: 1.88 m from the ultrasonic sensor."""

# ---- sensors ------------------------------------------------------------------------------


def test_a_frozen_imu_repeats_itself() -> None:
    drive = Drive(rig("imu-frozen@3:1"), 0.0, 1.0)
    drive.run(5.0)
    frozen = {(m.gyro_z_rad_s, m.gyro_x, m.accel_x) for m in drive.of(Imu, 3.05, 4.0)}
    assert len(frozen) == 1
    assert len({m.gyro_z_rad_s for m in drive.of(Imu, 4.1, 5.0)}) > 1


def test_a_biased_imu_is_off_by_that_much() -> None:
    drive = Drive(rig("imu-biased@2:2:gyro=5,accel=0.1", "imu-biased@3:1:gyro=-2"))
    drive.run(6.0)

    def rate_deg_s(since_s: float) -> float:
        rates = [m.gyro_z_rad_s for m in drive.of(Imu, since_s + 0.2, since_s + 1.0)]
        return math.degrees(statistics.mean(rates))

    assert rate_deg_s(1.0) == pytest.approx(0.0, abs=0.05)
    assert rate_deg_s(2.0) == pytest.approx(5.0, abs=0.05)
    assert rate_deg_s(3.0) == pytest.approx(3.0, abs=0.05), "two biases add up"
    assert rate_deg_s(4.5) == pytest.approx(0.0, abs=0.05)


def wheel_counts(drive: Drive, since_s: float, until_s: float) -> tuple[int, int]:
    samples = drive.of(Encoders, since_s, until_s)
    first, last = samples[0], samples[-1]
    return last.left - first.left, last.right - first.right


def test_an_encoder_that_misses_counts() -> None:
    drive = Drive(rig("encoder-dropout@3:5:left,share=0.5"), 0.2)
    drive.run(5.0)
    left, right = wheel_counts(drive, 3.5, 5.0)
    assert right > 500
    # The device controls the wheel by its encoder, so the left wheel turns faster.
    turned_left = drive.rig.truth.left_rad_s
    assert turned_left > 1.5 * drive.rig.truth.right_rad_s
    assert left == pytest.approx(right, rel=0.2)


def test_a_blind_and_a_lying_ultrasonic() -> None:
    drive = Drive(rig("ultrasonic-blind@2:1", "ultrasonic-constant@4:1:m=0.7", plan=AHEAD))
    drive.run(6.0)

    def readings(since_s: float) -> set[float | None]:
        found = drive.of(Range, since_s + 0.2, since_s + 1.0)
        return {m.ultrasonic_m and round(m.ultrasonic_m, 2) for m in found}

    assert readings(1.0) == readings(5.0) == {1.88}
    assert readings(2.0) == {None}
    assert readings(4.0) == {0.70}


def test_a_bumper_that_stays_pressed() -> None:
    drive = Drive(rig("bumper-stuck@2:1:side=right"))
    drive.run(4.0)
    assert {m.contacts & Contact.BUMPER_RIGHT for m in drive.of(Range, 2.2, 3.0)} != {0}
    assert not any(m.contacts & Contact.BUMPER_LEFT for m in drive.of(Range))
    assert not any(m.contacts & Contact.BUMPER_RIGHT for m in drive.of(Range, 3.2, 4.0))


# ---- wheels, battery, people --------------------------------------------------------------


def test_a_stuck_wheel_does_not_turn() -> None:
    drive = Drive(rig("wheel-stuck@3:1:side=left"), 0.15)
    drive.run(3.1)
    before = drive.rig.truth
    drive.run(3.9)
    after = drive.rig.truth
    assert after.left_rad == before.left_rad
    assert after.right_rad > before.right_rad + 0.5
    assert after.heading_rad > before.heading_rad + 0.1
    drive.run(5.0)
    assert drive.rig.truth.left_rad > after.left_rad + 1.0


def test_a_slipping_wheel_shortens_the_driven_path() -> None:
    drive = Drive(rig("wheel-slip@4:2:both,share=0.5"), 0.2)

    def gone_m(since_s: float, until_s: float) -> float:
        drive.run(since_s)
        before = drive.rig.truth.pose
        drive.run(until_s)
        return drive.rig.truth.pose.distance_m(before)

    free, slipping, again = gone_m(3.0, 4.0), gone_m(4.2, 5.2), gone_m(6.5, 7.5)
    assert free == pytest.approx(0.2, rel=0.03)
    assert slipping == pytest.approx(0.5 * free, rel=0.03)
    assert again == pytest.approx(free, rel=0.03)


def test_a_flat_battery_gives_less() -> None:
    drive = Drive(rig("battery-flat@2:charge=0.05"))
    drive.run(4.0)
    assert drive.rig.plant.state_of_charge == pytest.approx(0.05, abs=0.001)
    full = drive.of(Power, 1.0, 2.0)[-1].battery_v
    assert drive.of(Power, 3.0, 4.0)[-1].battery_v < full - 1.0


def test_a_lifted_robot_s_wheels_turn_in_the_air() -> None:
    drive = Drive(rig("lifted@3:1"), 0.2)
    drive.run(3.05)
    before = drive.rig.truth
    drive.run(3.3)
    assert drive.rig.truth.pose.distance_m(before.pose) < 0.002
    assert drive.rig.truth.left_rad > before.left_rad
    drive.run(4.0)
    assert any(m.contacts & Contact.CLIFF for m in drive.of(Range, 3.2, 4.0))


def nearest(drive: Drive, since_s: float, until_s: float) -> float:
    readings = [m.ultrasonic_m for m in drive.of(Range, since_s, until_s)]
    return min(r for r in readings if r is not None)


def test_an_obstacle_is_moved_and_moved_back() -> None:
    drive = Drive(rig("obstacle@2:2:dx=-0.5", "obstacle@3:1:index=0,dx=0.2", plan=AHEAD))
    drive.run(6.0)
    assert nearest(drive, 1.0, 1.9) == pytest.approx(1.88, abs=0.01)
    assert nearest(drive, 2.3, 2.9) == pytest.approx(1.38, abs=0.01)
    assert nearest(drive, 3.3, 3.9) == pytest.approx(1.58, abs=0.01), "moves add up"
    assert nearest(drive, 4.3, 5.9) == pytest.approx(1.88, abs=0.01)


def test_a_person_walks_past_and_leaves() -> None:
    drive = Drive(rig("person@2:3:ahead=0.9,speed=0.8,reach=0.8", plan=AHEAD))
    drive.run(7.0)
    # The surface of the leg crosses 0.84 m ahead of the centre, 0.72 m from the sensor.
    assert nearest(drive, 2.0, 5.0) == pytest.approx(0.72, abs=0.03)
    far = [m.ultrasonic_m for m in drive.of(Range, 2.0, 5.0) if (m.ultrasonic_m or 0) > 1.5]
    assert len(far) > 10, "the leg moves to and fro"
    assert nearest(drive, 5.2, 7.0) == pytest.approx(1.88, abs=0.01)


def test_a_person_waits_rather_than_walk_into_the_robot() -> None:
    drive = Drive(rig("person@1:8:ahead=0.3,speed=0.8,reach=0.8"))
    drive.run(9.0)
    assert drive.rig.truth.collisions == 0
    assert drive.rig.truth.contact_s == 0.0
    assert drive.rig.truth.path_m < 0.001


def test_a_displaced_robot_stands_elsewhere_and_no_sensor_feels_it() -> None:
    drive = Drive(rig("displaced@2:dx=0.5,dy=-0.2,turn=90", plan=AHEAD))
    drive.run(1.9)
    before = drive.rig.truth.pose
    drive.run(4.0)
    pose = drive.rig.truth.pose
    assert (pose.x_m - before.x_m, pose.y_m - before.y_m) == pytest.approx((0.5, -0.2), abs=1e-6)
    assert math.degrees(pose.theta_rad - before.theta_rad) == pytest.approx(90.0, abs=0.01)
    rates = [abs(math.degrees(m.gyro_z_rad_s)) for m in drive.of(Imu, 1.9, 3.0)]
    assert max(rates) < 2.0
    assert wheel_counts(drive, 1.5, 3.5) == (0, 0)


def test_a_robot_displaced_into_an_obstacle_stands_before_it() -> None:
    drive = Drive(rig("displaced@1:dx=2.1,dy=0", plan=AHEAD))
    drive.run(2.0)
    assert drive.rig.truth.pose.x_m == pytest.approx(7.0 - 0.16, abs=0.05)
    assert drive.rig.truth.contact_s == 0.0


def test_a_carried_robot_is_lifted_and_put_down_elsewhere() -> None:
    drive = Drive(rig("carried@2:1.5:dx=-0.4,dy=0.1", plan=AHEAD))
    drive.run(1.9)
    before = drive.rig.truth.pose
    drive.run(5.0)
    assert all(m.contacts & Contact.CLIFF for m in drive.of(Range, 2.2, 3.4))
    assert not any(m.contacts & Contact.CLIFF for m in drive.of(Range, 3.7, 5.0))
    pose = drive.rig.truth.pose
    assert (pose.x_m - before.x_m, pose.y_m - before.y_m) == pytest.approx((-0.4, 0.1), abs=1e-6)
