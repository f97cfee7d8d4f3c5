"""Samples that arrive on time with a wrong time stamp: constant, too early or too late."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest

from bridge.bringup.session import STALE_S as BENCH_STALE_S
from bridge.errors import StoppedForSafetyError
from bridge.motion.robot_model import RobotModel
from bridge.run.host import Host
from bridge.run.mission import Mission, Phase
from bridge.run.onboard_mission import PLAN_STALE_S, OnboardMission
from bridge.run.options import HostOptions
from bridge.run.robot_state import STALE_S, STATUS_STALE_S
from bridge.session.records import EventRecord
from bridge.session.sample_times import RESYNC_S, SampleTimes
from protocol.link import Received
from protocol.messages.device import Encoders, Imu, PlannerState, Power, Range, Status
from protocol.messages.values import Mode, OnboardPlanner, StopCause
from protocol.schema.message import Direction
from protocol.uart.framing import encode_frame
from protocol.uart.link import Link
from support.bench_wire import bringup_session
from support.ends import Collector, Ends, HostEnd, spinning_host, sweeper
from support.hostile import Piece, Pipe, Wire

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.schema.message import Message

pytestmark = pytest.mark.slow

SECOND_US = 1_000_000
SLACK_S = 0.1
"""Tolerance, s: a period of the slowest stream and of the control loop."""
_ids = itertools.count(991)


class Restamped(Wire):
    """A wire that changes the time stamps of some streams, and no other bytes."""

    def __init__(self, *streams: type[Message]) -> None:
        super().__init__(Pipe(1_000))
        self.stamp: Callable[[int], int] | None = None
        """Function from the true stamp to the changed one; None: stamps stay unchanged."""
        self.drop = False
        """True: these streams are lost completely."""
        self._streams = streams
        self._rest = b""

    def misbehave(self, piece: Piece) -> list[Piece]:
        *whole, self._rest = (self._rest + piece.data).split(b"\0")
        return [Piece(piece.at_us, b"".join(self._passed(frame + b"\0") for frame in whole))]

    def _passed(self, data: bytes) -> bytes:
        for event in Link(Direction.HOST).receive(data):
            if isinstance(event, Received) and isinstance(event.message, self._streams):
                if self.drop:
                    return b""
                if self.stamp is not None:
                    f = event.frame
                    t_us = self.stamp(f.t_us) & 0xFFFF_FFFF
                    return encode_frame(f.node, f.type_id, f.seq, t_us, f.payload)
        return data


def frozen() -> Callable[[int], int]:
    """Return a clock that stands still at the stamp of the first sample."""
    first: list[int] = []

    def stamp(t_us: int) -> int:
        first.append(t_us)
        return first[0]

    return stamp


def crawling() -> Callable[[int], int]:
    """Return a clock that runs at a tenth of its rate from now on."""
    first: list[int] = []

    def stamp(t_us: int) -> int:
        first.append(t_us)
        return first[0] + (t_us - first[0]) // 10

    return stamp


def cycling() -> Callable[[int], int]:
    """Return a clock that repeats the same three stamps."""
    first: list[int] = []

    def stamp(t_us: int) -> int:
        first.append(t_us)
        return first[0] + 10_000 * (len(first) % 3)

    return stamp


def off_by(seconds: float) -> Callable[[], Callable[[int], int]]:
    return lambda: lambda t_us: t_us + round(seconds * SECOND_US)


def lagging() -> Callable[[int], int]:
    """Return a clock that runs at four fifths of its rate from now on."""
    first: list[int] = []

    def stamp(t_us: int) -> int:
        first.append(t_us)
        return t_us - (t_us - first[0]) // 5

    return stamp


KINDS = {
    "frozen": frozen,
    "crawling": crawling,
    "cycling": cycling,
    "back by 20 s": off_by(-20.0),
    "ahead by 20 s": off_by(20.0),
    "ahead by 30 min": off_by(1800.0),
    "back by 0.5 s": off_by(-0.5),
}


def driving(wire: Restamped, host: Host | None = None) -> tuple[Ends, Host]:
    host = host or spinning_host()
    ends = Ends(HostEnd(host), sweeper(), to_host=wire)
    assert ends.run(8.0, lambda: ends.moving)
    ends.run(1.0)
    assert host.mission.phase is Phase.DRIVING
    return ends, host


def on_board() -> Host:
    mission = OnboardMission(OnboardPlanner.PAPER)
    return Host(RobotModel(), Collector(), HostOptions(0, "onboard"), mission, lambda: next(_ids))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stream", [Encoders, Imu, Range])
def test_a_stream_whose_stamps_are_wrong_stops_the_run(stream: type[Message], kind: str) -> None:
    wire = Restamped(stream)
    ends, host = driving(wire)
    wire.stamp = KINDS[kind]()
    limit_s = STALE_S + SLACK_S + (0.5 if kind == "crawling" else 0.0)
    ends.run(limit_s, lambda: host.mission.ending is not None)
    end = host.mission.ending
    assert end is not None
    assert end.reason.startswith(f"no fresh {stream.__name__.lower()} data from the device")
    assert (end.exit_status, end.cause) == (5, StopCause.SUPERVISE)
    ends.run(2.0)
    assert not ends.moving


@pytest.mark.parametrize("kind", ["frozen", "cycling"])
def test_a_clock_that_stands_still_for_all_streams_stops_the_run(kind: str) -> None:
    wire = Restamped(Encoders, Imu, Range, Status)
    ends, host = driving(wire)
    wire.stamp = KINDS[kind]()
    ends.run(STALE_S + SLACK_S, lambda: host.mission.ending is not None)
    assert host.mission.ending is not None
    assert "no fresh" in host.mission.ending.reason


def test_streams_that_all_lag_behind_the_replies_to_pings_stop_the_run() -> None:
    """No stream is older than another, and the round trip stays short: only pings show the age."""
    wire = Restamped(Encoders, Imu, Range, Status, Power, PlannerState)
    ends, host = driving(wire)
    wire.stamp = lagging()
    ends.run(5 * (STALE_S + 2 * SLACK_S) + SLACK_S, lambda: host.mission.ending is not None)
    end = host.mission.ending
    assert end is not None
    assert "no fresh" in end.reason
    ends.run(2.0)
    assert not ends.moving


def test_a_run_does_not_begin_on_frozen_samples() -> None:
    wire = Restamped(Range)
    wire.stamp = frozen()
    host = spinning_host()
    ends = Ends(HostEnd(host), sweeper(), to_host=wire)
    assert ends.run(12.0, lambda: host.mission.done)
    assert ends.moving_us < 0
    assert host.mission.ending is not None
    assert host.mission.ending.reason.startswith("no fresh range data")


@pytest.mark.parametrize("drop", [False, True])
def test_a_status_that_is_not_renewed_stops_the_run(drop: bool) -> None:  # noqa: FBT001 - two cases
    wire = Restamped(Status)
    ends, host = driving(wire)
    wire.stamp, wire.drop = frozen(), drop
    ends.run(STATUS_STALE_S + 2 * SLACK_S, lambda: host.mission.ending is not None)
    assert host.mission.ending is not None
    assert "status data" in host.mission.ending.reason


@pytest.mark.parametrize("drop", [False, True])
@pytest.mark.parametrize(
    ("stream", "name", "limit_s"),
    [(Status, "status", STATUS_STALE_S), (PlannerState, "planner state", PLAN_STALE_S)],
)
def test_a_plan_of_the_device_that_is_not_seen_any_more_is_stopped(
    stream: type[Message],
    name: str,
    limit_s: float,
    drop: bool,  # noqa: FBT001 - both cases are compared
) -> None:
    wire = Restamped(stream)
    ends, host = driving(wire, on_board())
    wire.stamp, wire.drop = frozen(), drop
    ends.run(limit_s + 3 * SLACK_S, lambda: host.mission.ending is not None)
    end = host.mission.ending
    assert end is not None
    assert end.reason.startswith(f"no {'' if drop else 'fresh '}{name} data from the device")
    assert end.exit_status == 5
    ends.run(2.0)
    assert not ends.moving


@pytest.mark.parametrize("ms", [-50, -200, 50, 250])
def test_a_small_step_of_the_clock_stops_nothing(ms: int) -> None:
    wire = Restamped(Encoders, Imu, Range, Status)
    ends, host = driving(wire)
    wire.stamp = off_by(ms / 1000)()
    ends.run(5.0)
    assert host.mission.phase is Phase.DRIVING


def test_one_stray_stamp_stops_nothing() -> None:
    wire = Restamped(Imu)
    ends, host = driving(wire)
    for seconds in (-30.0, 30.0, 2000.0):
        wire.stamp = off_by(seconds)()
        ends.run(0.011)
        wire.stamp = None
        ends.run(2.0)
    assert host.mission.phase is Phase.DRIVING
    fit = host.sync.fit
    assert fit is not None
    assert fit.bound_ns < 5e6, "the stray stamp does not change the clock fit"


@pytest.mark.parametrize("seconds", [-20.0, 20.0])
def test_an_observer_sees_a_clock_that_was_set_and_then_current_data(seconds: float) -> None:
    sink, wire = Collector(), Restamped(Encoders, Imu, Range, Status)
    host = Host(RobotModel(), sink, HostOptions(0, ""), Mission(None), lambda: next(_ids))
    ends = Ends(HostEnd(host), sweeper(), to_host=wire)
    ends.run(3.0)
    wire.stamp = off_by(seconds)()
    ends.run(RESYNC_S + 0.5)
    assert "set" in [e.kind for e in sink.of(EventRecord) if e.source == "clock"]
    assert host.state.stale(ends.host_ns / 1e9) is None


def test_bring_up_stops_motion_on_frozen_counts() -> None:
    session, wire = bringup_session(sweeper())
    session.enable(Mode.VELOCITY)
    session.steer(lambda: (0.1, 0.0))
    session.run(1.0)
    frames, plain = Restamped(Encoders), wire.turn
    frames.stamp = frozen()

    def turn(data: bytes, until_ns: object) -> bytes:
        came = plain(data, until_ns)  # type: ignore[arg-type]  # host time
        return b"".join(p.data for p in frames.misbehave(Piece(0, came)))

    wire.turn = turn  # type: ignore[method-assign]  # changes the stamps
    began_s = session.now_s
    with pytest.raises(StoppedForSafetyError, match="no fresh encoder readings"):
        session.run(3.0)
    assert session.now_s - began_s < BENCH_STALE_S + SLACK_S


# ---- the evaluation -----------------------------------------------------------------------


def test_samples_in_a_burst_after_a_stall_are_all_taken() -> None:
    times = SampleTimes()
    for ms in range(0, 1000, 10):
        assert times.take(Imu, 1000 * ms, ms / 1000)
    for ms in range(1000, 1700, 10):  # these samples arrive together after a stall of 0.7 s
        assert times.take(Imu, 1000 * ms, 1.7)
    assert times.taken_s[Imu] == pytest.approx(1.69, abs=0.02)


def test_a_silence_ages_every_stream() -> None:
    times = SampleTimes()
    times.take(Imu, 0, 5.0)
    times.take(Range, 50_000, 5.05)
    assert times.taken_s == {Imu: pytest.approx(5.0), Range: pytest.approx(5.05)}
    for ms in range(60, 900, 10):
        times.take(Imu, 1000 * ms, 5.0 + ms / 1000)
    assert times.taken_s[Range] == pytest.approx(5.05)


def test_a_stream_later_than_the_others_by_much_is_old_from_the_first_sample() -> None:
    times = SampleTimes()
    for ms in range(0, 2000, 10):
        times.take(Imu, 1000 * ms, ms / 1000)
        times.take(Range, 1000 * (ms - 500), ms / 1000)
    assert times.taken_s[Range] == pytest.approx(1.49, abs=0.01)


def test_abandoned_targets_are_rated_again() -> None:
    times = SampleTimes()
    times.take(Imu, 90 * SECOND_US, 1.0)
    times.forget()
    assert times.taken_s == {}
    assert times.take(Imu, 5, 2.0)
    assert times.taken_s[Imu] == pytest.approx(2.0)
