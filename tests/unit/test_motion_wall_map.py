"""Sights of walls, walls remembered, and what the joint covariance makes of both."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from bridge.motion.belief import Belief
from bridge.motion.geometry import Pose2
from bridge.motion.pose_filter import STATES, THETA, PoseFilter
from bridge.motion.robot_model import RobotModel
from bridge.motion.wall_map import MAX_WALLS, WallMap
from bridge.motion.wall_sight import FLAT_M, FLAT_RAD, FrontSight, FrontSights, LineSight, SideSight

MODEL = RobotModel()
ORIGIN = Pose2(0.0, 0.0, 0.0)
DEGREE = math.radians(1.0)
SURE = 0.05 * DEGREE


# ---- sights ----------------------------------------------------------------------------


def drive_by(  # noqa: PLR0913 - a wall and a drive
    wall_y: float,
    slope_rad: float,
    *,
    way_m: float = 0.3,
    noise_m: float = 0.0,
    bow_m: float = 0.0,
    seed: int = 0,
) -> LineSight | None:
    """Past a wall on the left whose place at x = 0 is ``wall_y``; a reading each centimetre."""
    rng = random.Random(seed)
    mount = MODEL.infrared_left
    side = SideSight(mount)
    pose = ORIGIN
    for i in range(round(way_m / 0.01) + 1):
        pose = Pose2(0.01 * i, 0.0, 0.0)
        x = pose.x_m + mount.x_m
        bow = bow_m * (1.0 - (2.0 * 0.01 * i / way_m - 1.0) ** 2)
        range_m = wall_y + x * math.tan(slope_rad) - bow - mount.y_m + rng.gauss(0, noise_m)
        side.add(pose, range_m, moving=True, steady=True)
    return side.add(pose, None, moving=True, steady=True)


@pytest.mark.parametrize("degrees", [-6.0, 0.0, 4.0])
def test_a_sight_is_the_walls_line_from_the_last_place(degrees: float) -> None:
    sight = drive_by(0.2, degrees * DEGREE)
    assert sight is not None
    assert sight.normal_rad == pytest.approx(math.pi / 2 + degrees * DEGREE, abs=1e-6)
    # the wall through (0, 0.2) at its slope, seen from (0.3, 0)
    expected = (0.2 + 0.3 * math.tan(degrees * DEGREE)) * math.cos(degrees * DEGREE)
    assert sight.distance_m == pytest.approx(expected, abs=1e-6)
    assert sight.span_m == pytest.approx(0.3 / math.cos(degrees * DEGREE), abs=1e-6)
    # to the left of the robot the wall's direction runs backwards: the stretch lies behind
    assert sight.high_m > 0.2
    assert sight.low_m > -0.1


def test_a_sights_variance_is_that_of_its_errors() -> None:
    """Over many noisy passes at 10 cm, where the sigma is 1.5 and 1.2 mm together."""
    sights = [drive_by(0.2, 0.0, noise_m=0.0019, seed=seed) for seed in range(300)]
    seen = [s for s in sights if s is not None]
    assert len(seen) > 295
    turn = np.array([s.normal_rad - math.pi / 2 for s in seen])
    off = np.array([s.distance_m - 0.2 for s in seen])
    ahead = 0.10  # from the robot's place at the end to the middle of the stretch
    flat = FLAT_M**2 + (ahead * FLAT_RAD) ** 2  # which no averaging takes away, nor is it here
    var_turn = float(np.mean([s.var_normal for s in seen])) - FLAT_RAD**2
    var_off = float(np.mean([s.var_distance for s in seen])) - flat
    assert 0.7 < float((turn**2).mean()) / var_turn < 1.3
    assert 0.7 < float((off**2).mean()) / var_off < 1.3
    assert float((turn * off).mean()) * float(np.mean([s.covar for s in seen])) > 0.0


def test_curves_jumps_and_short_stretches_are_no_walls() -> None:
    assert drive_by(0.2, 0.0, bow_m=0.006) is None
    assert drive_by(0.2, 0.0, way_m=0.07) is None
    assert drive_by(0.2, 0.0, noise_m=0.015, seed=3) is None
    side = SideSight(MODEL.infrared_left)
    for i in range(12):
        assert side.add(Pose2(0.01 * i, 0, 0), 0.10, moving=True, steady=True) is None
    first = side.add(Pose2(0.12, 0, 0), 0.20, moving=True, steady=True)
    assert first is not None
    assert first.span_m == pytest.approx(0.11)


def test_what_is_read_in_a_quick_turn_is_left_out_and_ends_nothing() -> None:
    side = SideSight(MODEL.infrared_left)
    for i in range(31):
        quick = i % 5 == 3
        range_m = 0.15 if quick else 0.10
        pose = Pose2(0.01 * i, 0, 0)
        assert side.add(pose, range_m, moving=True, steady=not quick) is None
    sight = side.add(pose, 0.10, moving=False, steady=True)  # it stands: the stretch is over
    assert sight is not None
    assert sight.span_m == pytest.approx(0.30)
    assert sight.normal_rad == pytest.approx(math.pi / 2)


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
    side = SideSight(MODEL.infrared_left)
    for i in range(16):
        side.add(Pose2(0.01 * i, 0, 0), 0.10, moving=True, steady=True)
    assert side.add(Pose2(0.17, 0, 0), 0.10, moving=True, steady=False) is None
    sight = side.add(Pose2(0.15 + gap_m, 0, turn_deg * DEGREE), 0.10, moving=True, steady=True)
    assert (sight is None) is joined


def test_the_front_is_seen_from_where_the_robot_is_now() -> None:
    front = FrontSights(MODEL.ultrasonic)
    found = [front.add(Pose2(0.01 * i, 0, 0), 0.8 - 0.01 * i, steady=True) for i in range(5)]
    assert found[:4] == [None] * 4
    assert found[4] is not None
    assert found[4].range_m == pytest.approx(0.76)
    standing = [front.add(Pose2(0.04, 0, 0), 0.76, steady=True) for _ in range(20)]
    assert standing == [None] * 20, "standing, its errors would repeat"
    edge = [0.7, 0.69, 0.9, 0.89, 0.88]
    moved = [front.add(Pose2(0.1 + 0.01 * i, 0, 0), r, steady=True) for i, r in enumerate(edge)]
    assert moved == [None] * 5


# ---- the belief ------------------------------------------------------------------------


def test_a_state_appended_shares_the_doubt_that_it_was_made_of() -> None:
    belief = Belief((4.0, 1.0))
    first = belief.append((0,), np.array([[1.0]]), np.array([[0.5]]))
    assert first == 2
    assert belief.p[2, 2] == pytest.approx(4.5)
    assert belief.p[0, 2] == pytest.approx(4.0)
    # seeing that their difference is as it was tells nothing of either
    belief.update((0, 2), np.array([[1.0, -1.0]]), np.zeros(1), np.array([[1e-9]]))
    assert belief.p[0, 0] == pytest.approx(4.0)
    belief.remove(2, 1)
    assert belief.size == 2


def test_an_update_is_kalmans() -> None:
    belief = Belief((4.0,))
    step = belief.update((0,), np.array([[2.0]]), np.array([1.0]), np.array([[9.0]]))
    assert step[0] == pytest.approx(4.0 * 2.0 / 25.0)
    assert belief.p[0, 0] == pytest.approx(4.0 - 8.0 * 8.0 / 25.0)


def test_a_held_state_counts_with_its_doubt_and_stays() -> None:
    """Schmidt's filter, by hand: s = 4 + 1 + 4, gains 4/9 and, held, 0."""
    belief = Belief((4.0, 1.0))
    row = np.array([[1.0, 1.0]])
    step = belief.update((0, 1), row, np.array([9.0]), np.array([[4.0]]), held=(1,))
    assert step == pytest.approx([4.0, 0.0])
    assert belief.p == pytest.approx(np.array([[4.0 - 16.0 / 9.0, -4.0 / 9.0], [-4.0 / 9.0, 1.0]]))
    # (I - KH) P (I - KH)' + KRK', Joseph's form, which holds for any gain
    gain = np.array([[4.0 / 9.0], [0.0]])
    keep = np.eye(2) - gain @ row
    joseph = keep @ np.diag([4.0, 1.0]) @ keep.T + 4.0 * gain @ gain.T
    assert belief.p == pytest.approx(joseph)


