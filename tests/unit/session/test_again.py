"""A session that loses its device and finds the same device, a rebooted one or another one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.motion.robot_model import RobotModel
from bridge.run.host import Host
from bridge.run.mission import LOST_TIMEOUT_S, Mission, Phase, Resume
from bridge.run.options import HostOptions
from bridge.session.records import EventRecord
from bridge.session.states import Failed, SessionReady, State, StateChanged
from protocol.clock import HostNs
from protocol.messages.device import Power
from protocol.messages.values import Mode, StopCause
from support.ends import (
    Collector,
    Ends,
    HostEnd,
    SessionEnd,
    check_safe,
    session_end,
    spinning_host,
    sweeper,
)
from support.peers import EXTRA, catalogue, hints_of, variant

if TYPE_CHECKING:
    from sim_device.sweeper import VirtualSweeper

pytestmark = pytest.mark.usefixtures("target")

RicherPower = variant(Power, {**hints_of(Power), "fan": EXTRA})


def ready() -> tuple[Ends, SessionEnd]:
    host = session_end()
    ends = Ends(host, sweeper())
    assert ends.run(3.0, lambda: host.session.state is State.READY)
    return ends, host


def unplug(ends: Ends) -> None:
    """Cut both directions, and report the loss to the session as the I/O loop does."""
    ends.to_host.cut = ends.to_device.cut = True
    ends.host.session.unplugged(ends.host_ns)


def replug(ends: Ends, device: VirtualSweeper | None = None) -> None:
    if device is not None:
        ends.device = device
        ends.booted_us = ends.now_us
    ends.to_host.cut = ends.to_device.cut = False
    ends.host.session.replugged(ends.host_ns)


def test_a_port_that_vanishes_is_a_loss_at_once() -> None:
    ends, host = ready()
    unplug(ends)
    ends.run(0.01)
    assert host.session.state is State.LOST
    assert host.of(StateChanged)[-1].why == "its port is gone"


def test_a_port_that_is_back_is_asked_at_once() -> None:
    """The session sends its hello at once, without the 2 s pause that follows a long silence."""
    ends, host = ready()
    unplug(ends)
    ends.run(20.0)
    before_us = ends.now_us
    replug(ends)
    assert ends.run(0.3, lambda: host.session.state is State.READY)
    assert ends.now_us - before_us < 200_000
    last = host.of(SessionReady)[-1]
    assert (last.again, last.rebooted, last.other_schema) == (True, False, False)


def test_the_first_handshake_is_no_return() -> None:
    _, host = ready()
    (first,) = host.of(SessionReady)
    assert (first.again, first.rebooted, first.other_schema) == (False, False, False)


def test_another_boot_is_distinguished() -> None:
    ends, host = ready()
    unplug(ends)
    ends.run(1.5)
    ends.reboot_device(77)
    ends.run(1.0)
    replug(ends)
    assert ends.run(3.0, lambda: host.session.state is State.READY)
    last = host.of(SessionReady)[-1]
    assert (last.again, last.rebooted, last.other_schema) == (True, True, False)


@pytest.mark.python_only("changes the catalogue of the firmware")
def test_another_schema_is_distinguished() -> None:
    ends, host = ready()
    unplug(ends)
    ends.run(1.5)
    other = sweeper(catalogue=catalogue(more=[RicherPower]))  # reflashed: same seed, same uid
    replug(ends, other)
    assert ends.run(4.0, lambda: host.session.state is State.READY)
    last = host.of(SessionReady)[-1]
    assert (last.again, last.other_schema) == (True, True)


def test_another_device_is_never_accepted_instead() -> None:
    ends, host = ready()
    unplug(ends)
    ends.run(1.5)
    replug(ends, sweeper(seed=9))
    assert ends.run(4.0, lambda: host.session.state is State.FAILED)
    assert [f.kind for f in host.of(Failed)] == ["other_device"]


# ---- effect on the run ------------------------------------------------------------------


def driving(resume: Resume) -> tuple[Ends, Host, Collector]:
    sink = Collector()
    host = spinning_host(sink, resume=resume)  # type: ignore[arg-type]  # by name
    ends = Ends(HostEnd(host), sweeper())
    ends.watch = lambda: check_safe(ends)
    assert ends.run(8.0, lambda: ends.moving)
    return ends, host, sink


def kinds(sink: Collector) -> list[str]:
    return [e.kind for e in sink.of(EventRecord) if e.source == "session"]


def test_by_default_the_run_ends_when_the_device_is_back() -> None:
    ends, host, sink = driving(Resume.NEVER)
    unplug(ends)
    ends.run(2.0)
    assert host.mission.phase is Phase.HOLDING
    replug(ends)
    assert ends.run(2.0, lambda: host.mission.done)
    assert host.mission.ending is not None
    assert host.mission.ending.exit_status == 5
    assert "same_boot" in kinds(sink)


@pytest.mark.parametrize("gone_s", [0.05, 0.6, 2.5])
def test_nothing_moves_before_a_person_confirms(gone_s: float) -> None:
    ends, host, sink = driving(Resume.ASK)
    unplug(ends)
    ends.run(gone_s)
    replug(ends)
    assert ends.run(2.0, lambda: host.mission.asking)
    assert "asking" in kinds(sink)
    ends.run(1.0)
    at_us = ends.now_us
    ends.run(20.0)
    assert ends.moving_us < at_us, "the robot stands still"
    assert host.mission.resume(ends.host_ns / 1e9)
    assert ends.run(6.0, lambda: ends.moving)
    assert host.mission.phase is Phase.DRIVING
    assert ends.device.firmware.mode is Mode.VELOCITY


def test_no_device_answers() -> None:
    ends, host, _ = driving(Resume.ASK)
    unplug(ends)
    ends.run(2.0)
    replug(ends)
    assert ends.run(2.0, lambda: host.mission.asking)
    asked_us = ends.now_us
    assert ends.run(LOST_TIMEOUT_S + 2.0, lambda: host.mission.done)
    assert ends.now_us - asked_us > (LOST_TIMEOUT_S - 0.5) * 1e6
    assert host.mission.ending is not None
    assert host.mission.ending.exit_status == 5
    assert "did not continue" in host.mission.ending.reason


def test_a_device_that_stays_away_ends_the_run() -> None:
    ends, host, _ = driving(Resume.ASK)
    unplug(ends)
    lost_us = ends.now_us
    assert ends.run(LOST_TIMEOUT_S + 2.0, lambda: host.mission.done)
    assert ends.now_us - lost_us > (LOST_TIMEOUT_S - 0.5) * 1e6
    assert host.mission.ending is not None
    assert (host.mission.ending.outcome, host.mission.ending.exit_status) == ("fault", 3)


def test_saying_so_unasked_changes_nothing() -> None:
    ends, host, _ = driving(Resume.ASK)
    assert not host.mission.resume(ends.host_ns / 1e9)
    unplug(ends)
    ends.run(0.5)
    assert not host.mission.resume(ends.host_ns / 1e9), "the device is not back"
    assert host.mission.phase is Phase.HOLDING


@pytest.mark.python_only("stops the device from inside")
def test_an_operators_stop_is_not_cleared_by_going_on() -> None:
    ends, host, _ = driving(Resume.ASK)
    unplug(ends)
    ends.run(2.0)
    ends.device.firmware.stop(StopCause.OPERATOR)  # a person pressed the button on the robot
    replug(ends)
    assert ends.run(2.0, lambda: host.mission.asking)
    host.mission.resume(ends.host_ns / 1e9)
    assert ends.run(3.0, lambda: host.mission.done)
    assert ends.device.firmware.latch.cause is StopCause.OPERATOR
    assert host.mission.ending is not None
    assert "cause: operator" in host.mission.ending.reason


def test_a_simulated_run_may_continue_by_itself() -> None:
    ends, host, sink = driving(Resume.AUTO)
    unplug(ends)
    ends.run(2.0)
    replug(ends)
    assert ends.run(8.0, lambda: host.mission.phase is Phase.DRIVING)
    assert ends.run(2.0, lambda: ends.moving)
    assert "same_boot" in kinds(sink)


def test_a_run_without_motion_continues() -> None:
    sink = Collector()
    host = Host(RobotModel(), sink, HostOptions(0), Mission(None), lambda: 5)
    ends = Ends(HostEnd(host), sweeper())
    assert ends.run(3.0, lambda: host.session.state is State.READY)
    unplug(ends)
    ends.run(3.0)
    replug(ends)
    assert ends.run(3.0, lambda: host.session.state is State.READY)
    ends.run(1.0)
    assert not host.mission.done
    assert host.state.imu is not None


def test_the_opening_is_on_record_at_its_own_moment() -> None:
    """The log has the time of the opening, because the session's timeouts start at that time."""
    sink = Collector()
    host = Host(RobotModel(), sink, HostOptions(0), Mission(None), lambda: 1)
    host.open(HostNs(7_000_000))
    host.receive(b"\0", HostNs(7_300_000))
    host.poll(HostNs(7_300_000))
    (opening,) = [event for event in sink.of(EventRecord) if event.kind == "opening"]
    assert opening.log_ns == 7_000_000
