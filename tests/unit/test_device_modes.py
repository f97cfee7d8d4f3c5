"""The mode table, whole, and that the device does over bytes what it says."""

from __future__ import annotations

import itertools
import re
from collections import deque
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from protocol.values import (
    Fault,
    Mode,
    NackReason,
    OnboardPlanner,
    PlannerAction,
    ResetCause,
    StopCause,
)
from sim_device.modes import (
    GUARDED,
    MODE_OF,
    SET_EVENT,
    TABLE,
    Event,
    Guard,
    ModeMachine,
    State,
    drawn,
    refusals,
)
from support.ends import sweeper
from support.wire_host import SESSION, WireHost

MOVING = {State.VELOCITY, State.BRINGUP, State.RUNNING}
"""States in which a wheel may turn."""
FREE = set(State) - {State.OFF, State.BOOT, State.STOPPED}


def outcome(state: State, event: Event, *holding: Guard) -> object:
    machine = ModeMachine(state)
    result = machine.fire(event, holding)
    assert machine.state is (result if isinstance(result, State) else state)
    return result


# ---- the table by itself ------------------------------------------------------------------


def test_every_state_has_an_answer_to_every_event() -> None:
    assert set(TABLE) == set(itertools.product(State, Event))
    for branches in TABLE.values():
        assert branches[-1].guard is None
        assert all(b.guard is not None for b in branches[:-1])
        assert all(isinstance(b.outcome, NackReason) for b in branches[:-1]), "guards refuse"


@pytest.mark.parametrize("state", FREE)
def test_every_free_state_can_be_stopped(state: State) -> None:
    for event in (Event.STOP, Event.SILENCE, Event.NEW_SESSION):
        assert outcome(state, event, *Guard) is State.STOPPED
    assert outcome(state, Event.SUPPLY_LOST) is State.OFF
    assert outcome(state, Event.RESET) is State.BOOT


def test_from_stopped_only_clearing_by_name_leads_on_and_only_to_idle() -> None:
    ways = {e: TABLE[State.STOPPED, e] for e in Event}
    moves = {e: b[-1].outcome for e, b in ways.items() if isinstance(b[-1].outcome, State)}
    assert moves == {
        Event.CLEAR: State.IDLE,
        Event.STOP: State.STOPPED,
        Event.SUPPLY_LOST: State.OFF,
        Event.RESET: State.BOOT,
    }
    assert outcome(State.STOPPED, Event.CLEAR, Guard.OTHER_CAUSE) is NackReason.OTHER_CAUSE
    assert outcome(State.STOPPED, Event.CLEAR, Guard.CAUSE_HOLDS) is NackReason.FAULT


def test_no_way_into_motion_but_by_a_command_for_it() -> None:
    into = {
        (state, event)
        for (state, event), branches in TABLE.items()
        for b in branches
        if b.outcome in MOVING and state not in MOVING
    }
    assert {event for _, event in into} == {
        Event.SET_VELOCITY,
        Event.SET_BRINGUP,
        Event.START,
        Event.RESUME,
    }
    assert {state for state, _ in into} == {State.IDLE, State.ONBOARD, State.PAUSED}


def test_off_and_boot_lead_through_a_latched_stop() -> None:
    """However a device comes up, the first state in which it hears a command is stopped."""
    seen, waiting = {State.OFF}, deque([State.OFF])
    while waiting:
        state = waiting.popleft()
        for event in Event:
            target = outcome(state, event)
            if isinstance(target, State) and target not in seen:
                seen.add(target)
                if target is not State.STOPPED:
                    waiting.append(target)
    assert seen == {State.OFF, State.BOOT, State.STOPPED}


def test_a_stopping_fault_ends_what_drives_by_itself_or_by_setpoints() -> None:
    for state in State:
        ends = outcome(state, Event.FAULT) is State.STOPPED
        assert ends is (state in GUARDED), state
    for state in FREE - {State.RUNNING, State.PAUSED}:
        for event in (Event.SET_VELOCITY, Event.SET_ONBOARD):
            assert outcome(state, event, Guard.FAULT_HOLDS) is NackReason.FAULT
        assert outcome(state, Event.SET_BRINGUP, Guard.FAULT_HOLDS) is State.BRINGUP


def test_every_mode_of_the_wire_can_be_chosen() -> None:
    for mode, event in SET_EVENT.items():
        target = outcome(State.IDLE, event)
        assert isinstance(target, State)
        assert MODE_OF[target] == mode
    assert set(SET_EVENT) == set(Mode)
    assert set(MODE_OF) == set(State)


def test_the_drawing_shows_every_state_and_every_refusal_has_a_reason() -> None:
    moves = drawn()
    assert {end for move in moves for end in (move[0], move[2])} == {s.value for s in State}
    assert len(moves) == len(set(moves))
    assert (
        "stopped",
        "clear_stop (unless another cause holds or what stopped it still holds)",
        "idle",
    ) in moves
    assert ("planner start", "stopped", "stop_latched") in refusals()


