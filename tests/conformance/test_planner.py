"""The host starts, pauses, resumes and ends the onboard planner."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from protocol.messages.device import PlannerState
from protocol.messages.host import PlannerCommand, SetStreamRate
from protocol.messages.values import (
    Capability,
    Mode,
    NackReason,
    OnboardPlanner,
    PlannerAction,
    PlannerPhase,
    StopCause,
)
from support.probe import since

if TYPE_CHECKING:
    from support.probe import Probe

DRIVING = {
    PlannerPhase.LANE,
    PlannerPhase.TURN,
    PlannerPhase.STEP,
    PlannerPhase.RECOVERY_BACK,
    PlannerPhase.RECOVERY_LANE,
    PlannerPhase.RECOVERY_RETURN,
}
STILL = 4


def command(device: Probe, action: PlannerAction, planner: int | None = None) -> NackReason | None:
    which = OnboardPlanner.PAPER if planner is None else planner
    return device.refusal(lambda i: PlannerCommand(i, action, which))


def ready(device: Probe) -> None:
    device.handshake()
    device.needs(Capability.ONBOARD_PLANNER)
    device.refusal(lambda i: SetStreamRate(i, 0x16, 500))
    device.refusal(lambda i: SetStreamRate(i, 0x2C, 200))


def start(device: Probe) -> None:
    ready(device)
    device.enter(Mode.ONBOARD)
    assert command(device, PlannerAction.START) is None


def phase_becomes(device: Probe, phases: set[PlannerPhase], within_s: float = 6.0) -> bool:
    mark = len(device.received)
    return device.until(
        lambda: any(p.phase in phases for p in device.of(PlannerState, mark)), within_s
    )


def moves(device: Probe, seconds: float) -> bool:
    mark = device.counts()[-1][0]
    device.listen(seconds)
    after = [c for c in device.counts() if since(mark, c[0]) >= 0]
    return max(abs(after[-1][i] - after[0][i]) for i in (1, 2)) > STILL


def test_its_hello_shows_whether_it_has_a_planner(device: Probe) -> None:
    has = bool(device.handshake().capabilities & Capability.ONBOARD_PLANNER)
    device.stop()
    reason = command(device, PlannerAction.START)
    lacks = reason in {NackReason.UNSUPPORTED, NackReason.UNKNOWN_COMMAND}
    assert lacks is not has, f"a planner in the hello: {has}; reply to a start: {reason}"
    assert has or not device.of(PlannerState), "a planner_state without a planner"


def test_its_state_is_reported(device: Probe) -> None:
    ready(device)
    found = device.wait_for(PlannerState)
    assert found is not None, "no planner_state"
    assert isinstance(found.message, PlannerState)
    assert found.message.phase in set(PlannerPhase)


def test_it_does_not_start_while_a_stop_is_latched(device: Probe) -> None:
    ready(device)
    device.stop()
    assert command(device, PlannerAction.START) is NackReason.STOP_LATCHED
    assert device.status().mode == Mode.IDLE


def test_it_is_commanded_in_its_own_mode_only(device: Probe) -> None:
    ready(device)
    device.free()
    for action in (PlannerAction.START, PlannerAction.PAUSE, PlannerAction.RESUME):
        assert command(device, action) is NackReason.OTHER_MODE, action.name.lower()
    assert device.status().mode == Mode.IDLE


@pytest.mark.motion
@pytest.mark.slow
def test_it_starts_pauses_resumes_and_is_aborted(device: Probe) -> None:
    start(device)
    assert device.status().mode == Mode.ONBOARD
    assert phase_becomes(device, DRIVING), "started, but in no driving phase"
    assert device.until(lambda: moves(device, 0.3), 5.0), "started, but does not move"
    assert command(device, PlannerAction.PAUSE) is None
    assert phase_becomes(device, {PlannerPhase.PAUSED})
    device.listen(0.6)
    assert not moves(device, 0.3), "paused, but moves"
    assert command(device, PlannerAction.RESUME) is None
    assert phase_becomes(device, DRIVING)
    assert command(device, PlannerAction.ABORT) is None
    device.listen(0.7)
    assert not moves(device, 0.2), "aborted, but moves"
    assert device.status().mode == Mode.IDLE


@pytest.mark.motion
@pytest.mark.slow
def test_a_stop_ends_it(device: Probe) -> None:
    start(device)
    assert phase_becomes(device, DRIVING)
    device.stop()
    device.listen(0.7)
    assert not moves(device, 0.2)
    status = device.status()
    assert (status.mode, status.stop_cause) == (Mode.IDLE, StopCause.OPERATOR)


@pytest.mark.motion
@pytest.mark.slow
def test_a_silent_host_ends_it(device: Probe) -> None:
    """The robot must not drive without the host that supervises the run."""
    start(device)
    assert phase_becomes(device, DRIVING)
    device.session_id = 0
    device.listen(2.0, alive=False)
    device.handshake()
    device.refusal(lambda i: SetStreamRate(i, 0x16, 500))
    device.forget()
    device.listen(0.1)
    assert not moves(device, 0.2)
    status = device.status()
    assert (status.mode, status.stop_cause) == (Mode.IDLE, StopCause.LINK)
