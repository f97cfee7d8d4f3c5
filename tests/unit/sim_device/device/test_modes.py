"""The device follows the mode table; test_mode_table.py checks the table itself."""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from protocol.messages.values import (
    NackReason,
    OnboardPlanner,
    PlannerAction,
    ResetCause,
    StopCause,
)
from sim_device.device.modes import MODE_OF, SET_EVENT, DeviceState, Event, Guard, ModeMachine
from support.ends import sweeper
from support.wire_host import SESSION, WireHost

pytestmark = pytest.mark.usefixtures("target")


def outcome(state: DeviceState, event: Event, *holding: Guard) -> object:
    machine = ModeMachine(state)
    result = machine.fire(event, holding)
    assert machine.state is (result if isinstance(result, DeviceState) else state)
    return result


class Trial:
    """A device that a test can bring into every state and expose to every event."""

    def __init__(self) -> None:
        self.host = WireHost(sweeper())
        self.host.join()
        self.session = SESSION

    @property
    def state(self) -> DeviceState:
        return self.host.device.state

    def bring(self, state: DeviceState) -> None:
        host = self.host
        if state is DeviceState.STOPPED:
            return
        if state in {DeviceState.OFF, DeviceState.BOOT}:
            cause = ResetCause.BROWN_OUT if state is DeviceState.OFF else ResetCause.PIN
            host.device.reset(cause, off_s=10.0)
        else:
            host.clear()
            host.choose(MODE_OF[state])
            if state in {DeviceState.RUNNING, DeviceState.PAUSED}:
                host.plan(PlannerAction.START)
            if state is DeviceState.PAUSED:
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


@pytest.mark.parametrize(
    "state", [s for s in DeviceState if s not in {DeviceState.OFF, DeviceState.BOOT}]
)
def test_the_device_follows_the_table(state: DeviceState) -> None:
    for event in BY_BYTES:
        trial = Trial()
        trial.bring(state)
        expected = outcome(state, event)
        rejected = trial.meet(event)
        assert rejected is (expected if isinstance(expected, NackReason) else None), event
        assert trial.state is (expected if isinstance(expected, DeviceState) else state), event


@pytest.mark.parametrize("state", [DeviceState.OFF, DeviceState.BOOT])
def test_without_supply_or_before_the_boot_nothing_is_received(state: DeviceState) -> None:
    trial = Trial()
    trial.bring(state)
    trial.host.join(9)
    trial.host.run(0.2)
    assert trial.state is state
    assert not [m for at, _, m in trial.host.received if at > 0]


class ModesMachine(RuleBasedStateMachine):
    """Check that the device follows the table and latches its stops, for any order of events."""

    def __init__(self) -> None:
        super().__init__()
        self.trial = Trial()
        self.model = ModeMachine(DeviceState.STOPPED)

    @precondition(lambda self: self.model.state not in {DeviceState.OFF, DeviceState.BOOT})
    @rule(event=st.sampled_from([e for e in BY_BYTES if e is not Event.SILENCE]))
    def meet(self, event: Event) -> None:
        expected = self.model.fire(event)
        rejected = self.trial.meet(event)
        assert rejected is (expected if isinstance(expected, NackReason) else None)

    @precondition(lambda self: self.model.state in {DeviceState.OFF, DeviceState.BOOT})
    @rule()
    def boot(self) -> None:
        self.trial.host.run(0.5)
        self.trial.host.join(self.trial.session)
        self.model = ModeMachine(DeviceState.STOPPED)

    @precondition(lambda self: self.model.state not in {DeviceState.OFF, DeviceState.BOOT})
    @rule(planner=st.sampled_from([9, OnboardPlanner.PAPER]))
    def start(self, planner: int) -> None:
        holding = () if planner == OnboardPlanner.PAPER else (Guard.NO_PLANNER,)
        expected = self.model.fire(Event.START, holding)
        rejected = self.trial.host.plan(PlannerAction.START, planner)
        assert rejected is (expected if isinstance(expected, NackReason) else None)

    @precondition(lambda self: self.model.state not in {DeviceState.OFF, DeviceState.BOOT})
    @rule()
    def live(self) -> None:
        self.trial.host.run(0.05)

    @invariant()
    def in_step(self) -> None:
        device = self.trial.host.device
        assert device.state is self.model.state
        latched = device.firmware.latch.cause is not StopCause.NONE
        assert latched is (device.state in {DeviceState.OFF, DeviceState.BOOT, DeviceState.STOPPED})


ModesMachine.TestCase.settings = settings(max_examples=15, stateful_step_count=15, deadline=None)
TestModesInAnyOrder = ModesMachine.TestCase