# ---- walls -----------------------------------------------------------------------------


def line(normal_rad: float, distance_m: float, span_m: float = 0.3) -> LineSight:
    half = 0.5 * span_m
    return LineSight(normal_rad, distance_m, SURE**2, 0.0, 0.001**2, -half, half)


class Room:
    """A filter, its walls, and a hand that makes it doubt."""

    def __init__(self) -> None:
        self.filter = PoseFilter(ORIGIN)
        self.walls = WallMap(self.filter)

    def doubt(self, sigma_m: float, sigma_rad: float) -> None:
        self.filter.disturb(sigma_m, sigma_rad)

    def believe(self, x: float, y: float, theta: float) -> None:
        step = np.zeros(self.filter.belief.size)
        step[:3] = x, y, theta
        self.filter.apply(step)


def test_a_wall_seen_again_takes_the_drift_away() -> None:
    room = Room()
    assert not room.walls.see_line(line(math.pi / 2, 0.5)), "new"
    room.doubt(0.02, DEGREE)
    room.believe(0.01, 0.012, 0.6 * DEGREE)  # an error, within the doubt
    assert room.walls.see_line(line(math.pi / 2, 0.5))
    pose = room.filter.pose
    assert pose.y_m == pytest.approx(0.0, abs=0.001)
    assert pose.theta_rad == pytest.approx(0.0, abs=0.1 * DEGREE)
    assert pose.x_m == pytest.approx(0.01, abs=0.002), "along the wall nothing is known"


