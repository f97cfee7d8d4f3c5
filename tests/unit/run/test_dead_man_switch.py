"""Manual driving: the robot moves while a key is held, and stops on a release or a timeout."""

from __future__ import annotations

import math
import os
import struct
import threading
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.coverage.runner import PlanRunner
from bridge.errors import PortError
from bridge.io.gamepad import Gamepad, PadLayout, PadState, Sticks, open_joystick
from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.motion.robot_model import RobotModel
from bridge.run.dead_man_switch import DIRECTIONS, HELD_S, PRESS_M_S, PRESS_S, DeadManSwitch
from bridge.run.manual import DriveMode, Operator
from bridge.run.runner import hold, release
from support.observed import AT_REST
from support.straight import Straight

MODEL = RobotModel()


def dead_man_switch(*, releases: bool) -> DeadManSwitch:
    return DeadManSwitch(0.3, 0.2, releases)


# ---- a terminal without key releases ----------------------------------------------------


def test_a_press_drives_for_seven_tenths_at_a_tenth() -> None:
    drive_mode = dead_man_switch(releases=False)
    drive_mode.press("up", 10.0)
    assert drive_mode.wanted(10.0) == VelocityCommand(0.1, 0.0)
    assert drive_mode.wanted(10.7) == VelocityCommand(0.1, 0.0)
    assert drive_mode.wanted(10.71) == HALT
    assert drive_mode.wanted(10.2) == HALT, "a key that timed out stays released"


def test_any_other_key_stops() -> None:
    drive_mode = dead_man_switch(releases=False)
    drive_mode.press("up", 10.0)
    drive_mode.press("q", 10.1)
    assert drive_mode.wanted(10.1) == HALT


def test_only_the_newest_press_counts() -> None:
    drive_mode = dead_man_switch(releases=False)
    drive_mode.press("up", 10.0)
    drive_mode.press("left", 10.3)
    found = drive_mode.wanted(10.4)
    assert found.v_m_s == 0.0
    assert found.yaw_rate_rad_s > 0.0


# ---- a terminal with key releases -------------------------------------------------------


def test_a_held_key_drives_until_it_comes_up() -> None:
    drive_mode = dead_man_switch(releases=True)
    drive_mode.press("up", 0.0)
    for i in range(1, 50):
        drive_mode.press("up", 0.1 * i)
        assert drive_mode.wanted(0.1 * i).v_m_s == pytest.approx(0.2)
    drive_mode.release("up", 4.95)
    assert drive_mode.wanted(4.96) == HALT


def test_two_held_keys_make_a_curve_and_one_continues_alone() -> None:
    drive_mode = dead_man_switch(releases=True)
    drive_mode.press("up", 0.0)
    drive_mode.press("left", 0.1)
    assert drive_mode.wanted(0.2) == VelocityCommand(0.2, 1.0)
    drive_mode.release("left", 0.3)
    assert drive_mode.wanted(0.35) == VelocityCommand(0.2, 0.0)


def test_a_hung_terminal_releases_the_keys() -> None:
    drive_mode = dead_man_switch(releases=True)
    drive_mode.press("down", 0.0)
    assert drive_mode.wanted(HELD_S).v_m_s == pytest.approx(-0.2)
    assert drive_mode.wanted(HELD_S + 0.01) == HALT


def test_the_opposite_direction_wins_at_once() -> None:
    drive_mode = dead_man_switch(releases=True)
    drive_mode.press("up", 0.0)
    drive_mode.press("down", 0.1)
    assert drive_mode.wanted(0.1).v_m_s == pytest.approx(-0.2)


def test_the_speed_stays_within_the_robots() -> None:
    drive_mode = dead_man_switch(releases=True)
    for _ in range(20):
        drive_mode.faster()
    assert drive_mode.speed_m_s == 0.3
    for _ in range(30):
        drive_mode.slower()
    assert drive_mode.speed_m_s == pytest.approx(0.03)


EVENTS = st.lists(
    st.tuples(
        st.sampled_from(["press", "release", "wait", "stick"]),
        st.sampled_from([*DIRECTIONS, "q", "escape"]),
        st.floats(0.0, 1.5),
        st.floats(-3.0, 3.0),
        st.booleans(),
    ),
    max_size=40,
)


