"""The phases of a run: the steps that enable motion, and the time limit of each phase."""

from __future__ import annotations

import pytest

from bridge.coverage.runner import PlanRunner
from bridge.errors import Remedy
from bridge.motion.observation import HALT
from bridge.run.ending import Ending
from bridge.run.mission import (
    AT_REST_S,
    DATA_TIMEOUT_S,
    END_TIMEOUT_S,
    LOST_TIMEOUT_S,
    Mission,
    Phase,
    Request,
)
from protocol.messages.device import Status
from protocol.messages.host import ClearStop, Stop
from protocol.messages.values import Fault, Mode, NackReason, StopCause
from protocol.retransmission import Outcome
from support.ends import Spinning
from support.missions import (
    CLEARED,
    ENABLED,
    MODEL,
    STOPPED,
    driving,
    ending,
    phase,
    planned,
    seen,
    status,
    stop_confirmed,
)


def ended(mission: Mission) -> bool:
    return mission.ending is not None


def test_each_step_waits_for_the_one_before() -> None:
    mission = planned()
    assert mission.step(None, None, 0.0) is None
    mission.on_status(status(StopCause.SESSION_END), 0.0)
    assert mission.requests() == [], "no request before the handshake"
    mission.on_ready(0.1)
    mission.on_status(status(StopCause.SESSION_END), 0.2)
    assert mission.requests() == [Request("clear", StopCause.SESSION_END)]
    mission.on_status(status(StopCause.SESSION_END), 0.3)
    assert mission.requests() == []
    assert mission.step(seen(0.3), None, 0.3) is None, "no velocity before the stop is cleared"
    mission.on_command(CLEARED, 0.4)
    assert mission.requests() == [Request("mode", Mode.VELOCITY)]
    mission.on_command(ENABLED, 0.5)
    assert mission.step(seen(0.6), None, 0.6) == HALT
    assert mission.step(seen(2.9), None, 0.5 + AT_REST_S - 0.01) == HALT
    assert phase(mission) is Phase.SETTLING
    mission.step(seen(3.0), None, 0.5 + AT_REST_S)
    assert phase(mission) is Phase.DRIVING
    assert mission.drive_started_s == 0.5 + AT_REST_S
    mission.step(seen(3.1), None, 3.1)
    command = mission.step(seen(3.2), None, 3.2)
    assert command is not None
    assert command != HALT


@pytest.mark.parametrize("cause", [c for c in StopCause if c > StopCause.SESSION_END])
def test_a_latched_stop_is_not_cleared_unasked(cause: StopCause) -> None:
    mission = planned()
    mission.on_ready(0.0)
    mission.on_status(status(cause), 0.1)
    assert (ending(mission).outcome, ending(mission).exit_status) == ("stopped", 5)
    assert f"cause: {cause.name.lower()}" in ending(mission).reason
    assert ending(mission).remedy is Remedy.CLEAR_STOP
    assert "--" not in ending(mission).reason
    assert [r.kind for r in mission.requests()] == ["stop"]
    free = planned(clear_stop=True)
    free.on_ready(0.0)
    free.on_status(status(cause), 0.1)
    assert free.requests() == [Request("clear", cause)]


def test_a_stop_latched_meanwhile_ends_the_run() -> None:
    mission = driving()
    mission.on_status(status(StopCause.HARDWARE), 4.0)
    assert ending(mission).exit_status == 5
    assert "hardware" in ending(mission).reason
    assert mission.step(seen(4.1), None, 4.1) is None


@pytest.mark.parametrize(
    ("cause", "named"),
    [(StopCause.HARDWARE, "hardware, motor_stall, lifted"), (StopCause.LINK, "link, lifted")],
)
def test_the_reason_of_a_hardware_stop_names_the_fault_that_the_stop_ended(
    cause: StopCause, named: str
) -> None:
    mission = driving()
    mission.on_status(Status(Mode.VELOCITY, 0, Fault.MOTOR_STALL, 0, 0), 3.9)
    mission.on_status(Status(Mode.VELOCITY, cause, Fault.LIFTED, 0, 0), 4.0)
    assert ending(mission).reason == f"the device latched a stop (cause: {named})"


@pytest.mark.parametrize(
    ("outcome", "ended", "exit_status", "word"),
    [
        (Outcome(ClearStop(1, 1), False, NackReason.OTHER_CAUSE), "stopped", 5, "other_cause"),  # noqa: FBT003 - rejected
        (Outcome(ClearStop(1, 1), False, NackReason.FAULT), "fault", 4, "rejected"),  # noqa: FBT003 - rejected
        (Outcome(ClearStop(1, 1), False, None), "fault", 4, "did not answer"),  # noqa: FBT003 - no answer
    ],
)
def test_a_rejected_clear_ends_the_run(
    outcome: Outcome, ended: str, exit_status: int, word: str
) -> None:
    mission = planned()
    mission.on_ready(0.0)
    mission.on_status(status(StopCause.SESSION_END), 0.1)
    mission.on_command(outcome, 0.5)
    assert (ending(mission).outcome, ending(mission).exit_status) == (ended, exit_status)
    assert word in ending(mission).reason