def test_a_wall_first_seen_in_doubt_gives_no_more_than_was_known_then() -> None:
    room = Room()
    room.doubt(0.03, 2.0 * DEGREE)
    before = room.filter.covariance
    room.walls.see_line(line(math.pi / 2, 0.5))
    for _ in range(50):
        room.walls.see_line(line(math.pi / 2, 0.5))
    after = room.filter.covariance
    assert after[1][1] == pytest.approx(before[1][1], rel=1e-3)
    assert after[2][2] == pytest.approx(before[2][2], rel=1e-3)


def test_squareness_is_used_where_the_evidence_is_for_it() -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.doubt(0.0, 0.5 * DEGREE)
    room.believe(0.0, 0.0, 0.4 * DEGREE)
    room.walls.see_line(line(0.0, 0.8))  # square to the first; the heading is 0.4° off
    assert abs(room.filter.pose.theta_rad) < 0.15 * DEGREE


@pytest.mark.parametrize("degrees", [2.5, 4.0, 12.0])
def test_an_askew_box_bends_nothing(degrees: float) -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.doubt(0.0, 0.5 * DEGREE)
    room.walls.see_line(line(degrees * DEGREE, 0.8))
    assert room.filter.pose == ORIGIN
    assert len(room.walls.walls) == 2
    assert all(wall.frame < 0 for wall in room.walls.walls)
    # and is a reference of its own
    room.believe(0.0, 0.0, 0.3 * DEGREE)
    assert room.walls.see_line(line(degrees * DEGREE, 0.8))
    assert abs(room.filter.pose.theta_rad) < 0.1 * DEGREE


def test_long_walls_are_square_though_their_angle_is_less_sure() -> None:
    """Drift between two walls of 1.7° is below their doubt; a box's side would not be so long."""
    for span_m, squared in ((0.3, False), (0.6, True)):
        room = Room()
        room.walls.see_line(line(math.pi / 2, 0.5, span_m))
        room.doubt(0.0, 1.5 * DEGREE)
        room.believe(0.0, 0.0, 1.7 * DEGREE)
        room.walls.see_line(line(0.0, 0.8, span_m))
        off = abs(room.filter.pose.theta_rad)
        assert (off < 0.15 * DEGREE) is squared
        assert off < 0.15 * DEGREE or off == pytest.approx(1.7 * DEGREE)


