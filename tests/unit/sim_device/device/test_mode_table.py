"""The mode table by itself; test_modes.py checks that the device follows the table."""

from __future__ import annotations

import itertools
import re
from collections import deque

import pytest

from protocol.messages.values import Fault, Mode, NackReason
from sim_device.device.modes import (
    GUARDED,
    MODE_OF,
    SET_EVENT,
    TABLE,
    DeviceState,
    Event,
    Guard,
    ModeMachine,
    drawn,
    rejections,
)
from support.root import ROOT

MOVING = {DeviceState.VELOCITY, DeviceState.BRINGUP, DeviceState.RUNNING}
"""States in which a wheel may turn."""
FREE = set(DeviceState) - {DeviceState.OFF, DeviceState.BOOT, DeviceState.STOPPED}


def outcome(state: DeviceState, event: Event, *holding: Guard) -> object:
    machine = ModeMachine(state)
    result = machine.fire(event, holding)
    assert machine.state is (result if isinstance(result, DeviceState) else state)
    return result


def test_every_state_has_an_answer_to_every_event() -> None:
    assert set(TABLE) == set(itertools.product(DeviceState, Event))
    for branches in TABLE.values():
        assert branches[-1].guard is None
        assert all(b.guard is not None for b in branches[:-1])
        assert all(isinstance(b.outcome, NackReason) for b in branches[:-1]), "a guard only rejects"


@pytest.mark.parametrize("state", [state for state in DeviceState if state in FREE])
def test_every_free_state_can_be_stopped(state: DeviceState) -> None:
    for event in (Event.STOP, Event.SILENCE, Event.NEW_SESSION):
        assert outcome(state, event, *Guard) is DeviceState.STOPPED
    assert outcome(state, Event.SUPPLY_LOST) is DeviceState.OFF
    assert outcome(state, Event.RESET) is DeviceState.BOOT


def test_from_stopped_only_clearing_by_name_leads_on_and_only_to_idle() -> None:
    ways = {e: TABLE[DeviceState.STOPPED, e] for e in Event}
    moves = {e: b[-1].outcome for e, b in ways.items() if isinstance(b[-1].outcome, DeviceState)}
    assert moves == {
        Event.CLEAR: DeviceState.IDLE,
        Event.STOP: DeviceState.STOPPED,
        Event.SUPPLY_LOST: DeviceState.OFF,
        Event.RESET: DeviceState.BOOT,
    }
    assert outcome(DeviceState.STOPPED, Event.CLEAR, Guard.OTHER_CAUSE) is NackReason.OTHER_CAUSE
    assert outcome(DeviceState.STOPPED, Event.CLEAR, Guard.CAUSE_HOLDS) is NackReason.FAULT


def test_only_a_motion_command_starts_motion() -> None:
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
    assert {state for state, _ in into} == {
        DeviceState.IDLE,
        DeviceState.ONBOARD,
        DeviceState.PAUSED,
    }


def test_off_and_boot_lead_through_a_latched_stop() -> None:
    """After any boot, the first state in which the device accepts a command is stopped."""
    seen, waiting = {DeviceState.OFF}, deque([DeviceState.OFF])
    while waiting:
        state = waiting.popleft()
        for event in Event:
            target = outcome(state, event)
            if isinstance(target, DeviceState) and target not in seen:
                seen.add(target)
                if target is not DeviceState.STOPPED:
                    waiting.append(target)
    assert seen == {DeviceState.OFF, DeviceState.BOOT, DeviceState.STOPPED}


def test_a_stopping_fault_ends_what_drives_by_itself_or_by_setpoints() -> None:
    for state in DeviceState:
        ends = outcome(state, Event.FAULT) is DeviceState.STOPPED
        assert ends is (state in GUARDED), state
    for state in FREE - {DeviceState.RUNNING, DeviceState.PAUSED}:
        for event in (Event.SET_VELOCITY, Event.SET_ONBOARD):
            assert outcome(state, event, Guard.FAULT_HOLDS) is NackReason.FAULT
        assert outcome(state, Event.SET_BRINGUP, Guard.FAULT_HOLDS) is DeviceState.BRINGUP


def test_how_the_devices_own_planner_ends_and_is_held() -> None:
    running, paused = DeviceState.RUNNING, DeviceState.PAUSED
    moves = {
        (running, Event.PAUSE): paused,
        (paused, Event.RESUME): running,
        (running, Event.ABORT): DeviceState.IDLE,
        (paused, Event.ABORT): DeviceState.IDLE,
        (running, Event.FINISHED): DeviceState.IDLE,
        (DeviceState.ONBOARD, Event.START): running,
    }
    for (state, event), target in moves.items():
        assert outcome(state, event) is target
    for state in DeviceState:
        assert ModeMachine(state).planning is (state in {running, paused})
        assert ModeMachine(state).awake is (state not in {DeviceState.OFF, DeviceState.BOOT})


def test_a_reset_or_a_supply_loss_interrupts_a_boot() -> None:
    assert outcome(DeviceState.BOOT, Event.RESET) is DeviceState.BOOT
    assert outcome(DeviceState.BOOT, Event.SUPPLY_LOST) is DeviceState.OFF
    assert outcome(DeviceState.OFF, Event.SUPPLY_BACK) is DeviceState.BOOT
    assert outcome(DeviceState.BOOT, Event.BOOTED) is DeviceState.STOPPED


def test_every_mode_of_the_wire_can_be_chosen() -> None:
    for mode, event in SET_EVENT.items():
        target = outcome(DeviceState.IDLE, event)
        assert isinstance(target, DeviceState)
        assert MODE_OF[target] == mode
    assert set(SET_EVENT) == set(Mode)
    assert set(MODE_OF) == set(DeviceState)


def test_the_diagram_shows_every_state_and_every_rejection_has_a_reason() -> None:
    moves = drawn()
    assert {end for move in moves for end in (move[0], move[2])} == {s.value for s in DeviceState}
    assert len(moves) == len(set(moves))
    assert (
        "stopped",
        "clear_stop (unless a different cause is latched or the fault that stopped it persists)",
        "idle",
    ) in moves
    assert ("planner start", "stopped", "stop_latched") in rejections()


def test_the_page_about_the_device_lists_every_rejection() -> None:
    page = (ROOT / "docs" / "device.md").read_text(encoding="utf-8")
    part = page.split("## Modes and rejected commands")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (.+?) \| (.+?) \| `(\w+)` \|$", part, re.MULTILINE)
    assert rows == rejections()


def test_the_page_explains_every_fault_bit() -> None:
    page = (ROOT / "docs" / "device.md").read_text(encoding="utf-8")
    part = page.split("## Fault bits")[1].split("\n#")[0]
    named = re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.+?`) \|", part, re.MULTILINE)))
    assert named == [(f.name or "").lower() for f in Fault]