@settings(max_examples=60, deadline=None)
@given(events=EVENTS, releases=st.booleans())
def test_with_any_keys_it_never_drives_long_without_an_event(
    events: list[tuple[str, str, float, float, bool]], *, releases: bool
) -> None:
    """The command stays within the limits, and becomes a halt if no further event follows."""
    drive_mode, now_s = dead_man_switch(releases=releases), 0.0
    for what, key, wait_s, share, held in events:
        now_s += wait_s
        match what:
            case "press":
                drive_mode.press(key, now_s)
            case "release":
                drive_mode.release(key, now_s)
            case "stick":
                drive_mode.stick(share, -share, now_s, held=held)
            case _:
                pass
        found = drive_mode.wanted(now_s)
        assert abs(found.v_m_s) <= 0.2 + 1e-12
        if not releases and not any(e[0] == "stick" for e in events):
            assert abs(found.v_m_s) <= PRESS_M_S
    assert drive_mode.wanted(now_s + max(HELD_S, PRESS_S) + 0.01) == HALT


# ---- the gamepad ------------------------------------------------------------------------


def event(kind: int, number: int, value: int) -> bytes:
    """Return an event as the kernel's joystick-api.rst describes it."""
    return struct.pack("<I", 123) + struct.pack("<h", value) + bytes([kind, number])


def test_sticks_and_buttons_of_the_kernels_events() -> None:
    pad = PadState(PadLayout())
    assert pad.feed(event(0x82, 1, 0) + event(0x81, 4, 0)) is False
    assert pad.sticks == Sticks(0.0, 0.0, held=False)
    pad.feed(event(2, 1, -32767))  # stick pushed up
    pad.feed(event(1, 4, 1))
    assert pad.sticks == Sticks(1.0, 0.0, held=True)
    pad.feed(event(2, 0, 32767)[:3])
    pad.feed(event(2, 0, 32767)[3:])  # stick to the right; the event arrives in two pieces
    assert pad.sticks.turn == -1.0
    pad.feed(event(2, 0, 3000))
    assert pad.sticks.turn == 0.0, "a small deflection counts as the centre"
    assert pad.feed(event(1, 1, 1)) is True
    assert pad.feed(event(0x81, 1, 1)) is False, "a button state at opening is not a press"


def open_fifo(path: str) -> int:
    return os.open(path, os.O_RDONLY | os.O_NONBLOCK)


def test_a_gamepad_drives_and_its_loss_releases_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridge.io.gamepad.open_joystick", open_fifo)
    path = str(tmp_path / "js0")
    os.mkfifo(path)
    seen: list[Sticks] = []
    stopped = threading.Event()
    news = threading.Event()

    def take(sticks: Sticks) -> None:
        seen.append(sticks)
        news.set()

    keeper = os.open(path, os.O_RDWR)
    gone: list[Sticks] = []
    with Gamepad(path, take, stopped.set, on_gone=lambda: gone.append(seen[-1])):
        os.write(keeper, event(1, 4, 1) + event(2, 1, -32767))
        assert news.wait(20.0)
        assert seen[-1] == Sticks(1.0, 0.0, held=True)
        news.clear()
        assert news.wait(20.0), "a held stick is reported repeatedly"
        os.write(keeper, event(1, 1, 1))
        assert stopped.wait(20.0)
        os.close(keeper)  # unplugged
        while seen[-1].held:
            news.clear()
            assert news.wait(20.0)
    assert seen[-1] == Sticks(0.0, 0.0, held=False)
    assert gone == [Sticks(0.0, 0.0, held=False)], "the loss is reported once, after the release"