def test_two_frames_of_square_walls_become_one() -> None:
    """A pair that stands askew to the first until both have been seen for long enough."""
    room = Room()
    first = (line(math.pi / 2, 0.5), line(0.0, 0.8))
    for sight in first:
        room.walls.see_line(sight)
    room.doubt(0.0, 1.5 * DEGREE)
    room.believe(0.0, 0.0, 1.7 * DEGREE)
    for sight in (line(-math.pi / 2, 1.5), line(math.pi, 1.8)):
        room.walls.see_line(sight)
    walls = room.walls.walls
    assert walls[0].frame == walls[1].frame != walls[2].frame == walls[3].frame
    assert room.filter.pose.theta_rad == pytest.approx(1.7 * DEGREE)
    room.walls.see_line(line(-math.pi / 2, 1.5))  # now for 0.6 m, but the first for 0.3 m
    assert room.filter.pose.theta_rad == pytest.approx(1.7 * DEGREE, abs=1e-6)
    walls[0].seen_m = 0.6
    room.walls.see_line(line(-math.pi / 2, 1.5))
    assert len({wall.frame for wall in walls}) == 1
    assert abs(room.filter.pose.theta_rad) < 0.2 * DEGREE
    for i in range(4):
        assert abs(math.remainder(room.walls.normal_rad(i), math.pi / 2)) < 0.2 * DEGREE


def test_a_short_stretch_beside_a_walls_end_may_be_a_column() -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))  # seen from -0.15 to 0.15 m
    room.doubt(0.01, DEGREE)

    def beside(at_m: float, span_m: float) -> LineSight:
        half = 0.5 * span_m
        return line(math.pi / 2, 0.5)._replace(low_m=at_m - half, high_m=at_m + half)

    assert not room.walls.see_line(beside(0.45, 0.12))
    assert room.walls.see_line(beside(0.45, 0.2))
    assert room.walls.see_line(beside(0.65, 0.12)), "at the end of what is known by now"


def test_a_wall_may_be_as_far_off_as_the_doubt() -> None:
    for sigma_m, known in ((0.02, False), (0.06, True)):
        room = Room()
        room.walls.see_line(line(0.0, 0.8))
        room.doubt(sigma_m, 0.0)
        room.believe(0.1, 0.0, 0.0)
        sight = FrontSight(0.8 - MODEL.ultrasonic.x_m, 0.002**2)
        assert room.walls.see_front(sight, MODEL.ultrasonic) is known
        assert (abs(room.filter.pose.x_m) < 0.002) is known


def test_the_ultrasonic_corrects_along_its_view() -> None:
    room = Room()
    room.walls.see_line(line(0.0, 0.8))
    room.doubt(0.02, 0.0)
    room.believe(0.015, 0.01, 0.0)
    assert room.walls.see_front(FrontSight(0.8 - MODEL.ultrasonic.x_m, 0.002**2), MODEL.ultrasonic)
    assert room.filter.pose.x_m == pytest.approx(0.0, abs=0.001)
    assert room.filter.pose.y_m == pytest.approx(0.01)


def test_a_surface_of_unknown_direction_tells_nothing_of_the_wheels() -> None:
    """Askew by 5°, its range shrinks by 4 permille less than the way: no fault of the tyres."""
    room = Room()
    mount = MODEL.ultrasonic
    scale = room.filter.wheel_scale_sigma
    for i in range(6):
        assert room.walls.see_front(FrontSight(0.9 - 0.0996 * i, 0.001**2), mount) is (i > 0)
        room.filter.advance(0.1, 0.0, 0.5, 0.5, by_wheels=False)
        room.filter.settle()
    assert room.filter.wheel_scale == 1.0
    assert room.filter.wheel_scale_sigma == scale


@pytest.mark.parametrize(
    ("degrees", "known"), [(0.0, True), (5.0, True), (8.0, False), (97.0, False)]
)
def test_an_echo_askew_to_the_rooms_walls_is_no_wall(degrees: float, *, known: bool) -> None:
    """It may be an edge within the cone, which is elsewhere for the next look."""
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.walls.see_line(line(0.0, 0.8))
    assert {wall.frame for wall in room.walls.walls} == {0}
    room.believe(-1.5, 0.0, degrees * DEGREE)  # where neither of the two is ahead
    sight = FrontSight(0.5, 0.002**2)
    assert not room.walls.see_front(sight, MODEL.ultrasonic)
    assert len(room.walls.walls) == 2 + known
    assert room.walls.see_front(sight, MODEL.ultrasonic) is known


