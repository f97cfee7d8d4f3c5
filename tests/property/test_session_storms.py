"""Losses, noise, stalls, reboots and restarts in any order: the robot moves only when allowed."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bridge.run.ending import Ending
from bridge.run.mission import Phase
from bridge.session.states import SessionEvent, State, StateChanged
from protocol.messages.values import Mode
from support.ends import (
    RAMP_US,
    TIME_TO_LIVE_US,
    Ends,
    HostEnd,
    SessionEnd,
    Weather,
    check_safe,
    session_end,
    spinning_host,
    sweeper,
)
from support.hostile import BitFlips, Burst, CutTail, Delayed, Duplicating, Garbage, Lossy, Pipe

if TYPE_CHECKING:
    from protocol.clock import HostNs

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("target")]

LATENCY_US = 2_000
CALM_S = 1.0
ACTIONS = (
    "calm",
    "storm",
    "cut to device",
    "cut to host",
    "cut",
    "hold to device",
    "hold to host",
    "hold",
    "freeze host",
    "restart host",
    "reboot device",
    "start",
)
schedules = st.lists(
    st.tuples(
        st.sampled_from(ACTIONS),
        st.sampled_from([0.05, 0.3, 0.7, 0.95, 1.2, 3.0]),
    ),
    min_size=1,
    max_size=8,
)


def weather(seed: int) -> Weather:
    rng = random.Random(seed)
    return Weather(
        Pipe(LATENCY_US),
        Lossy(Pipe(), 0.1, rng),
        Duplicating(Pipe(), 0.1, rng),
        BitFlips(Pipe(), 0.1, rng),
        Burst(Pipe(), 0.05, rng),
        CutTail(Pipe(), 0.05, rng),
        Garbage(Pipe(), 0.1, rng),
    )


class Storm:
    """Both ends during faults. A second without faults follows each action."""

    def __init__(self, host: HostEnd | SessionEnd, seed: int) -> None:
        self.to_device, self.to_host = weather(seed), weather(seed + 1)
        self.ends = Ends(host, sweeper(), to_device=self.to_device, to_host=self.to_host)
        self.boots = 0

    def act(self, action: str, duration_s: float) -> None:
        ends = self.ends
        for direction, valve in (("device", ends.to_device), ("host", ends.to_host)):
            valve.cut = action in {"cut", f"cut to {direction}"}
            valve.held = action in {"hold", f"hold to {direction}"}
        self.to_device.storming = self.to_host.storming = action == "storm"
        ends.host_alive = action != "freeze host"
        if action == "reboot device":
            self.boots += 1
            ends.reboot_device(self.boots)
        ends.run(duration_s)
        self.heal()
        ends.run(CALM_S)

    def heal(self) -> None:
        ends = self.ends
        for valve in (ends.to_device, ends.to_host):
            valve.cut = valve.held = False
        self.to_device.storming = self.to_host.storming = False
        ends.host_alive = True


class Operator:
    """A program that sends setpoints whenever the session is ready, but starts only on request.

    After a loss, a reboot or a restart, the robot must stand still until the next start.
    """

    def __init__(self, storm: Storm, host: SessionEnd) -> None:
        self.storm = storm
        self.may_move = False
        self.ended_us = 0
        self._seen = 0
        self._next_ns = 0
        self.take(host)

    def take(self, host: SessionEnd) -> None:
        self.host = host
        self._seen = 0
        host.each_turn = self.turn
        self.end()

    def end(self) -> None:
        if self.may_move:
            self.may_move = False
            self.ended_us = self.storm.ends.now_us

    def start(self) -> None:
        session, ends = self.host.session, self.storm.ends
        if session.state is State.READY:
            self.may_move = True
            session.clear_stop(ends.device.firmware.latch.cause, ends.host_ns)
            session.set_mode(Mode.VELOCITY, ends.host_ns)

    def turn(self, now_ns: HostNs) -> None:
        events: list[SessionEvent] = self.host.events[self._seen :]
        self._seen = len(self.host.events)
        if any(isinstance(e, StateChanged) for e in events):
            self.end()
        if self.host.session.state is State.READY and now_ns >= self._next_ns:
            self._next_ns = now_ns + 20_000_000
            self.host.session.setpoint(0.2, 0.5, 200, now_ns)

    def watch(self) -> None:
        ends = self.storm.ends
        check_safe(ends)
        if ends.moving and not self.may_move:
            since_us = ends.now_us - self.ended_us
            assert since_us <= TIME_TO_LIVE_US + RAMP_US, "the robot moves without a new start"


@given(schedules, st.integers(0, 1000))
@example([("start", 0.7), ("hold to device", 3.0), ("calm", 1.2)], 0)
@example([("start", 0.7), ("cut to host", 1.2), ("calm", 3.0)], 0)
@example([("start", 0.7), ("hold", 0.95), ("restart host", 0.3), ("hold to device", 0.95)], 1)
@example([("start", 0.3), ("reboot device", 0.3), ("start", 0.3), ("storm", 3.0)], 2)
@settings(max_examples=20)
def test_nothing_moves_that_should_not(plan: list[tuple[str, float]], seed: int) -> None:
    host = session_end()
    storm = Storm(host, seed)
    ends = storm.ends
    operator = Operator(storm, host)
    ends.watch = operator.watch
    ends.run(CALM_S)
    for action, duration_s in plan:
        if action == "start":
            operator.start()
        elif action == "restart host" or operator.host.session.state is State.FAILED:
            operator.take(host := session_end())
            ends.restart_host(host)
        storm.act(action, duration_s)
    if operator.host.session.state is State.FAILED:
        operator.take(host := session_end())
        ends.restart_host(host)
    session = operator.host.session
    assert ends.run(8.0, lambda: session.state is State.READY), session.state
    assert ends.device.firmware.session_id == session.session_id
    # The normal function must still work.
    ends.run(0.5)
    operator.start()
    assert ends.run(3.0, lambda: ends.moving)


@given(schedules, st.integers(0, 1000), st.booleans())
@settings(max_examples=20)
def test_every_run_ends_and_none_begins_again(
    plan: list[tuple[str, float]],
    seed: int,
    patient: bool,  # noqa: FBT001 - a case of the test
) -> None:
    host = spinning_host()
    storm = Storm(end := HostEnd(host), seed)
    ends = storm.ends
    left_us: list[int] = []

    def watch() -> None:
        check_safe(ends)
        if not left_us and host.mission.phase in {Phase.HOLDING, Phase.ENDING, Phase.DONE}:
            left_us.append(ends.now_us)
        if left_us and ends.moving:
            since_us = ends.now_us - left_us[0]
            assert since_us <= TIME_TO_LIVE_US + RAMP_US, "the run drives on after its end"

    ends.watch = watch
    ends.run(4.0)
    for action, duration_s in plan:
        storm.act(action, duration_s)
    assert ends.host is end
    if not patient:
        ends.to_device.cut = ends.to_host.cut = True
    host.end(Ending("stopped", "ended by Ctrl-C", 0), ends.host_ns)
    assert ends.run(1.2, lambda: host.mission.done), host.mission.phase
    assert host.mission.ending is not None
    ends.run(1.5)
    assert not ends.moving


@given(st.integers(0, 1000), st.sampled_from([5_000, 40_000]))
@settings(max_examples=8)
def test_a_run_survives_jitter_below_its_time_to_live(seed: int, jitter_us: int) -> None:
    rng = random.Random(seed)
    host = spinning_host()
    ends = Ends(
        HostEnd(host),
        sweeper(),
        to_device=Delayed(Pipe(500), rng, low_us=0, high_us=jitter_us),
        to_host=Delayed(Pipe(500), rng, low_us=0, high_us=jitter_us),
    )
    ends.watch = lambda: check_safe(ends)
    assert ends.run(6.0, lambda: ends.moving)
    ends.run(3.0)
    assert host.mission.phase is Phase.DRIVING
