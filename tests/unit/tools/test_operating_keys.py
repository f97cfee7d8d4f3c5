"""The keys of a live run. Keys that cause motion need two presses."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest

from bridge.coverage.runner import PlanRunner
from bridge.motion.observation import HALT
from bridge.motion.robot_model import RobotModel
from bridge.run.dead_man_switch import DeadManSwitch
from bridge.run.host import Host
from bridge.run.manual import DriveMode, Operator
from bridge.run.mission import Mission
from bridge.run.onboard_mission import OnboardMission
from bridge.run.options import HostOptions
from bridge.session.records import Severity
from protocol.messages.device import Status
from protocol.messages.host import PlannerCommand
from protocol.messages.values import Mode, NackReason, OnboardPlanner, StopCause
from protocol.retransmission import Outcome
from support.events import Events
from support.straight import Straight
from tools.live.operating import Operating
from tools.live.terminal_keys import Key

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.run.ending import Ending
    from bridge.run.snapshot import Snapshot

MODEL = RobotModel()


class Loop:
    """A pump that runs each action at once."""

    def __init__(self, host: Host) -> None:
        self.host = host
        self.endings: list[Ending] = []

    @property
    def snapshot(self) -> Snapshot:
        return self.host.snapshot()

    def call(self, action: Callable[[], None]) -> None:
        action()

    def request_end(self, ending: Ending) -> None:
        self.endings.append(ending)


class KeysAtRest:
    """A host at rest, its loop and its keys."""

    def __init__(self, *, cause: StopCause = StopCause.SESSION_END) -> None:
        ids = itertools.count(1)
        self.sink = Events()
        self.host = Host(MODEL, self.sink, HostOptions(0), Mission(None), lambda: next(ids))
        self.host.state.take(Status(Mode.IDLE, cause, 0, 0, 0), 0, 0.0)
        self.loop = Loop(self.host)
        operator = Operator(
            MODEL, DeadManSwitch(0.3, 0.2), make_plan=lambda: PlanRunner(Straight(), MODEL)
        )
        self.gone_on = 0
        self.keys = Operating(self.loop, operator, on_resume=self._on_resume)  # type: ignore[arg-type]  # has all that is used

    def _on_resume(self) -> None:
        self.gone_on += 1

    def press(self, *names: str) -> str:
        for name in names:
            self.keys.on_key(Key(name))
        return self.keys.message

    def begun(self) -> bool:
        return self.host.mission.runner is not None

    def drive_mode(self) -> str:
        return self.keys.operator.drive_mode.value


def test_motion_begins_with_the_second_press() -> None:
    for key, drive_mode in (("g", DriveMode.PLAN), ("d", DriveMode.MANUAL)):
        bench = KeysAtRest()
        assert "again" in bench.press(key)
        assert not bench.begun()
        bench.press(key)
        assert bench.begun()
        assert bench.drive_mode() == drive_mode.value


def test_an_unplugged_gamepad_stops_the_robot_and_is_reported() -> None:
    bench = KeysAtRest()
    bench.press("d", "d")
    bench.keys.dead_man_switch.stick(1.0, 0.0, 5.0, held=True)
    assert bench.keys.dead_man_switch.wanted(5.0).v_m_s > 0.1
    bench.keys.pad_gone("/dev/input/js0")
    assert bench.keys.dead_man_switch.wanted(5.0) == HALT
    reported = bench.sink.events[-1]
    assert (reported.severity, reported.kind) == (Severity.WARNING, "gamepad_gone")
    assert "/dev/input/js0 is gone: the robot was stopped" in reported.text
    assert "keys still work" in bench.keys.message


def test_another_key_between_counts_for_nothing() -> None:
    bench = KeysAtRest()
    bench.press("g", "d", "g")
    assert not bench.begun()


def test_a_latched_stop_needs_a_persons_confirmation() -> None:
    bench = KeysAtRest(cause=StopCause.OPERATOR)
    assert "look, then press c" in bench.press("g", "g")
    assert not bench.begun()
    bench.press("c", "c", "g", "g")
    assert bench.begun()


def test_the_confirmation_is_for_the_stop_that_the_person_saw() -> None:
    bench = KeysAtRest(cause=StopCause.OPERATOR)
    bench.press("c", "c")
    bench.host.state.take(Status(Mode.IDLE, StopCause.HARDWARE, 0, 0, 0), 0, 0.0)
    assert "look, then press c" in bench.press("g", "g")
    assert not bench.begun()


def test_a_stop_with_an_unknown_cause_can_be_cleared() -> None:
    """A newer device may have further causes."""
    bench = KeysAtRest(cause=77)  # type: ignore[arg-type]  # unknown to this version
    assert "cause: unknown(77)" in bench.press("g", "g")
    bench.press("c", "c", "g", "g")
    assert bench.begun()


def test_a_key_that_fails_stops_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = KeysAtRest()

    def fail() -> None:
        raise IndexError("list index out of range")

    monkeypatch.setattr(bench.keys, "mark", fail)
    bench.press("m")
    (ending,) = bench.loop.endings
    assert (ending.outcome, ending.cause) == ("fault", StopCause.OPERATOR)
    assert ending.reason == "the key m failed: IndexError: list index out of range"


def test_a_plan_after_a_drive_by_hand_needs_two_presses_too() -> None:
    bench = KeysAtRest()
    bench.press("d", "d")
    bench.press("g")
    assert bench.drive_mode() == DriveMode.MANUAL.value
    bench.press("g")
    assert bench.drive_mode() == DriveMode.PLAN.value
    bench.press("p")
    assert bench.drive_mode() == DriveMode.HELD.value
    bench.press("d")
    assert bench.drive_mode() == DriveMode.MANUAL.value, "manual control stops the plan at once"


@pytest.mark.parametrize("key", ["space", "s"])
def test_stop_is_one_press_always(key: str) -> None:
    bench = KeysAtRest()
    bench.press("d", "d", "up", key)
    assert [(e.exit_status, e.cause) for e in bench.loop.endings] == [(5, StopCause.OPERATOR)]
    assert bench.keys.dead_man_switch.wanted(0.0) == (0.0, 0.0)


def test_a_mark_is_on_record_with_its_pose() -> None:
    bench = KeysAtRest()
    bench.press("m", "m")
    assert [(e.source, e.kind, e.data["number"]) for e in bench.sink.events] == [
        ("operator", "mark", 1),
        ("operator", "mark", 2),
    ]
    assert {"x_m", "y_m", "theta_rad"} <= bench.sink.events[0].data.keys()


def test_going_on_and_arrows_without_leave() -> None:
    bench = KeysAtRest()
    bench.press("r")
    assert bench.gone_on == 1
    assert "first" in bench.press("up")
    assert not bench.begun()


@pytest.mark.parametrize(
    ("outcome", "why"),
    [
        (None, "it did not answer"),
        (Outcome(PlannerCommand(1, 2, 1), accepted=False, reason=None), "it did not answer"),
        (
            Outcome(PlannerCommand(1, 2, 1), accepted=False, reason=NackReason.OTHER_MODE),
            "other_mode",
        ),
    ],
)
def test_a_device_that_does_not_pause_its_planner_is_reported(
    outcome: Outcome | None, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = KeysAtRest()
    bench.host.mission = OnboardMission(OnboardPlanner.RECOVERY)
    monkeypatch.setattr(bench.host.commands, "ask", lambda *asked: asked[-1](outcome))
    text = f"the device did not pause its planner ({why}); space stops it"
    assert bench.press("p") == text
    assert [(e.source, e.kind, e.text) for e in bench.sink.events] == [
        ("operator", "not_paused", text)
    ]


def test_a_planner_that_is_paused_reports_so(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = KeysAtRest()
    bench.host.mission = OnboardMission(OnboardPlanner.RECOVERY)
    answers: list[Callable[[Outcome], None]] = []
    monkeypatch.setattr(bench.host.commands, "ask", lambda *asked: answers.append(asked[-1]))
    assert bench.press("p") == "asking the device's planner to pause"
    answers[0](Outcome(PlannerCommand(1, 2, 1), accepted=True, reason=None))
    assert bench.keys.message == "the device's planner has been paused"