def test_a_gamepad_that_sends_nothing_is_released(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridge.io.gamepad.open_joystick", open_fifo)
    monkeypatch.setattr("bridge.io.gamepad.SILENT_S", 0.5)
    path = str(tmp_path / "js0")
    os.mkfifo(path)
    keeper = os.open(path, os.O_RDWR)
    driven, released = threading.Event(), threading.Event()

    def take(sticks: Sticks) -> None:
        if sticks.held:
            driven.set()
        elif driven.is_set():
            released.set()

    with Gamepad(path, take, lambda: None):
        os.write(keeper, event(1, 4, 1) + event(2, 1, -32767))
        assert driven.wait(20.0)
        assert released.wait(20.0), "the link to the pad may be lost"
        driven.clear()
        os.write(keeper, event(2, 1, -32000))
        assert driven.wait(20.0), "an event drives again"
    os.close(keeper)


def test_no_such_gamepad() -> None:
    with pytest.raises(PortError, match="plug in the gamepad"):
        Gamepad("/dev/input/js99", lambda _s: None, lambda: None)


@pytest.mark.parametrize("kind", ["file", "fifo", "folder", "null"])
def test_a_file_that_is_no_joystick_is_no_gamepad(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "js0"
    if kind == "file":
        path.write_bytes(event(1, 4, 1))
    elif kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path = Path(os.devnull)
    with pytest.raises(PortError, match="is no gamepad; give a joystick") as caught:
        open_joystick(str(path))
    assert caught.value.exit_status == 3


# ---- a run under manual control ---------------------------------------------------------


def observed(time_s: float, *, bumped: bool = False) -> Observation:
    return AT_REST._replace(time_s=time_s, bumper_left=bumped)


def operator(*, manual: bool = False, plan: bool = True) -> Operator:
    runner = PlanRunner(Straight(), MODEL) if plan else None
    return Operator(MODEL, DeadManSwitch(0.3, 0.2, releases=True), plan=runner, manual=manual)


def run(person: Operator, start_s: float, steps: int) -> VelocityCommand:
    command = HALT
    for i in range(steps):
        command = person.step(observed(start_s + 0.02 * i))
    return command


def test_a_plan_is_paused_taken_over_and_resumed() -> None:
    person = operator()
    assert run(person, 0.0, 30).v_m_s > 0.05
    person.toggle_pause()
    assert person.drive_mode is DriveMode.HELD
    assert run(person, 1.0, 5) == HALT
    assert person.state.state == "held"
    person.take_over()
    person.dead_man_switch.press("left", 2.0)
    turning = run(person, 2.0, 20)
    assert turning.v_m_s == 0.0
    assert turning.yaw_rate_rad_s > 0.5
    person.take_over()
    assert person.drive_mode is DriveMode.HELD
    assert run(person, 3.0, 5) == HALT
    person.start()
    assert run(person, 4.0, 30).v_m_s > 0.05
    kinds = [event.kind for event in person.drain_events()]
    assert kinds == ["operator"] * 4


def test_supervision_holds_the_plan_and_not_the_operators_choice() -> None:
    person = operator()
    run(person, 0.0, 30)
    hold(person)
    assert run(person, 1.0, 20) == HALT
    assert person.drive_mode is DriveMode.PLAN
    release(person)
    assert run(person, 2.0, 30).v_m_s > 0.05
    person.toggle_pause()
    hold(person)
    release(person)
    assert run(person, 3.0, 20) == HALT, "the operator has paused it"


def test_by_hand_from_the_beginning_nothing_moves_alone() -> None:
    person = operator(manual=True, plan=False)
    assert run(person, 0.0, 100) == HALT
    assert not person.finished
    person.dead_man_switch.press("up", 2.0)
    first = person.step(observed(2.0))
    assert 0.0 < first.v_m_s <= MODEL.max_accel_m_s2 * 0.02 + 1e-9, "acceleration is limited"


def test_no_motion_ahead_into_a_contact() -> None:
    person = operator(manual=True, plan=False)
    person.dead_man_switch.press("up", 0.0)
    assert person.step(observed(0.0, bumped=True)).v_m_s == 0.0
    person.dead_man_switch.press("down", 0.1)
    backwards = [person.step(observed(0.1 + 0.02 * i, bumped=True)).v_m_s for i in range(10)]
    assert backwards[-1] < 0.0, "the robot may reverse out of a contact"
    assert not math.isnan(sum(backwards))
