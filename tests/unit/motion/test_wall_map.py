"""Walls stored and seen again, and their joint covariance."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from bridge.motion.estimation.ekf import STATES, THETA, WHEEL_SCALE
from bridge.motion.estimation.wall_map import MAX_WALLS
from bridge.motion.estimation.wall_measurements import FrontMeasurement, LineMeasurement
from bridge.motion.robot_model import RobotModel
from support.walled import DEGREE, ORIGIN, Room, line

MODEL = RobotModel()


def test_a_wall_seen_again_takes_the_drift_away() -> None:
    room = Room()
    assert not room.walls.see_line(line(math.pi / 2, 0.5)), "new"
    room.inflate(0.02, DEGREE)
    room.believe(0.01, 0.012, 0.6 * DEGREE)  # an error within the uncertainty
    assert room.walls.see_line(line(math.pi / 2, 0.5))
    pose = room.filter.pose
    assert pose.y_m == pytest.approx(0.0, abs=0.001)
    assert pose.theta_rad == pytest.approx(0.0, abs=0.1 * DEGREE)
    assert pose.x_m == pytest.approx(0.01, abs=0.002), "along the wall nothing is known"


def test_a_large_jump_of_the_heading_needs_two_pieces_of_a_wall() -> None:
    """One piece may contain a step between two boxes that stand beside each other."""
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    step = line(math.pi / 2 - 2.0 * DEGREE, 0.5)
    assert not room.walls.see_line(step)
    assert room.filter.pose == ORIGIN
    assert room.walls.see_line(line(math.pi / 2, 0.5)), "the direction agrees again"
    assert not room.walls.see_line(step)
    assert not room.walls.see_line(line(math.pi / 2 + 2.0 * DEGREE, 0.5)), "another direction"
    assert room.filter.pose.distance_m(ORIGIN) < 0.001
    assert abs(room.filter.pose.theta_rad) < 0.01 * DEGREE


def test_a_wrong_heading_is_corrected_after_two_pieces_of_a_wall() -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.believe(0.0, 0.0, 2.0 * DEGREE)  # 20 standard deviations
    assert not room.walls.see_line(line(math.pi / 2, 0.5))
    assert room.walls.see_line(line(math.pi / 2, 0.5))
    assert abs(room.filter.pose.theta_rad) < 0.2 * DEGREE
    assert len(room.walls.walls) == 1


def test_a_wall_first_seen_while_uncertain_gives_no_more_information() -> None:
    room = Room()
    room.inflate(0.03, 2.0 * DEGREE)
    before = room.filter.covariance
    room.walls.see_line(line(math.pi / 2, 0.5))
    for _ in range(50):
        room.walls.see_line(line(math.pi / 2, 0.5))
    after = room.filter.covariance
    assert after[1][1] == pytest.approx(before[1][1], rel=1e-3)
    assert after[2][2] == pytest.approx(before[2][2], rel=1e-3)


def test_a_short_stretch_beside_a_walls_end_may_be_a_column() -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))  # seen from -0.15 to 0.15 m
    room.inflate(0.01, DEGREE)

    def beside(at_m: float, span_m: float) -> LineMeasurement:
        half = 0.5 * span_m
        return line(math.pi / 2, 0.5)._replace(low_m=at_m - half, high_m=at_m + half)

    assert not room.walls.see_line(beside(0.45, 0.12))
    assert room.walls.see_line(beside(0.45, 0.2))
    assert room.walls.see_line(beside(0.65, 0.12)), "at the end of what is known by now"


@pytest.mark.parametrize(("sigma_m", "known"), [(0.01, True), (0.06, False)])
def test_a_piece_beyond_a_wall_is_not_that_wall_for_an_uncertain_pose(
    sigma_m: float, *, known: bool
) -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))  # seen from -0.15 to 0.15 m
    room.inflate(sigma_m, 0.0)
    room.believe(0.0, 0.01, 0.0)
    beyond = line(math.pi / 2, 0.5)._replace(low_m=0.35, high_m=0.6)
    assert room.walls.see_line(beyond) is known, "it may be the side of another obstacle"
    assert room.filter.pose.y_m == pytest.approx(0.0 if known else 0.01, abs=0.001)
    within = line(math.pi / 2, 0.5)._replace(low_m=0.0, high_m=0.3)
    assert room.walls.see_line(within), "at the known part there is only this wall"
    assert room.filter.pose.y_m == pytest.approx(0.0, abs=0.001)


@pytest.mark.parametrize(("off_m", "known"), [(0.01, True), (0.035, False)])
def test_a_piece_beyond_a_wall_and_off_its_line_may_be_another_surface(
    off_m: float, *, known: bool
) -> None:
    """The sides of two boxes beside each other are parallel, and some centimetres apart."""
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))  # seen from -0.15 to 0.15 m
    room.inflate(0.016, 0.0)  # 0.035 m are 2.2 standard deviations
    side = line(math.pi / 2, 0.5 - off_m)
    assert room.walls.see_line(side._replace(low_m=0.3, high_m=0.6)) is known
    assert room.filter.pose.y_m == pytest.approx(off_m if known else 0.0, abs=0.001)
    assert len(room.walls.walls) == 1, "until the pose is better known"


def test_a_wall_may_be_as_far_off_as_the_uncertainty() -> None:
    for sigma_m, known in ((0.02, False), (0.06, True)):
        room = Room()
        room.walls.see_line(line(0.0, 0.8))
        room.inflate(sigma_m, 0.0)
        room.believe(0.1, 0.0, 0.0)
        measurement = FrontMeasurement(0.8 - MODEL.ultrasonic.x_m, 0.002**2)
        assert room.walls.see_front(measurement, MODEL.ultrasonic) is known
        assert (abs(room.filter.pose.x_m) < 0.002) is known


@pytest.mark.parametrize(("sigma_m", "known"), [(0.04, True), (0.06, False)])
def test_an_uncertain_robot_does_not_know_a_place_that_only_the_ultrasonic_saw(
    sigma_m: float, *, known: bool
) -> None:
    """It may be a chair leg, and another leg of the chair may be 11 cm behind it."""
    room = Room()
    ahead = FrontMeasurement(0.8 - MODEL.ultrasonic.x_m, 0.002**2)
    assert not room.walls.see_front(ahead, MODEL.ultrasonic), "the first time"
    room.inflate(sigma_m, 0.0)
    room.believe(0.03, 0.0, 0.0)
    assert room.walls.see_front(ahead, MODEL.ultrasonic) is known
    assert room.filter.pose.x_m == pytest.approx(0.0 if known else 0.03, abs=0.002)


def test_the_ultrasonic_corrects_along_its_view() -> None:
    room = Room()
    room.walls.see_line(line(0.0, 0.8))
    room.inflate(0.02, 0.0)
    room.believe(0.015, 0.01, 0.0)
    assert room.walls.see_front(
        FrontMeasurement(0.8 - MODEL.ultrasonic.x_m, 0.002**2), MODEL.ultrasonic
    )
    assert room.filter.pose.x_m == pytest.approx(0.0, abs=0.001)
    assert room.filter.pose.y_m == pytest.approx(0.01)


def test_a_surface_of_unknown_direction_does_not_update_the_wheels() -> None:
    """The range to a wall 5° oblique shrinks by 4 permille less than the path.

    This is no error of the tyres.
    """
    room = Room()
    mount = MODEL.ultrasonic
    variance = room.filter.joint_covariance.p[WHEEL_SCALE, WHEEL_SCALE]
    for i in range(6):
        assert room.walls.see_front(FrontMeasurement(0.9 - 0.0996 * i, 0.001**2), mount) is (i > 0)
        room.filter.advance(0.1, 0.0, 0.5, 0.5, by_wheels=False)
        room.filter.propagate_covariance()
    assert room.filter.wheel_scale == 1.0
    assert room.filter.joint_covariance.p[WHEEL_SCALE, WHEEL_SCALE] == variance


@pytest.mark.parametrize(
    ("degrees", "known"), [(0.0, True), (5.0, True), (8.0, False), (97.0, False)]
)
def test_an_echo_oblique_to_the_rooms_walls_is_no_wall(degrees: float, *, known: bool) -> None:
    """Such an echo may be from an edge within the cone, whose place changes."""
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.walls.see_line(line(0.0, 0.8))
    assert {wall.frame for wall in room.walls.walls} == {0}
    room.believe(-1.5, 0.0, degrees * DEGREE)  # neither of the two is ahead there
    measurement = FrontMeasurement(0.5, 0.002**2)
    assert not room.walls.see_front(measurement, MODEL.ultrasonic)
    assert len(room.walls.walls) == 2 + known
    assert room.walls.see_front(measurement, MODEL.ultrasonic) is known


def test_an_oblique_echo_is_compared_with_walls_that_only_the_infrared_saw() -> None:
    room = Room()
    room.believe(-1.5, 0.0, 8.0 * DEGREE)
    oblique = FrontMeasurement(0.5, 0.002**2)
    room.walls.see_front(oblique, MODEL.ultrasonic)
    assert room.walls.see_front(oblique, MODEL.ultrasonic), "no room is known yet"
    room.believe(1.5, 0.0, -8.0 * DEGREE)
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.walls.see_line(line(0.0, 0.8))
    room.believe(-1.5, 0.0, 8.0 * DEGREE)
    assert not room.walls.see_front(oblique, MODEL.ultrasonic)
    # 6.5° off the wall ahead, of whose line a stretch was seen
    room.believe(1.5, 0.0, -1.5 * DEGREE)
    to_wall = FrontMeasurement(0.8 - MODEL.ultrasonic.x_m * math.cos(6.5 * DEGREE), 0.002**2)
    assert room.walls.see_front(to_wall, MODEL.ultrasonic)


def test_a_surface_far_outside_the_uncertainty_is_another() -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.inflate(0.003, 0.0)
    assert not room.walls.see_line(line(math.pi / 2, 0.54))
    assert room.filter.pose == ORIGIN
    assert len(room.walls.walls) == 2


def test_the_wall_corrects_an_over_confident_estimate() -> None:
    """A segment in front of the wall cannot be another wall: the estimate was wrong."""
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.inflate(0.001, 0.02 * DEGREE)
    room.believe(0.0, 0.02, 0.0)
    assert room.walls.see_line(line(math.pi / 2, 0.5))
    assert abs(room.filter.pose.y_m) < 0.005
    assert room.filter.path_noise.value > 1.0


def test_memory_is_bounded_and_a_restart_clears_it() -> None:
    room = Room()
    for i in range(3 * MAX_WALLS):
        room.walls.see_line(line(0.03 * i, 0.3 + 0.11 * i))
    assert len(room.walls.walls) == MAX_WALLS
    assert room.filter.joint_covariance.size == STATES + 2 * MAX_WALLS
    assert len(room.filter.walls) == 2 * MAX_WALLS
    room.filter.restart(ORIGIN)
    assert room.walls.heading_sigma_rad == 0.0
    assert room.filter.joint_covariance.size == STATES
    room.walls.see_line(line(0.0, 0.5))
    assert len(room.walls.walls) == 1


def test_the_joint_covariance_stays_positive() -> None:
    rng = random.Random(4)
    room = Room()
    for _ in range(300):
        room.inflate(rng.uniform(0, 0.003), rng.uniform(0, 0.2) * DEGREE)
        normal = rng.choice((0.0, 0.5, 1.0, 1.5)) * math.pi + rng.gauss(0, 0.3 * DEGREE)
        room.walls.see_line(line(normal, 0.5 + rng.gauss(0, 0.003)))
    p = room.filter.joint_covariance.p
    assert np.allclose(p, p.T)
    assert float(np.linalg.eigvalsh(p).min()) > -1e-12
    assert p[THETA, THETA] > 0.0


def test_a_wall_mapped_twice_still_gives_the_heading() -> None:
    room = Room()
    for measurement in (line(math.pi / 2, 0.5), line(0.0, 0.8)):
        room.walls.see_line(measurement)
    room.believe(1.2, 0.0, 0.0)  # farther along the first wall, beyond its known part
    room.walls.see_line(line(math.pi / 2, 0.5))
    walls = room.walls.walls
    assert len(walls) == 3
    assert len({wall.frame for wall in walls}) == 1
    # between both, where the sight may be of either
    room.believe(-0.6, 0.0, 0.0)
    room.inflate(0.01, DEGREE)
    room.believe(0.0, 0.0, 0.8 * DEGREE)
    assert room.walls.see_line(line(math.pi / 2, 0.5))
    assert abs(room.filter.pose.theta_rad) < 0.2 * DEGREE


def test_an_ambiguous_wall_is_not_used() -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.inflate(0.0, 4.0 * DEGREE)  # so that they are not found to be parallel
    room.believe(1.2, 0.02, 0.0)
    room.walls.see_line(line(math.pi / 2, 0.5))  # a step of 2 cm, or an error
    assert [wall.frame for wall in room.walls.walls] == [-1, -1]
    room.believe(-0.6, -0.01, 0.0)
    room.inflate(0.02, DEGREE)
    assert not room.walls.see_line(line(math.pi / 2, 0.5))


@pytest.mark.parametrize(("off_deg", "taken"), [(0.4, True), (1.8, False)])
def test_a_cupboards_front_before_a_wall_is_not_that_wall(off_deg: float, *, taken: bool) -> None:
    room = Room()
    for measurement in (line(math.pi / 2, 0.5), line(0.0, 0.8)):
        room.walls.see_line(measurement)
    room.believe(1.2, 0.0, 0.0)
    room.walls.see_line(line(math.pi / 2, 0.475))
    walls = room.walls.walls
    assert len(walls) == 3
    assert len({wall.frame for wall in walls}) == 1, "parallel, 2.5 cm apart, and surely so"
    room.believe(-0.6, 0.0, 0.0)
    room.inflate(0.02, DEGREE)
    room.believe(0.0, 0.0, off_deg * DEGREE)
    before = room.filter.pose
    assert not room.walls.see_line(line(math.pi / 2, 0.49)), "it may be either"
    pose = room.filter.pose
    assert pose.y_m == pytest.approx(before.y_m, abs=1e-3)
    assert (abs(pose.theta_rad) < 0.05 * DEGREE) is taken, "both have one direction"


def marked(before_m: float = 0.0) -> Room:
    """Return a wall along y = 0.5 to -0.5, at x = 0.8.

    The ultrasonic has measured a place on it, or in front of it.
    """
    room = Room()
    room.walls.see_line(line(0.0, 0.8))
    room.believe(0.0, 0.4, 0.0)
    ahead = FrontMeasurement(0.8 - before_m - MODEL.ultrasonic.x_m, 0.001**2)
    assert not room.walls.see_front(ahead, MODEL.ultrasonic), "beyond what is known of the wall"
    room.believe(0.0, -0.4, 0.0)
    room.walls.walls[0].low_m, room.walls.walls[0].high_m = -0.5, 0.5
    assert [wall.seen_m for wall in room.walls.walls] == [pytest.approx(0.3), 0.0]
    return room


@pytest.mark.parametrize(("frame", "high_m"), [(-1, 0.5), (0, 0.5), (-1, 0.25)])
@pytest.mark.parametrize("off_deg", [-0.8, 0.8])
def test_a_place_that_the_ultrasonic_saw_on_a_wall_is_that_wall(
    off_deg: float, frame: int, high_m: float
) -> None:
    room = marked()
    room.walls.walls[0].high_m = high_m
    for wall in room.walls.walls:
        wall.frame = frame
    room.inflate(0.01, DEGREE)
    room.believe(0.0, 0.0, off_deg * DEGREE)
    assert room.walls.see_line(line(0.0, 0.8))
    assert abs(room.filter.pose.theta_rad) < 0.1 * DEGREE
    assert [wall.measurements for wall in room.walls.walls] == [2, 1]


@pytest.mark.parametrize("off_m", [-0.01, 0.01])
def test_the_ultrasonic_assigns_such_a_place_to_the_wall_too(off_m: float) -> None:
    room = marked()
    room.believe(0.0, 0.45, 0.0)
    room.inflate(0.01, 0.0)
    room.believe(off_m, 0.0, 0.0)
    measurement = FrontMeasurement(0.8 - MODEL.ultrasonic.x_m, 0.001**2)
    assert room.walls.see_front(measurement, MODEL.ultrasonic)
    assert abs(room.filter.pose.x_m) < 0.001
    assert [wall.measurements for wall in room.walls.walls] == [2, 1]


def test_a_place_in_front_of_a_wall_or_beside_it_is_not_of_the_wall() -> None:
    before, beside = marked(before_m=0.025), marked()
    beside.walls.walls[0].high_m = 0.15  # known up to 25 cm from that place
    for room in (before, beside):
        room.inflate(0.02, 0.5 * DEGREE)
        room.believe(0.0125, 0.0, 0.0)
        assert not room.walls.see_line(line(0.0, 0.8)), "it may be either"
        room.believe(0.0, 0.25, 0.0)
        ahead = FrontMeasurement(0.8 - MODEL.ultrasonic.x_m, 0.001**2)
        assert not room.walls.see_front(ahead, MODEL.ultrasonic)
        assert [wall.measurements for wall in room.walls.walls] == [1, 1]


def test_uncertainty_of_a_walls_direction_moves_its_far_end() -> None:
    """With a direction known to a degree, a place 1 m along and 2 cm off may be on the wall."""
    room = Room()
    room.walls.see_line(line(0.0, 0.8)._replace(var_normal=DEGREE**2))
    room.believe(0.0, 1.0, 0.0)
    ahead = FrontMeasurement(0.78 - MODEL.ultrasonic.x_m, 0.001**2)
    assert not room.walls.see_front(ahead, MODEL.ultrasonic)
    room.walls.walls[0].high_m = 1.2
    assert room.walls.see_line(line(0.0, 0.79))
    assert [wall.measurements for wall in room.walls.walls] == [2, 1]


def test_two_places_that_only_the_ultrasonic_saw_are_not_associated() -> None:
    room = Room()
    ahead = FrontMeasurement(0.8 - MODEL.ultrasonic.x_m, 0.001**2)
    for step_m in (0.0, 0.4):
        room.believe(0.0, step_m, 0.0)
        assert not room.walls.see_front(ahead, MODEL.ultrasonic)
    room.believe(0.0, -0.2, 0.0)  # between both
    assert not room.walls.see_front(ahead, MODEL.ultrasonic)
    assert len(room.walls.walls) == 2


@pytest.mark.parametrize("step_m", [0.015, 0.02, 0.025])
@pytest.mark.parametrize("drift_m", [0.005, 0.01, 0.015, 0.02])
@pytest.mark.parametrize("by_infrared", [False, True])
def test_a_cupboard_that_may_be_the_wall_is_still_itself(
    step_m: float, drift_m: float, *, by_infrared: bool
) -> None:
    """The ultrasonic detected it before the wall was followed: it is in front of it, or part of it.

    By then the wall is certain, so an unexpected reading does not count as the wall.
    """
    room = Room()
    cupboard = FrontMeasurement(0.8 - step_m - MODEL.ultrasonic.x_m, 0.002**2)
    assert not room.walls.see_front(cupboard, MODEL.ultrasonic)
    room.inflate(drift_m, 0.3 * DEGREE)
    for forth_m in (0.8, 0.0, 0.2, -0.3):
        room.believe(0.0, forth_m, 0.0)
        room.walls.see_line(line(0.0, 0.8))
    room.walls.walls[1].low_m = -1.2  # and on its other side
    room.believe(0.0, -room.filter.pose.y_m, 0.0)
    x_m = room.filter.pose.x_m
    for _ in range(5):
        if by_infrared:
            assert room.walls.see_line(line(0.0, 0.8 - step_m))
        else:
            room.believe(0.0, 0.001, 0.0)
            assert room.walls.see_front(cupboard, MODEL.ultrasonic)
        assert room.filter.pose.x_m == pytest.approx(x_m, abs=0.001)
    assert [wall.measurements > 5 for wall in room.walls.walls] == [True, False]
    assert len(room.walls.walls) == 2