@pytest.mark.parametrize(
    ("signed", "text"),
    [
        (False, "the device did not answer clear stop"),
        (True, "the device did not answer clear stop; check that the key is the device's key"),
    ],
)
def test_a_host_that_signs_is_asked_about_the_key(signed: bool, text: str) -> None:  # noqa: FBT001 - a case
    mission = planned()
    mission.signed = signed
    mission.on_ready(0.0)
    mission.on_status(status(StopCause.SESSION_END), 0.1)
    mission.on_command(Outcome(ClearStop(1, 1), accepted=False, reason=None), 0.5)
    assert ending(mission).reason == text


def test_no_status_is_no_reason_to_wait_for_ever() -> None:
    mission = planned()
    mission.step(None, "imu", 100.0)
    assert phase(mission) is Phase.WAITING, "the session times the handshake"
    mission.on_ready(100.0)
    mission.step(None, "imu", 100.0)
    mission.step(None, "imu", 100.0 + DATA_TIMEOUT_S)
    assert not ended(mission)
    mission.step(None, "imu", 100.1 + DATA_TIMEOUT_S)
    assert (ending(mission).outcome, ending(mission).exit_status) == ("fault", 3)


def test_settling_without_data_ends() -> None:
    mission = planned()
    mission.on_ready(0.0)
    mission.on_status(status(), 0.0)
    mission.on_command(ENABLED, 0.0)
    for tenth in range(200):
        mission.step(None, "imu", tenth / 10)
    assert ending(mission).reason.startswith("no imu data from the device")
    assert ending(mission).exit_status == 5
    assert phase(mission) is Phase.DONE


def test_driving_without_data_stops_at_once() -> None:
    mission = driving()
    assert mission.step(seen(4.0), "range", 4.0) == HALT
    assert "range" in ending(mission).reason
    assert mission.requests() == [Request("stop", StopCause.SUPERVISE)]


def test_the_end_waits_for_the_devices_word() -> None:
    mission = driving()
    mission.request_end(Ending("stopped", "ended by Ctrl-C", 0), 4.0)
    assert mission.requests() == [Request("stop", StopCause.SESSION_END)]
    assert mission.step(seen(4.1), None, 4.1) is None, "nothing is sent after the stop"
    assert phase(mission) is not Phase.DONE
    mission.on_command(STOPPED, 4.2)
    assert phase(mission) is Phase.DONE
    assert ending(mission) == Ending("stopped", "ended by Ctrl-C", 0)
    assert mission.drive_ended_s == 4.0


def test_but_not_for_ever_and_reports_it() -> None:
    mission = driving()
    mission.request_end(Ending("stopped", "ended by Ctrl-C", 0), 4.0)
    mission.step(seen(4.9), None, 4.0 + END_TIMEOUT_S)
    assert phase(mission) is not Phase.DONE
    mission.step(seen(5.1), None, 4.1 + END_TIMEOUT_S)
    assert phase(mission) is Phase.DONE
    assert ending(mission).reason == "ended by Ctrl-C; the device did not confirm the stop"


def test_a_second_end_changes_nothing() -> None:
    mission = driving()
    mission.request_end(Ending("stopped", "first", 0), 4.0)
    mission.request_end(Ending("fault", "second", 1), 4.1)
    assert ending(mission).reason == "first"
    assert len(mission.requests()) == 1


def test_a_time_limit_ends_with_a_halt() -> None:
    mission = driving(max_time_s=10.0)
    mission.step(seen(11.9), None, 11.9)
    assert mission.step(seen(12.0), None, 12.0) != HALT
    assert mission.step(seen(13.1), None, 13.1) == HALT
    assert (ending(mission).outcome, ending(mission).exit_status) == ("timeout", 1)


def test_lost_and_back_never_drives_on() -> None:
    mission = driving()
    mission.on_lost(5.0)
    assert phase(mission) is Phase.HOLDING
    assert mission.step(seen(5.1), None, 5.1) is None
    mission.on_ready(8.0)
    assert ending(mission).exit_status == 5
    assert "lost and is back" in ending(mission).reason
    assert [r.kind for r in mission.requests()] == ["stop"]
    mission.on_status(status(), 8.1)
    assert mission.step(seen(8.2), None, 8.2) is None


@pytest.mark.parametrize("watching", [True, False])
def test_lost_for_good_is_a_fault(watching: bool) -> None:  # noqa: FBT001 - both cases are compared
    mission = Mission(None) if watching else driving()
    mission.on_ready(4.0)
    mission = mission if watching else driving()
    mission.on_lost(5.0)
    mission.step(None, None, 5.0 + LOST_TIMEOUT_S)
    assert phase(mission) is not Phase.DONE
    mission.step(None, None, 5.1 + LOST_TIMEOUT_S)
    assert phase(mission) is Phase.DONE
    assert (ending(mission).outcome, ending(mission).exit_status) == ("fault", 3)


