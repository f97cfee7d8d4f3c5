"""Stored segments of followed walls, which a later run uses to measure the heading again."""

from __future__ import annotations

import math

import pytest

from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.wall_segments import Start, WallSegments
from bridge.motion.geometry import Pose2

LEFT, RIGHT = 1, -1
OPTIONS = RecoveryOptions()
OFF_M = OPTIONS.fix_off_m
QUARTER = 0.5 * math.pi


def follow(segments: WallSegments, side: int, *poses: tuple[float, float, float]) -> None:
    for pose in poses:
        segments.follow(Pose2(*pose), side, straight=True)


def one(start: Start, x: float, y: float, heading: float) -> bool:
    return start == pytest.approx((x, y, heading))


def test_a_stretch_is_begun_from_either_end_a_little_off_the_wall() -> None:
    segments = WallSegments(OPTIONS)
    assert segments.starts() == []
    follow(segments, LEFT, (1.0, 2.0, 0.0), (1.5, 2.0, 0.0), (2.0, 2.0, 0.0))
    segments.end(Pose2(2.0, 2.0, 0.0), LEFT)
    # The wall is above the path. So both starts are below it, one for each direction of travel.
    forth, back = segments.starts()
    assert one(forth, 1.0, 2.0 - OFF_M, 0.0)
    assert one(back, 2.0, 2.0 - OFF_M, -math.pi)


def test_a_wall_on_the_right_is_kept_off_on_the_left() -> None:
    segments = WallSegments(OPTIONS)
    follow(segments, RIGHT, (0.0, 0.0, QUARTER))
    segments.end(Pose2(0.0, 1.0, QUARTER), RIGHT)
    assert one(segments.starts()[0], -OFF_M, 0.0, QUARTER)


def test_short_and_bent_ones_are_not_kept_and_a_corner_parts_two() -> None:
    segments = WallSegments(OPTIONS)
    follow(segments, LEFT, (0.0, 0.0, 0.0), (0.4, 0.0, 0.0))
    segments.end(Pose2(0.4, 0.0, 0.0), LEFT)
    assert segments.starts() == []
    # The path around a column of 1 m is never straight for half a metre.
    for k in range(100):
        at = 0.1 * k
        segments.follow(Pose2(math.cos(at), math.sin(at), at + QUARTER), LEFT, straight=True)
    assert segments.starts() == []
    segments = WallSegments(OPTIONS)
    follow(segments, LEFT, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    segments.follow(Pose2(1.0, 0.1, 0.1), LEFT, straight=False)
    follow(segments, LEFT, (1.0, 0.2, QUARTER), (1.0, 1.2, QUARTER))
    segments.end(Pose2(1.0, 1.2, QUARTER), LEFT)
    assert len(segments.starts()) == 4
    assert one(segments.starts()[-1], 1.0 + OFF_M, 1.2, -QUARTER)


def test_the_longest_are_kept() -> None:
    segments = WallSegments(OPTIONS)
    for k in range(60):
        follow(segments, LEFT, (0.0, float(k), 0.0))
        segments.end(Pose2(0.6 + 0.01 * k, float(k), 0.0), LEFT)
    assert [start.y_m for start in segments.starts()[::2]] == pytest.approx(
        [k - OFF_M for k in range(60 - 24, 60)]
    )


def test_a_target_that_failed_twice_is_abandoned_from_both_ends() -> None:
    segments = WallSegments(OPTIONS)
    for y in (0.0, 1.0):
        follow(segments, LEFT, (0.0, y, 0.0))
        segments.end(Pose2(1.0, y, 0.0), LEFT)
    forth, back, *other = segments.starts()
    segments.tried(forth, helped=False)
    segments.tried(back, helped=True)
    segments.tried(forth, helped=False)
    assert len(segments.starts()) == 4, "not twice in a row"
    segments.tried(back, helped=False)
    assert segments.starts() == other
