"""Objects that several threads use at once; the interpreter switches as often as possible.

Each test makes a fixed number of calls. A race causes an exception, or a state that no single call
can cause.
"""

from __future__ import annotations

import io
import json
import random
import sys
import threading
from typing import TYPE_CHECKING

import pytest
from rich.console import Console

from bridge.coverage.planner import PlannerState
from bridge.coverage.runner import PlanRunner
from bridge.coverage.swept_map import SweptMap
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.run.dead_man_switch import DIRECTIONS, TURN_RAD_S, DeadManSwitch
from bridge.run.manual import Operator
from bridge.run.snapshot import snapshot_to_dict
from support.ends import Collector, Ends, HostEnd, Spinning, spinning_host, sweeper
from tools.live.live import Dashboard, EventLines

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bridge.run.host import Host

MODEL = RobotModel()
PATIENCE_S = 60.0
"""Maximum time of a step, s; only a hang is longer."""


@pytest.fixture(autouse=True, name="_often")
def _switching_often() -> Iterator[None]:
    before = sys.getswitchinterval()
    if sys.gettrace() is None:  # tracing two threads at once causes an error
        sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def made() -> tuple[Host, Ends]:
    host = spinning_host(Collector())
    return host, Ends(HostEnd(host), sweeper())


def together(*works: Callable[[], object]) -> list[BaseException]:
    """Run each function in a separate thread until it ends; return the exceptions."""
    raised: list[BaseException] = []
    begin = threading.Barrier(len(works))

    def run(work: Callable[[], object]) -> None:
        begin.wait(PATIENCE_S)
        try:
            work()
        except Exception as error:  # noqa: BLE001 - the result
            raised.append(error)

    threads = [threading.Thread(target=run, args=(work,), daemon=True) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
        assert not thread.is_alive(), "it hangs"
    return raised


def test_the_dead_man_switch_between_keyboard_gamepad_and_loop() -> None:
    switch = DeadManSwitch(0.3, 0.2, releases=True)
    keys, pad, times = random.Random(1), random.Random(2), random.Random(4)
    names = list(DIRECTIONS)

    def press() -> None:
        for _ in range(60_000):
            key = keys.choice(names)
            if keys.random() < 0.5:
                switch.press(key, 0.0)
            else:
                switch.release(key, 0.0)

    def steer() -> None:
        for _ in range(60_000):
            switch.stick(pad.uniform(-1, 1), pad.uniform(-1, 1), 0.0, held=pad.random() < 0.3)
            if pad.random() < 0.1:
                switch.release_all()

    def look() -> None:
        for _ in range(60_000):
            wanted = switch.wanted(times.choice((0.1, 5.0)))
            assert abs(wanted.v_m_s) <= 0.2 + 1e-9
            assert abs(wanted.yaw_rate_rad_s) <= TURN_RAD_S + 1e-9

    assert together(press, steer, look) == []
    switch.release_all()
    assert switch.wanted(0.0) == (0.0, 0.0)


def test_the_speed_of_a_drive_by_hand_is_changed_by_one_at_a_time() -> None:
    switch = DeadManSwitch(1e9, 1.0)

    def faster() -> None:
        for _ in range(10_000):
            switch.faster()
            switch.slower()

    assert together(faster, faster, faster) == []
    assert switch.speed_m_s == pytest.approx(1.0)


def test_the_map_is_copied_whole_while_it_grows() -> None:
    """The dashboard copies the map while the loop marks cells; rows, columns and cells match."""
    swept, places = SweptMap(MODEL), random.Random(3)
    over = threading.Event()

    def drive() -> None:
        for i in range(1_500):
            reach_m = 1.0 + 0.006 * i  # the map grows repeatedly
            pose = Pose2(places.uniform(-reach_m, reach_m), places.uniform(-reach_m, reach_m), 0.0)
            swept.update(pose)
        over.set()

    def draw() -> None:
        maximum = 0
        while not over.is_set():
            grid = swept.to_occupancy()
            marked = int((grid.cells == 0).sum())
            assert marked >= maximum, "what was swept stays swept"
            maximum = marked

    assert together(drive, draw, draw) == []


def test_the_operators_decisions_reach_the_log_all_of_them() -> None:
    plan = PlanRunner(Spinning(MODEL), MODEL)
    operator = Operator(MODEL, DeadManSwitch(0.3, 0.15), plan=plan)
    events: list[str] = []
    over = threading.Event()

    def decide() -> None:
        for _ in range(10_000):
            operator.toggle_pause()
        over.set()

    def log() -> None:
        while not over.is_set():
            events.extend(event.reason for event in operator.drain_events())
            assert isinstance(operator.state, PlannerState)

    assert together(decide, log) == []
    events += [event.reason for event in operator.drain_events()]
    assert len(events) == 10_000


# ---- the run in other threads -------------------------------------------------------------------


def test_a_snapshot_does_not_change_during_the_run() -> None:
    host, ends = made()
    assert ends.run(8.0, lambda: ends.moving)
    seen = host.snapshot(ends.host_ns)
    known = json.dumps(snapshot_to_dict(seen, 20.0)), repr(seen[:-1])
    ends.run(0.5)
    host.state.forget()
    host.session.unplugged(ends.host_ns)
    ends.run(0.5)
    assert (json.dumps(snapshot_to_dict(seen, 20.0)), repr(seen[:-1])) == known
    now = host.snapshot(ends.host_ns)
    assert now.state.imu is not seen.state.imu
    assert now.session.link.statistics.frames_in > seen.session.link.statistics.frames_in


def test_the_snapshot_is_read_while_the_loop_makes_it() -> None:
    """As viewers and the dashboard do: each snapshot is of one time."""
    host, ends = made()
    assert ends.run(8.0, lambda: ends.moving)
    newest = [host.snapshot(ends.host_ns)]
    over = threading.Event()

    def loop() -> None:
        for i in range(400):
            ends.run(0.01)
            if i % 40 == 0:
                host.state.forget()  # as after a loss of the device
            newest[0] = host.snapshot(ends.host_ns)
        over.set()

    def look() -> None:
        picture = Dashboard(lambda: newest[0], EventLines(NullSink(), plain=False))
        console = Console(file=io.StringIO(), width=140, height=42)
        while not over.is_set():
            reported = snapshot_to_dict(newest[0], 20.0)
            assert (reported["imu"] is None) == ("imu" not in reported["age_s"])
            console.print(picture)

    assert together(loop, look, look) == []


def test_the_dashboard_survives_values_that_it_cannot_draw() -> None:
    seen = made()[0].snapshot()
    broken = seen._replace(hello=object())  # type: ignore[arg-type]  # cannot be drawn
    shown = [seen]
    picture = Dashboard(lambda: shown[0], EventLines(NullSink(), plain=False))
    console = Console(file=io.StringIO(), width=140, height=42)
    shown[0] = broken
    console.print(picture)
    shown[0] = seen
    console.print(picture)
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    assert text.count("the dashboard cannot be drawn: AttributeError") == 1
    assert "─ robot ─" in text, "and the next one is drawn"
