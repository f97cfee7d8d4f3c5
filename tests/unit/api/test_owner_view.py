"""The state of a run as JSON, for the dashboard of another process; both directions."""

from __future__ import annotations

import itertools
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bridge.api.owner_view import SnapshotWriter, read_model, read_snapshot
from bridge.config import to_toml
from bridge.coverage.planner import PlannerState as RunnerState
from bridge.errors import NoOwnerError
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.run.host import Host
from bridge.run.mission import Mission
from bridge.run.options import HostOptions
from bridge.run.snapshot import RunnerSnapshot
from protocol.messages.device import Encoders, Hello, Imu, Power, Range, Status
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from bridge.run.snapshot import Snapshot

MODEL = RobotModel(battery_v=12.0)
NOW_S = 100.0


def seen() -> Snapshot:
    ids = itertools.count(1)
    host = Host(
        MODEL,
        NullSink(),
        HostOptions(0, "", Pose2(1.0, 2.0, 0.5)),
        Mission(None),
        lambda: next(ids),
    )
    for message, age_s in (
        (Power(15_500, 200, 3, 4), 3.0),
        (Imu(0, 0, 16384, 0, 0, 0, 131), 0.5),
        (Range(1234, 80, 255, 1, 30), 0.5),
        (Encoders(7, 65535), 0.5),
        (Status(1, 4, 1 << 6, 0, 7), 0.1),
    ):
        host.state.take(message, round((NOW_S - age_s) * 1e6), NOW_S - age_s)
    for i in range(50):
        host.swept.update(Pose2(0.02 * i, 0.0, 0.0))
    host.session.link.statistics.by_type[0x13] = 200
    return host.snapshot(round(NOW_S * 1e9))


def there_and_back(snapshot: Snapshot, now_s: float = NOW_S) -> Snapshot:
    text = json.dumps(SnapshotWriter().write(snapshot, NOW_S))
    return read_snapshot(json.loads(text), MODEL, now_s)


def test_what_a_dashboard_shows_arrives_unchanged() -> None:
    before = seen()
    after = there_and_back(before)
    assert after._replace(swept=before.swept, state=before.state, mission=before.mission) == before
    assert after.mission == before.mission._replace(link=None)
    assert after.state._replace(arrived_s={}) == before.state._replace(arrived_s={})
    assert after.state.arrived_s == pytest.approx(dict(before.state.arrived_s))


def test_the_swept_floor_arrives_cell_by_cell() -> None:
    before, after = seen().swept, there_and_back(seen()).swept
    ours, theirs = before.to_occupancy(), after.to_occupancy()
    assert np.array_equal(ours.cells, theirs.cells)
    assert ours[1:] == theirs[1:]
    assert after.swept_m2 == pytest.approx(before.swept_m2)
    assert before.swept_m2 > 0.1


def test_times_are_those_of_the_reading_process() -> None:
    before = seen()
    mission = before.mission._replace(ends_s=NOW_S + 12.0)
    after = there_and_back(before._replace(mission=mission), now_s=5000.0)
    assert after.state.arrived_s[Power] == pytest.approx(5000.0 - 3.0)
    assert after.mission.ends_s == pytest.approx(5012.0)
    assert after.session.link.counted_ns == pytest.approx(5000e9, abs=1e6)


def test_a_planner_of_a_plug_in_may_use_the_numbers_of_numpy() -> None:
    turns: Any = np.int64(3)
    lane_m: Any = np.float32(0.5)
    state = RunnerState("mine", turns, lane_m, target=(np.float64(1.0), np.float64(2.0)))
    mission = seen().mission._replace(runner=RunnerSnapshot(state, 3, 1.5))
    runner = there_and_back(seen()._replace(mission=mission)).mission.runner
    assert runner is not None
    assert runner.state == RunnerState("mine", 3, 0.5, target=(1.0, 2.0))


def test_the_device_arrives_with_its_name() -> None:
    hello = Hello(CATALOGUE.hash, bytes(range(12)), 2, 3, 0, 5, 1, 2, 3, "sweeper")
    after = there_and_back(seen()._replace(hello=hello))
    assert after.hello == hello
    assert isinstance(after.hello, Hello)


def test_the_robot_arrives_as_a_robot_file() -> None:
    assert read_model({"robot": to_toml(MODEL)}) == MODEL


@pytest.mark.parametrize("broken", ["run", "session", "pose", "swept", "link", "messages"])
def test_an_owner_of_another_version_is_one_line(broken: str) -> None:
    data = json.loads(json.dumps(SnapshotWriter().write(seen(), NOW_S)))
    values: tuple[object, ...] = (None, 7, "x", [])
    for value in values:
        with pytest.raises(NoOwnerError, match="another version of sweepctl"):
            read_snapshot({**data, broken: value}, MODEL, NOW_S)
    with pytest.raises(NoOwnerError, match="another version of sweepctl"):
        read_snapshot({k: v for k, v in data.items() if k != broken}, MODEL, NOW_S)
    with pytest.raises(NoOwnerError):
        read_model({"robot": "x = ["})
