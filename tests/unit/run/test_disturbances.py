"""Each bump, stall and slip that the estimator detects is logged once."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.motion.estimation.disturbance import Disturbance, DisturbanceKind
from bridge.motion.robot_model import RobotModel
from bridge.run.recording import HostRecords
from support.events import Events
from tools.rooms.generator import generate_room
from tools.virtual.run import run_virtual

BUMP = Disturbance(DisturbanceKind.BUMP, 1.0, 0.0312)
SLIP = Disturbance(DisturbanceKind.SLIP_LEFT, 2.0, 0.05)
AGAIN = Disturbance(DisturbanceKind.BUMP, 1.0, 0.0312)
"""A disturbance equal to the first, found by another estimator."""


def kinds_after(*found: tuple[Disturbance, ...]) -> list[list[str]]:
    """Return the kinds that each call with these disturbances reports."""
    sink = Events()
    records = HostRecords(sink, 10, "recovery")
    reported = []
    for k, each in enumerate(found):
        before = len(sink.events)
        records.disturbances(each, k)
        reported.append([event.kind for event in sink.events[before:]])
    return reported


def test_each_is_reported_once_oldest_first() -> None:
    reported = kinds_after((), (BUMP,), (BUMP,), (BUMP, SLIP), (BUMP, SLIP))
    assert reported == [[], ["bump"], [], ["slip_left"], []]
    assert kinds_after((BUMP, SLIP)) == [["bump", "slip_left"]]


def test_a_new_estimator_works_too() -> None:
    assert kinds_after((BUMP,), (), (AGAIN,)) == [["bump"], [], ["bump"]]


def test_a_host_reports_its_robots_bumps() -> None:
    """At 0.2 m/s, 2 s after the start, the robot hits a chair leg 52° off its heading."""
    sink = Events()
    room = generate_room(105, np.random.default_rng([0x5EED, 105]), "legs")
    run_virtual(room, RobotModel(), "recovery", sink, seed=5, noise="typical", max_time_s=4.0)
    bumps = [e for e in sink.events if (e.source, e.kind) == ("estimator", "bump")]
    assert bumps
    assert 0.02 < float(bumps[0].data["size"]) < 0.5


@pytest.mark.parametrize("kind", DisturbanceKind)
def test_the_text_of_each_kind_has_the_speed_before_its_unit(kind: DisturbanceKind) -> None:
    sink = Events()
    HostRecords(sink, 10, "recovery").disturbances((Disturbance(kind, 1.0, 0.1234),), 5)
    (event,) = sink.events
    assert "0.123 m/s" in event.text


def test_with_source_and_size() -> None:
    sink = Events()
    HostRecords(sink, 10, "recovery").disturbances((BUMP,), 5)
    (event,) = sink.events
    assert (event.log_ns, event.source, event.data) == (15, "estimator", {"size": 0.031})