def test_an_echo_askew_is_held_against_walls_that_the_infrared_saw_only() -> None:
    room = Room()
    room.believe(-1.5, 0.0, 8.0 * DEGREE)
    askew = FrontSight(0.5, 0.002**2)
    room.walls.see_front(askew, MODEL.ultrasonic)
    assert room.walls.see_front(askew, MODEL.ultrasonic), "no room is known yet"
    room.believe(1.5, 0.0, -8.0 * DEGREE)
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.walls.see_line(line(0.0, 0.8))
    room.believe(-1.5, 0.0, 8.0 * DEGREE)
    assert not room.walls.see_front(askew, MODEL.ultrasonic)
    # 6.5° off the wall ahead, of whose line a stretch was seen
    room.believe(1.5, 0.0, -1.5 * DEGREE)
    to_wall = FrontSight(0.8 - MODEL.ultrasonic.x_m * math.cos(6.5 * DEGREE), 0.002**2)
    assert room.walls.see_front(to_wall, MODEL.ultrasonic)


def test_a_surface_far_off_the_doubt_is_another() -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.doubt(0.003, 0.0)
    assert not room.walls.see_line(line(math.pi / 2, 0.54))
    assert room.filter.pose == ORIGIN
    assert len(room.walls.walls) == 2


def test_the_wall_itself_is_believed_against_too_sure_an_estimate() -> None:
    """A stretch before the very wall cannot be another one: the estimate had it wrong."""
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.doubt(0.001, 0.02 * DEGREE)
    room.believe(0.0, 0.02, 0.0)
    assert room.walls.see_line(line(math.pi / 2, 0.5))
    assert abs(room.filter.pose.y_m) < 0.005
    assert room.filter.way_noise.value > 1.0


def test_memory_is_bounded_and_a_restart_forgets() -> None:
    room = Room()
    for i in range(3 * MAX_WALLS):
        room.walls.see_line(line(0.03 * i, 0.3 + 0.11 * i))
    assert len(room.walls.walls) == MAX_WALLS
    assert room.filter.belief.size == STATES + 2 * MAX_WALLS
    assert len(room.filter.walls) == 2 * MAX_WALLS
    room.filter.restart(ORIGIN)
    assert room.walls.heading_doubt_rad == 0.0
    assert room.filter.belief.size == STATES
    room.walls.see_line(line(0.0, 0.5))
    assert len(room.walls.walls) == 1


def test_the_joint_covariance_stays_positive() -> None:
    rng = random.Random(4)
    room = Room()
    for _ in range(300):
        room.doubt(rng.uniform(0, 0.003), rng.uniform(0, 0.2) * DEGREE)
        normal = rng.choice((0.0, 0.5, 1.0, 1.5)) * math.pi + rng.gauss(0, 0.3 * DEGREE)
        room.walls.see_line(line(normal, 0.5 + rng.gauss(0, 0.003)))
    p = room.filter.belief.p
    assert np.allclose(p, p.T)
    assert float(np.linalg.eigvalsh(p).min()) > -1e-12
    assert p[THETA, THETA] > 0.0


def test_the_headings_doubt_is_that_against_the_square_walls() -> None:
    room = Room()
    assert room.walls.heading_doubt_rad == 0.0
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.doubt(0.0, 0.5 * DEGREE)
    assert room.walls.heading_doubt_rad == 0.0, "one wall squares with nothing"
    room.walls.see_line(line(0.0, 0.8))
    known = room.walls.heading_doubt_rad
    assert 0.0 < known < 0.25 * DEGREE
    # what the whole map is turned by does not count, what was drifted since does
    room.doubt(0.0, 1.0 * DEGREE)
    assert room.walls.heading_doubt_rad == pytest.approx(math.hypot(known, DEGREE), rel=1e-3)
    room.walls.see_line(line(math.pi / 2, 0.5))
    assert room.walls.heading_doubt_rad < 0.25 * DEGREE
    room.filter.restart(ORIGIN)
    assert room.walls.heading_doubt_rad == 0.0, "and a restart knows no walls"


@pytest.mark.parametrize(("span_m", "hides"), [(0.2, False), (0.6, True)])
def test_of_two_frames_that_counts_of_which_most_was_seen(span_m: float, *, hides: bool) -> None:
    """A box that stands askew, just gone round, does not tell how sure the lanes' heading is."""
    room = Room()
    for sight in (line(math.pi / 2, 0.5), line(0.0, 0.8)):
        room.walls.see_line(sight)
    room.doubt(0.0, 2.0 * DEGREE)
    doubt = room.walls.heading_doubt_rad
    askew = 20.0 * DEGREE
    for sight in (line(math.pi / 2 + askew, 0.9, span_m), line(askew, 0.9, span_m)):
        room.walls.see_line(sight)
    walls = room.walls.walls
    assert walls[0].frame == walls[1].frame != walls[2].frame == walls[3].frame >= 0
    assert (room.walls.heading_doubt_rad < 0.25 * DEGREE < doubt) is hides


