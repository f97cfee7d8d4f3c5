"""No planner or operator can move the robot over a slow link, whenever the delay begins."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest

from bridge.bringup.session import LINK_S
from bridge.coverage.runner import PlanRunner
from bridge.errors import StoppedForSafetyError
from bridge.motion.robot_model import RobotModel
from bridge.run.dead_man_switch import DeadManSwitch
from bridge.run.host import Host
from bridge.run.manual import Operator
from bridge.run.mission import Mission, Phase
from bridge.run.onboard_mission import OnboardMission
from bridge.run.options import HostOptions
from bridge.session.records import EventRecord
from bridge.session.round_trip import LIMIT_NS, LinkTrouble, RoundTrip
from bridge.session.states import State
from protocol.can.link import CanLink
from protocol.link import Received
from protocol.messages.device import TimeReply
from protocol.messages.host import PlannerCommand, TimeRequest
from protocol.messages.values import Mode, OnboardPlanner, StopCause
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.bench_wire import bringup_session
from support.ends import Collector, Ends, HostEnd, Spinning, check_safe, spinning_host, sweeper
from support.hostile import Piece, Pipe, Wire

if TYPE_CHECKING:
    from bridge.run.ending import Ending

pytestmark = pytest.mark.slow

MS = 1_000_000
MODEL = RobotModel()
STOP_S = 1.5
"""Maximum time to the end of a run over a link that has become slow, s."""
_ids = itertools.count(77)


class NoReplies(Wire):
    """A wire that loses the replies to pings, except each ``every``-th."""

    def __init__(self, inner: Wire, every: int = 0) -> None:
        super().__init__(inner)
        self._every = every
        self._count = 0

    def misbehave(self, piece: Piece) -> list[Piece]:
        return [Piece(piece.at_us, b"".join(map(self._kept, _frames(piece.data))))]

    def _kept(self, frame: bytes) -> bytes:
        received = Link(Direction.HOST).receive(frame)
        if not any(isinstance(e, Received) and isinstance(e.message, TimeReply) for e in received):
            return frame
        self._count += 1
        return frame if self._every and self._count % self._every == 0 else b""


def _frames(data: bytes) -> list[bytes]:
    return [part + b"\0" for part in data.split(b"\0")[:-1]] if data.endswith(b"\0") else [data]


class Line:
    """Both directions of a serial link, with a delay that can change."""

    def __init__(self, latency_ms: float) -> None:
        self.down, self.up = Pipe(), Pipe()
        self.latency_ms(latency_ms)

    def latency_ms(self, each_way: float) -> None:
        self.down.latency_us = self.up.latency_us = round(1000.0 * each_way)


def host_with(mission: Mission, sink: Collector | None = None) -> Host:
    return Host(MODEL, sink or Collector(), HostOptions(0, "test"), mission, lambda: next(_ids))


def by_hand() -> Host:
    """Return the host of a manual drive whose operator holds the forward key permanently."""
    hand = DeadManSwitch(0.3, 0.15, releases=True)
    operator = Operator(MODEL, hand, manual=True)
    host = host_with(Mission(operator))
    for tenths in range(600):
        hand.press("up", 7.0 + tenths / 10)
    return host


def on_board() -> Host:
    return host_with(OnboardMission(OnboardPlanner.PAPER))


DRIVERS = {"plan": spinning_host, "hand": by_hand, "onboard": on_board}


def joined(host: Host, line: Line) -> Ends:
    return Ends(HostEnd(host), sweeper(), to_device=line.down, to_host=line.up)


def ending(host: Host) -> Ending:
    assert host.mission.ending is not None
    return host.mission.ending


def asks_for_motion(ends: Ends) -> bool:
    return ends.setpoints_us() >= 0 or any(isinstance(s.message, PlannerCommand) for s in ends.sent)


@pytest.mark.parametrize("each_way_ms", [60, 150, 300, 800])
@pytest.mark.parametrize("driver", DRIVERS)
def test_a_link_that_is_slow_from_the_first_byte_moves_nothing(
    driver: str, each_way_ms: int
) -> None:
    host, line = DRIVERS[driver](), Line(each_way_ms)
    ends = joined(host, line)
    assert ends.run(30.0, lambda: host.mission.done)
    ends.run(2.0)
    assert ends.moving_us < 0
    assert not asks_for_motion(ends)
    end = ending(host)
    assert (end.outcome, end.exit_status, end.cause) == ("stopped", 5, StopCause.LINK)
    measured = f"round-trip time is {2 * each_way_ms} ms"
    assert measured in end.reason or f"round-trip time is {2 * each_way_ms + 1} ms" in end.reason
    assert "limit 100 ms" in end.reason
    assert "use a cable instead" in end.reason
    assert ends.device.firmware.latch.cause is StopCause.LINK


@pytest.mark.parametrize("each_way_ms", [60, 150, 300, 800])
@pytest.mark.parametrize("driver", DRIVERS)
def test_a_delay_that_begins_in_a_run_stops_it(driver: str, each_way_ms: int) -> None:
    host, line = DRIVERS[driver](), Line(1)
    ends = joined(host, line)
    assert ends.run(8.0, lambda: ends.moving)
    ends.run(1.0)
    assert host.mission.phase is Phase.DRIVING
    line.latency_ms(each_way_ms)
    ends.run(STOP_S, lambda: host.mission.ending is not None)
    end = ending(host)
    assert (end.outcome, end.exit_status, end.cause) == ("stopped", 5, StopCause.LINK)
    assert "too slow for motion" in end.reason
    assert ends.run(2.0, lambda: ends.device.firmware.latch.latched)
    assert ends.device.firmware.latch.cause is StopCause.LINK
    ends.run(3.0)
    assert ends.now_us - ends.moving_us > 1_000_000, "the robot stands still"


@pytest.mark.parametrize("each_way_ms", [1, 16, 45])
@pytest.mark.parametrize("driver", DRIVERS)
def test_a_link_within_the_limit_is_driven_over(driver: str, each_way_ms: int) -> None:
    host = DRIVERS[driver]()
    ends = joined(host, Line(each_way_ms))
    ends.watch = lambda: check_safe(ends) if driver != "onboard" else None
    assert ends.run(8.0, lambda: ends.moving)
    ends.run(5.0)
    assert host.mission.phase is Phase.DRIVING


def test_a_can_bus_behind_a_slow_adapter_is_driven_over() -> None:
    host = Host(
        MODEL,
        Collector(),
        HostOptions(0, "spinning", link=CanLink),
        Mission(PlanRunner(Spinning(MODEL), MODEL)),
        lambda: next(_ids),
    )
    line = Line(16)
    ends = Ends(HostEnd(host), sweeper(link=CanLink), to_device=line.down, to_host=line.up)
    assert ends.run(8.0, lambda: ends.moving)
    ends.run(3.0)
    assert host.mission.phase is Phase.DRIVING


def test_a_delay_shorter_than_four_pings_stops_nothing() -> None:
    host, line = spinning_host(), Line(1)
    ends = joined(host, line)
    assert ends.run(8.0, lambda: ends.moving)
    for _ in range(3):
        line.latency_ms(150)
        ends.run(0.4)
        line.latency_ms(1)
        ends.run(2.0)
    assert host.mission.phase is Phase.DRIVING


def test_a_run_begins_if_the_delay_ends_before_the_timeout() -> None:
    host, line = spinning_host(), Line(150)
    ends = joined(host, line)
    ends.run(2.0)
    line.latency_ms(1)
    assert ends.run(8.0, lambda: ends.moving)
    assert host.mission.phase is Phase.DRIVING


def test_an_observer_is_warned_once_and_may_drive_when_the_delay_is_gone() -> None:
    sink = Collector()
    host, line = host_with(Mission(None), sink), Line(300)
    ends = joined(host, line)
    ends.run(20.0)
    assert host.session.state is State.READY
    assert not host.mission.done
    line.latency_ms(1)
    ends.run(5.0)
    reported = [e.kind for e in sink.of(EventRecord) if e.kind in {"slow", "quick"}]
    assert reported == ["slow", "quick"]
    host.mission.start(PlanRunner(Spinning(MODEL), MODEL), clear_stop=True)
    assert ends.run(8.0, lambda: ends.moving)


@pytest.mark.parametrize("driver", DRIVERS)
def test_no_answers_to_pings_no_motion(driver: str) -> None:
    host = DRIVERS[driver]()
    ends = Ends(HostEnd(host), sweeper(), to_host=NoReplies(Pipe(1_000)))
    assert ends.run(15.0, lambda: host.mission.done)
    assert ends.moving_us < 0
    assert not asks_for_motion(ends)
    end = ending(host)
    assert (end.exit_status, end.cause) == (5, StopCause.LINK)
    assert "no ping was answered" in end.reason


def test_motion_waits_for_four_answers() -> None:
    host = spinning_host()
    ends = Ends(HostEnd(host), sweeper(), to_host=NoReplies(Pipe(1_000), every=9))
    assert ends.run(8.0, lambda: ends.moving)
    answered = host.session.round_trip.min_ns
    assert answered is not None
    pings = [s for s in ends.sent if isinstance(s.message, TimeRequest)]
    assert len([s for s in pings if s.at_us < ends.setpoints_us()]) >= 4 * 9


def test_an_unsupervised_onboard_plan_is_stopped_too() -> None:
    host, line = host_with(Mission(None)), Line(1)
    ends = joined(host, line)
    ends.run(2.0)
    host.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    ends.run(0.2)
    host.session.set_mode(Mode.ONBOARD, ends.host_ns)
    ends.run(0.2)
    host.session.command(PlannerCommand, (0, OnboardPlanner.PAPER), ends.host_ns)
    assert ends.run(8.0, lambda: ends.moving)
    line.latency_ms(150)
    ends.run(STOP_S, lambda: host.mission.ending is not None)
    assert ending(host).cause is StopCause.LINK
    assert ends.run(1.0, lambda: ends.device.firmware.latch.cause is StopCause.LINK)


# ---- bring-up -----------------------------------------------------------------------------


def test_the_bench_moves_nothing_over_a_slow_link() -> None:
    session, wire = bringup_session(sweeper())
    wire.latency_us = 150_000
    session.run(1.0)
    with pytest.raises(StoppedForSafetyError, match=r"round-trip time is 300 ms \(limit 100 ms\)"):
        session.enable(Mode.VELOCITY)
    assert wire.device.firmware.mode is Mode.IDLE


def test_bring_up_stops_motion_when_the_link_becomes_slow() -> None:
    session, wire = bringup_session(sweeper())
    session.enable(Mode.VELOCITY)
    session.steer(lambda: (0.1, 0.0))
    session.run(1.0)
    wire.latency_us = 150_000
    began_s = session.now_s
    with pytest.raises(StoppedForSafetyError, match="too slow for motion"):
        session.run(LINK_S)
    assert session.now_s - began_s < STOP_S
    session.close()
    assert wire.device.firmware.latch.cause is StopCause.LINK


# ---- the evaluation -----------------------------------------------------------------------


def judged(*round_trips_ms: float, turnaround_ms: float = 0.0) -> LinkTrouble | None:
    """Return the verdict on the link after pings with these round trips, one each 200 ms."""
    trip = RoundTrip()
    trip.begin(0)
    now_ns = 0
    for round_trip_ms in round_trips_ms:
        now_ns += 200 * MS
        arrived_ns = now_ns + round((round_trip_ms + turnaround_ms) * MS)
        trip.answered(now_ns, arrived_ns, round(1000 * turnaround_ms))
    return trip.trouble(now_ns)


def test_the_least_of_the_last_four_counts() -> None:
    assert judged(101, 101, 101, 101) is not None
    assert judged(101, 101, 101, 100) is None
    assert judged(100, 101, 101, 101) is None
    assert judged(100, 101, 101, 101, 101) is not None
    assert judged(2, 2, 2) == judged(900, 2, 900)


def test_the_turnaround_of_the_device_does_not_count() -> None:
    assert judged(90, 90, 90, 90, turnaround_ms=38) is None
    assert judged(110, 110, 110, 110, turnaround_ms=38) is not None


def test_a_claimed_turnaround_hides_no_slow_link() -> None:
    """The device reports the turnaround itself, so only a plausible part of it is subtracted."""
    assert judged(10, 10, 10, 10, turnaround_ms=200) is not None
    assert judged(10, 10, 10, 10, turnaround_ms=120) is None, (
        "40 ms of the turnaround are subtracted"
    )
    assert judged(10, 10, 10, 10, turnaround_ms=131) is not None


@pytest.mark.parametrize("turnaround_us", [400_000, 0xFFFF_FFFF, 0x8000_0000])
def test_a_turnaround_longer_than_the_round_trip_hides_nothing(turnaround_us: int) -> None:
    trip = RoundTrip()
    trip.begin(0)
    for sent_ns in range(200 * MS, 1001 * MS, 200 * MS):
        trip.answered(sent_ns, sent_ns + 300 * MS, turnaround_us)
    assert trip.min_ns == 300 * MS
    assert trip.trouble(1000 * MS) is not None


def test_a_new_session_is_measured_again() -> None:
    trip = RoundTrip()
    trip.begin(0)
    for sent_ns in range(0, 400 * MS, 100 * MS):
        trip.answered(sent_ns, sent_ns + LIMIT_NS, 0)
    assert trip.trouble(500 * MS) is None
    trip.begin(600 * MS)
    found = trip.trouble(600 * MS)
    assert found is not None
    assert not found.known
    assert "0 of 4 pings" in found.text


def test_nothing_moves_before_the_fourth_answer() -> None:
    host = host_with(Mission(PlanRunner(Spinning(MODEL), MODEL), at_rest_s=0.0))
    ends = joined(host, Line(40))
    assert ends.run(8.0, lambda: ends.setpoints_us() >= 0)
    pings = [s for s in ends.sent if isinstance(s.message, TimeRequest)]
    assert ends.setpoints_us() > pings[3].at_us + 80_000