def test_the_page_for_firmware_engineers_lists_every_refusal() -> None:
    page = (Path(__file__).parents[2] / "docs" / "firmware.md").read_text(encoding="utf-8")
    part = page.split("## What the emulated device does")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (.+?) \| (.+?) \| `(\w+)` \|$", part, re.MULTILINE)
    assert rows == refusals()


def test_the_page_explains_every_fault_bit() -> None:
    page = (Path(__file__).parents[2] / "docs" / "firmware.md").read_text(encoding="utf-8")
    part = page.split("### Fault bits")[1].split("\n#")[0]
    named = re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.+?`) \|", part, re.MULTILINE)))
    assert named == [(f.name or "").lower() for f in Fault]


# ---- what the bytes do --------------------------------------------------------------------


class Trial:
    """A device that can be brought into every state and made to meet every event."""

    def __init__(self) -> None:
        self.host = WireHost(sweeper())
        self.host.join()
        self.session = SESSION

    @property
    def state(self) -> State:
        return self.host.device.state

    def bring(self, state: State) -> None:
        host = self.host
        if state is State.STOPPED:
            return
        if state in {State.OFF, State.BOOT}:
            cause = ResetCause.BROWN_OUT if state is State.OFF else ResetCause.PIN
            host.device.reset(cause, off_s=10.0)
        else:
            host.clear()
            host.choose(MODE_OF[state])
            if state in {State.RUNNING, State.PAUSED}:
                host.plan(PlannerAction.START)
            if state is State.PAUSED:
                host.plan(PlannerAction.PAUSE)
        assert self.state is state

    def meet(self, event: Event) -> NackReason | None:
        host = self.host
        match event:
            case Event.STOP:
                return host.stop()
            case Event.CLEAR:
                return host.clear(host.device.firmware.latch.cause)
            case Event.SILENCE:
                host.alive = False
                host.run(1.03)
                host.alive = True
            case Event.NEW_SESSION:
                self.session += 1
                host.join(self.session)
            case Event.RESET:
                host.device.reset(ResetCause.PIN)
            case Event.SUPPLY_LOST:
                host.device.reset(ResetCause.BROWN_OUT, off_s=0.1)
            case _ if event in SET_EVENT.values():
                return host.choose(next(m for m, e in SET_EVENT.items() if e is event))
            case _:
                return host.plan(PlannerAction[event.name])
        return None


BY_BYTES = [
    e for e in Event if e not in {Event.SUPPLY_BACK, Event.BOOTED, Event.FINISHED, Event.FAULT}
]


@pytest.mark.parametrize("state", [s for s in State if s not in {State.OFF, State.BOOT}])
def test_the_device_does_what_the_table_says(state: State) -> None:
    for event in BY_BYTES:
        trial = Trial()
        trial.bring(state)
        expected = outcome(state, event)
        refused = trial.meet(event)
        assert refused is (expected if isinstance(expected, NackReason) else None), event
        assert trial.state is (expected if isinstance(expected, State) else state), event


@pytest.mark.parametrize("state", [State.OFF, State.BOOT])
def test_without_supply_or_before_it_has_booted_nothing_is_heard(state: State) -> None:
    trial = Trial()
    trial.bring(state)
    trial.host.join(9)
    trial.host.run(0.2)
    assert trial.state is state
    assert not [m for at, _, m in trial.host.heard if at > 0]


class ModesMachine(RuleBasedStateMachine):
    """Any order of events: the device stays in step with the table, and safe."""

    def __init__(self) -> None:
        super().__init__()
        self.trial = Trial()
        self.model = ModeMachine(State.STOPPED)

    @precondition(lambda self: self.model.state not in {State.OFF, State.BOOT})
    @rule(event=st.sampled_from([e for e in BY_BYTES if e is not Event.SILENCE]))
    def meet(self, event: Event) -> None:
        expected = self.model.fire(event)
        refused = self.trial.meet(event)
        assert refused is (expected if isinstance(expected, NackReason) else None)

    @precondition(lambda self: self.model.state in {State.OFF, State.BOOT})
    @rule()
    def boot(self) -> None:
        self.trial.host.run(0.5)
        self.trial.host.join(self.trial.session)
        self.model = ModeMachine(State.STOPPED)

    @precondition(lambda self: self.model.state not in {State.OFF, State.BOOT})
    @rule(planner=st.sampled_from([9, OnboardPlanner.PAPER]))
    def start(self, planner: int) -> None:
        holding = () if planner == OnboardPlanner.PAPER else (Guard.NO_PLANNER,)
        expected = self.model.fire(Event.START, holding)
        refused = self.trial.host.plan(PlannerAction.START, planner)
        assert refused is (expected if isinstance(expected, NackReason) else None)

    @precondition(lambda self: self.model.state not in {State.OFF, State.BOOT})
    @rule()
    def live(self) -> None:
        self.trial.host.run(0.05)

    @invariant()
    def in_step(self) -> None:
        device = self.trial.host.device
        assert device.state is self.model.state
        latched = device.firmware.latch.cause is not StopCause.NONE
        assert latched is (device.state in {State.OFF, State.BOOT, State.STOPPED})


ModesMachine.TestCase.settings = settings(max_examples=15, stateful_step_count=15, deadline=None)
TestModesInAnyOrder = ModesMachine.TestCase