def test_a_wall_that_the_map_holds_twice_still_tells_the_heading() -> None:
    room = Room()
    for sight in (line(math.pi / 2, 0.5), line(0.0, 0.8)):
        room.walls.see_line(sight)
    room.believe(1.2, 0.0, 0.0)  # farther along the first wall, beyond what was seen of it
    room.walls.see_line(line(math.pi / 2, 0.5))
    walls = room.walls.walls
    assert len(walls) == 3
    assert len({wall.frame for wall in walls}) == 1
    # between both, where the sight may be of either
    room.believe(-0.6, 0.0, 0.0)
    room.doubt(0.01, DEGREE)
    room.believe(0.0, 0.0, 0.8 * DEGREE)
    assert room.walls.see_line(line(math.pi / 2, 0.5))
    assert abs(room.filter.pose.theta_rad) < 0.2 * DEGREE


def test_of_two_walls_that_may_be_meant_none_is_taken() -> None:
    room = Room()
    room.walls.see_line(line(math.pi / 2, 0.5))
    room.doubt(0.0, 4.0 * DEGREE)  # so that they are not found to be parallel
    room.believe(1.2, 0.02, 0.0)
    room.walls.see_line(line(math.pi / 2, 0.5))  # a step of 2 cm, or an error
    assert [wall.frame for wall in room.walls.walls] == [-1, -1]
    room.believe(-0.6, -0.01, 0.0)
    room.doubt(0.02, DEGREE)
    assert not room.walls.see_line(line(math.pi / 2, 0.5))


def test_a_cupboards_front_before_a_wall_is_not_that_wall() -> None:
    room = Room()
    for sight in (line(math.pi / 2, 0.5), line(0.0, 0.8)):
        room.walls.see_line(sight)
    room.believe(1.2, 0.0, 0.0)
    room.walls.see_line(line(math.pi / 2, 0.475))
    walls = room.walls.walls
    assert len(walls) == 3
    assert len({wall.frame for wall in walls}) == 1, "parallel, 2.5 cm apart, and surely so"
    room.believe(-0.6, 0.0, 0.0)
    room.doubt(0.02, 0.5 * DEGREE)
    assert not room.walls.see_line(line(math.pi / 2, 0.49)), "it may be either"


def test_a_frame_of_which_more_is_seen_later_counts_then() -> None:
    room = Room()
    askew = 20.0 * DEGREE
    box = (line(math.pi / 2 + askew, 0.4, 0.4), line(askew, 0.4, 0.4))
    for sight in box:
        room.walls.see_line(sight)
    room.doubt(0.0, 2.0 * DEGREE)  # of the angle between the box and the room
    for sight in (line(math.pi / 2, 0.9), line(0.0, 0.9)):
        room.walls.see_line(sight)
    assert room.walls.heading_doubt_rad > DEGREE, "against the box, of which more was seen"
    for _ in range(2):
        room.walls.see_line(line(math.pi / 2, 0.9))
    assert room.walls.heading_doubt_rad < 0.25 * DEGREE, "against the room"


def test_a_wall_forgotten_stands_for_no_others() -> None:
    room = Room()
    askew, between = line(0.3, 0.3, 0.15), line(0.9, 1.7)
    for sight in (askew, *[line(math.pi / 2, 0.5)] * 3, *[between] * 3, *[line(0.0, 0.8)] * 3):
        room.walls.see_line(sight)
    assert [wall.frame for wall in room.walls.walls] == [-1, 0, -1, 0]
    room.doubt(0.0, DEGREE)
    doubt = room.walls.heading_doubt_rad
    assert doubt > DEGREE
    for i in range(MAX_WALLS - 3):  # the first one goes, and others of which little was seen come
        room.walls.see_line(line(0.5 + 0.02 * i, 1.0 + 0.11 * i, 0.15))
    assert len(room.walls.walls) == MAX_WALLS
    assert room.walls.heading_doubt_rad == pytest.approx(doubt, rel=1e-6)