def test_watching_continues_when_the_device_is_back() -> None:
    mission = Mission(None)
    mission.on_ready(0.0)
    mission.on_status(status(StopCause.OPERATOR), 1.0)
    mission.on_lost(5.0)
    mission.on_ready(8.0)
    assert phase(mission) is Phase.WAITING
    mission.step(None, None, 1000.0)
    assert not ended(mission)
    assert mission.requests() == []


def test_a_failed_session_is_the_end() -> None:
    mission = planned()
    mission.on_failed("nothing received", 3, 3.0)
    assert phase(mission) is Phase.DONE
    assert ending(mission) == Ending("fault", "nothing received", 3)


def test_a_plan_may_come_long_after_the_device() -> None:
    mission = Mission(None)
    mission.on_ready(0.0)
    mission.step(None, None, 99.9)
    mission.start(PlanRunner(Spinning(MODEL), MODEL))
    mission.step(None, None, 100.0)
    assert not ended(mission)
    mission.on_status(status(StopCause.SESSION_END), 100.1)
    assert mission.requests() == [Request("clear", StopCause.SESSION_END)]


def test_a_clear_that_was_allowed_is_for_the_cause_that_was_seen() -> None:
    mission = Mission(None)
    mission.on_ready(0.0)
    mission.start(PlanRunner(Spinning(MODEL), MODEL), clear_stop=True)
    mission.on_status(status(StopCause.OPERATOR), 0.1)
    assert mission.requests() == [Request("clear", StopCause.OPERATOR)]


STOP = Ending("stopped", "stopped by another process", 5, StopCause.OPERATOR)
CTRL_C = Ending("stopped", "ended by Ctrl-C", 0)


def acknowledged(cause: StopCause) -> Outcome:
    return Outcome(Stop(9, cause), accepted=True, reason=None)


def test_a_graver_stop_has_its_own_confirmation_awaited() -> None:
    mission = driving()
    mission.request_end(CTRL_C, 4.0)
    mission.request_end(STOP, 4.5)
    assert mission.requests() == [
        Request("stop", StopCause.SESSION_END),
        Request("stop", StopCause.OPERATOR),
    ]
    mission.on_command(acknowledged(StopCause.SESSION_END), 4.6)
    assert (phase(mission), stop_confirmed(mission)) == (Phase.ENDING, False)
    mission.step(None, None, 4.4 + END_TIMEOUT_S)
    assert phase(mission) is Phase.ENDING, "the timeout starts at the second request"
    mission.on_command(acknowledged(StopCause.OPERATOR), 5.45)
    assert (phase(mission), stop_confirmed(mission)) == (Phase.DONE, True)
    assert (mission.ending, mission.confirmed) == (STOP, StopCause.OPERATOR)
    assert mission.drive_ended_s == 4.0, "the first request ended the drive"


def test_a_lesser_stop_changes_nothing() -> None:
    mission = driving()
    mission.request_end(STOP, 4.0)
    mission.request_end(CTRL_C, 4.5)
    assert mission.requests() == [Request("stop", StopCause.OPERATOR)]
    mission.on_command(acknowledged(StopCause.OPERATOR), 4.6)
    assert (phase(mission), mission.ending) == (Phase.DONE, STOP)


def test_a_graver_stop_right_after_the_end_is_still_sent() -> None:
    mission = driving()
    mission.request_end(CTRL_C, 4.0)
    mission.on_command(acknowledged(StopCause.SESSION_END), 4.1)
    mission.requests()
    mission.request_end(STOP, 4.1)
    assert mission.requests() == [Request("stop", StopCause.OPERATOR)]
    assert (phase(mission), stop_confirmed(mission)) == (Phase.ENDING, False)
    mission.on_command(acknowledged(StopCause.OPERATOR), 4.2)
    assert (phase(mission), mission.ending) == (Phase.DONE, STOP)


def test_an_operators_stop_is_sent_despite_the_devices_own_latch() -> None:
    mission = driving()
    mission.on_status(status(StopCause.HARDWARE), 4.0)
    mission.request_end(STOP, 4.1)
    assert [r.value for r in mission.requests()] == [StopCause.SESSION_END, StopCause.OPERATOR]
    mission.on_command(acknowledged(StopCause.OPERATOR), 4.2)
    assert "hardware" in ending(mission).reason, "the hardware stop outranks the operator's stop"
    assert mission.confirmed is StopCause.OPERATOR


@pytest.mark.parametrize("cause", list(StopCause)[1:])
def test_gravity_is_the_order_of_the_protocols_causes(cause: StopCause) -> None:
    one = Ending("stopped", "one", 5, cause)
    for other in list(StopCause)[1:]:
        two = Ending("stopped", "two", 5, other)
        assert one.outranks(two) is (cause > other)
        latched = Ending("stopped", "three", 5, latched=other)
        assert one.outranks(latched) is (cause > max(other, StopCause.SESSION_END))
