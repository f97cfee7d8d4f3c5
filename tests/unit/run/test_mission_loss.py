"""A run that loses its device, with and without continuing, and the timeout of each wait."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack

import pytest

from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.run.ending import Ending
from bridge.run.mission import Mission, Phase, Request, Resume
from bridge.run.onboard_mission import OnboardMission
from protocol.messages.device import Status
from protocol.messages.host import ClearStop, SetMode, Stop
from protocol.messages.values import Mode, NackReason, OnboardPlanner, StopCause
from protocol.retransmission import Outcome
from support.missions import phase, stop_confirmed
from support.observed import AT_REST

if TYPE_CHECKING:
    from bridge.run.runner import Runner
    from support.missions import MissionOptions

AHEAD = VelocityCommand(0.2, 0.0)


class Plan:
    """A plan that drives ahead, can be paused, and ends on request."""

    def __init__(self) -> None:
        self.finished = False
        self.finish_reason: str | None = None
        self.printed: list[str] = []

    def step(self, obs: Observation) -> VelocityCommand:
        del obs
        return AHEAD

    def pause(self) -> None:
        self.printed.append("held")

    def resume(self) -> None:
        self.printed.append("released")


def status(cause: int = 0, mode: int = Mode.VELOCITY) -> Status:
    return Status(mode, cause, 0, 0, 0)


def accepted(message: ClearStop | SetMode | Stop, reason: NackReason | None = None) -> Outcome:
    return Outcome(message, accepted=reason is None, reason=reason)


def made(plan: Plan | None = None, **options: Unpack[MissionOptions]) -> Mission:
    given: Runner = plan or Plan()  # type: ignore[assignment]  # as a Runner
    return Mission(given, **options)


def driving(plan: Plan | None = None, **options: Unpack[MissionOptions]) -> Mission:
    """Return a mission that has been driving since 16 s."""
    options["at_rest_s"] = 2.0
    mission = made(plan, **options)
    mission.on_ready(10.0)
    mission.on_status(status(), 12.0)
    mission.on_command(accepted(SetMode(1, 1)), 14.0)
    assert mission.step(AT_REST, None, 16.0) == HALT
    assert mission.step(AT_REST, None, 16.0) == AHEAD
    mission.requests()
    return mission


def ending(mission: Mission) -> Ending | None:
    return mission.ending


def runner(mission: Mission) -> object:
    return mission.runner


def resume_run(mission: Mission, at_s: float, cause: StopCause = StopCause.LINK) -> None:
    """Run the steps that enable motion after a loss."""
    mission.on_status(status(cause), at_s)
    mission.on_command(accepted(ClearStop(2, cause)), at_s)
    mission.on_command(accepted(SetMode(3, 1)), at_s)
    mission.step(AT_REST, None, at_s + 2.0)


def test_initial_state_of_a_mission() -> None:
    mission = made()
    assert (mission.phase, mission.done, mission.ending) == (Phase.WAITING, False, None)
    assert (mission.asking, stop_confirmed(mission)) == (False, False)
    assert {each.value for each in Resume} == {"never", "ask", "auto"}
    assert Request("mode", 1) == Request("mode", 1, planner=0)


def test_by_default_it_waits_for_2_5_s() -> None:
    mission = made()
    mission.on_ready(0.0)
    mission.on_status(status(), 0.0)
    mission.on_command(accepted(SetMode(1, 1)), 1.0)
    assert mission.step(AT_REST, None, 3.49) == HALT
    assert phase(mission) is Phase.SETTLING
    mission.step(AT_REST, None, 3.5)
    assert phase(mission) is Phase.DRIVING


@pytest.mark.parametrize(("obs", "stale"), [(None, None), (AT_REST, "imu"), (None, "imu")])
def test_it_does_not_set_out_without_its_data(obs: Observation | None, stale: str | None) -> None:
    mission = made(at_rest_s=2.0)
    mission.on_ready(0.0)
    mission.on_status(status(), 0.0)
    mission.on_command(accepted(SetMode(1, 1)), 1.0)
    for at_s in (3.0, 6.0):  # 2 s to settle, 3 s to wait for data
        assert mission.step(obs, stale, at_s) == HALT
        assert phase(mission) is Phase.SETTLING
        assert mission.drive_started_s is None
    assert mission.step(obs, stale, 6.01) == HALT
    assert ending(mission) == Ending("stopped", f"no {stale or 'range'} data from the device", 5)
    assert mission.drive_ended_s is None, "the robot never moved"


def test_without_an_observation_it_stands() -> None:
    mission = driving()
    assert mission.step(None, None, 17.0) == HALT
    assert ending(mission) is None
    assert mission.step(None, "imu", 17.0) == HALT
    assert ending(mission) is None, "stale data without an observation do not end the run"
    assert mission.step(AT_REST, "imu", 17.0) == HALT
    assert ending(mission) == Ending(
        "stopped", "no imu data from the device", 5, StopCause.SUPERVISE
    )
    idle = Mission(None)
    idle.phase = Phase.DRIVING
    assert idle.step(AT_REST, None, 1.0) == HALT


@pytest.mark.parametrize(("reason", "reported"), [("all swept", "all swept"), (None, "finished")])
def test_a_plan_that_ends_completes_the_run(reason: str | None, reported: str) -> None:
    mission = driving(plan := Plan())
    plan.finished, plan.finish_reason = True, reason
    assert mission.step(AT_REST, None, 20.0) == AHEAD, (
        "the last command of the plan is sent before the stop"
    )
    assert ending(mission) == Ending("complete", reported, 0)
    assert mission.requests() == [Request("stop", StopCause.SESSION_END)]
    assert (mission.drive_started_s, mission.drive_ended_s) == (16.0, 20.0)
    assert not mission.done
    mission.on_command(accepted(Stop(3, 1)), 20.5)
    assert (mission.done, stop_confirmed(mission)) == (True, True)
    assert mission.drive_ended_s == 20.0


def test_a_run_may_take_all_of_its_time() -> None:
    mission = driving(max_time_s=4.0)
    assert mission.step(AT_REST, None, 20.0) == AHEAD
    assert mission.step(AT_REST, None, 20.25) == HALT
    assert ending(mission) == Ending("timeout", "not finished after 4 s", 1)


def test_a_stop_that_was_rejected_is_not_confirmed() -> None:
    mission = driving()
    mission.request_end(Ending("stopped", "so", 0), 17.0)
    mission.on_command(accepted(Stop(3, 1), NackReason.FAULT), 17.1)
    assert (mission.done, stop_confirmed(mission)) == (True, False)


def test_the_wait_for_a_stop_ends_with_its_confirmation() -> None:
    mission = driving()
    mission.request_end(Ending("stopped", "so", 0), 17.0)
    assert mission.step(AT_REST, None, 18.0) is None
    assert not mission.done
    mission.step(AT_REST, None, 18.25)
    assert mission.done


def test_after_its_end_nothing_begins_a_second_one() -> None:
    mission = driving()
    mission.on_failed("gone", 3, 17.0)
    assert (mission.done, mission.drive_ended_s) == (True, 17.0)
    mission.request_end(Ending("stopped", "so", 0), 18.0)
    assert mission.requests() == []
    fresh = made()
    fresh.on_failed("never there", 3, 17.0)
    assert (fresh.done, fresh.drive_ended_s) == (True, None)
    watching = Mission(None)
    watching.phase = Phase.DONE
    watching.request_end(Ending("stopped", "so", 0), 18.0)
    assert (watching.ending, watching.requests()) == (None, [])


@pytest.mark.parametrize(
    ("message", "what"),
    [
        (ClearStop(1, 1), "clear stop"),
        (SetMode(1, Mode.VELOCITY), "velocity mode"),
        (SetMode(1, Mode.ONBOARD), "onboard mode"),
    ],
)
def test_rejected_and_unanswered_commands_are_named(
    message: ClearStop | SetMode, what: str
) -> None:
    for reason, text in ((None, f"the device did not answer {what}"), (NackReason.FAULT, None)):
        mission = made()
        mission.on_ready(0.0)
        mission.on_status(status(StopCause.SESSION_END), 0.0)
        mission.on_command(Outcome(message, accepted=False, reason=reason), 0.5)
        assert mission.ending is not None
        assert mission.ending.exit_status == 4
        assert text is None or mission.ending.reason == text
        assert text or mission.ending.reason.startswith(f"the device rejected {what}: ")


def test_a_rejected_onboard_mode_is_named() -> None:
    mission = OnboardMission(OnboardPlanner.PAPER)
    mission.on_ready(0.0)
    mission.on_status(status(), 0.0)
    assert mission.requests() == [Request("mode", Mode.ONBOARD)]
    mission.on_command(accepted(SetMode(1, Mode.ONBOARD), NackReason.FAULT), 0.5)
    assert ending(mission) == Ending("fault", "the device rejected onboard mode: fault", 4)


def test_a_plan_is_given_once_and_only_to_a_run_that_waits() -> None:
    first, second = Plan(), Plan()
    mission = Mission(None)
    mission.start(first)  # type: ignore[arg-type]  # as a Runner
    mission.start(second)  # type: ignore[arg-type]  # as a Runner
    assert runner(mission) is first
    gone = Mission(None)
    gone.on_ready(0.0)
    gone.on_lost(1.0)
    gone.start(first)  # type: ignore[arg-type]  # as a Runner
    assert runner(gone) is None, "the device is away"


def test_a_status_is_waited_for_from_when_there_is_a_plan_and_a_device() -> None:
    mission = Mission(None)
    mission.step(None, None, 0.0)
    mission.on_ready(1.0)
    mission.step(None, None, 2.0)
    mission.start(Plan())  # type: ignore[arg-type]  # as a Runner
    for at_s in (100.0, 103.0):
        mission.step(None, None, at_s)
        assert ending(mission) is None
    mission.step(None, None, 103.25)
    assert ending(mission) == Ending("fault", "no status from the device", 3)
    away = made()
    for at_s in (0.0, 50.0):
        away.step(None, None, at_s)
    assert ending(away) is None, "no device yet"


def test_a_new_status_is_awaited_after_a_loss() -> None:
    mission = made(resume=Resume.AUTO)
    mission.on_ready(0.0)
    mission.step(None, None, 1.0)
    mission.on_lost(2.0)
    mission.on_ready(20.0)
    mission.step(None, None, 20.0)
    mission.step(None, None, 23.0)
    assert ending(mission) is None


# ---- lost ------------------------------------------------------------------------------------


def test_a_device_may_be_away_for_30_s() -> None:
    mission = driving(plan := Plan())
    mission.on_lost(20.0)
    assert (mission.phase, plan.printed) == (Phase.HOLDING, ["held"])
    mission.step(None, None, 50.0)
    assert ending(mission) is None
    mission.step(None, None, 50.25)
    assert ending(mission) == Ending("fault", "the device was lost for 30 s", 3)
    assert (mission.done, mission.drive_ended_s) == (True, 50.25)


def test_a_plan_that_did_not_drive_is_not_held() -> None:
    plan = Plan()
    mission = made(plan)
    mission.on_lost(1.0)
    assert phase(mission) is Phase.WAITING, "no device was ready before"
    mission.on_ready(2.0)
    mission.on_lost(3.0)
    assert (mission.phase, plan.printed) == (Phase.HOLDING, [])


def test_a_loss_while_it_stops_ends_the_run_unconfirmed() -> None:
    mission = driving()
    mission.request_end(Ending("stopped", "so", 0), 17.0)
    mission.on_lost(17.5)
    reason = "so; the device did not confirm the stop"
    assert (mission.done, mission.ending) == (True, Ending("fault", reason, 3))
    mission.on_lost(18.0)
    assert phase(mission) is Phase.DONE


def test_an_end_without_a_device_waits_for_nothing() -> None:
    mission = driving()
    mission.on_lost(17.0)
    mission.request_end(Ending("stopped", "so", 0), 18.0)
    assert (mission.done, mission.requests()) == (True, [])
    assert mission.drive_ended_s == 18.0


def test_after_the_answer_the_plan_continues() -> None:
    mission = driving(plan := Plan(), resume=Resume.ASK)
    assert mission.resume(17.0) is False, "no question is open"
    mission.on_lost(18.0)
    assert mission.resume(18.5) is False, "the device is away"
    mission.on_ready(20.0)
    assert (mission.phase, mission.asking) == (Phase.HOLDING, True)
    mission.on_status(status(StopCause.LINK), 21.0)
    assert mission.requests() == [], "the operator has not answered yet"
    assert mission.resume(22.0) is True
    assert (mission.phase, mission.asking) == (Phase.WAITING, False)
    assert mission.resume(22.0) is False, "an answer counts once"
    resume_run(mission, 23.0)
    assert mission.requests() == [Request("clear", StopCause.LINK), Request("mode", Mode.VELOCITY)]
    assert phase(mission) is Phase.DRIVING
    assert plan.printed == ["held", "released"]
    assert mission.drive_started_s == 16.0, "the drive is not restarted"


@pytest.mark.parametrize("clear_stop", [False, True])
def test_a_leave_is_for_one_loss_and_for_its_own_stop(clear_stop: bool) -> None:  # noqa: FBT001 - a parameter of the test
    mission = driving(resume=Resume.ASK, clear_stop=clear_stop)
    mission.on_lost(18.0)
    mission.on_ready(20.0)
    mission.resume(22.0)
    mission.on_status(status(StopCause.OPERATOR), 23.0)
    assert mission.ending is not None, "an operator stopped the robot during the loss"
    mission = driving(plan := Plan(), resume=Resume.ASK)
    mission.on_lost(18.0)
    mission.on_ready(20.0)
    mission.resume(22.0)
    resume_run(mission, 23.0)
    mission.phase = Phase.WAITING  # as if motion had to be enabled again
    mission.requests()
    mission.on_status(status(StopCause.LINK), 26.0)
    assert mission.requests() == [Request("stop", StopCause.SESSION_END)], (
        "the permission covers one loss"
    )
    assert plan.printed == ["held", "released"]


def test_a_second_loss_cancels_the_question() -> None:
    mission = driving(resume=Resume.ASK)
    mission.on_lost(18.0)
    mission.on_ready(20.0)
    mission.on_lost(21.0)
    assert mission.asking is False
    assert mission.resume(22.0) is False
    mission.step(None, None, 51.25)
    assert ending(mission) == Ending("fault", "the device was lost for 30 s", 3)


def test_an_unanswered_question_ends_the_run() -> None:
    mission = driving(resume=Resume.ASK)
    mission.on_lost(18.0)
    mission.on_ready(20.0)
    mission.step(None, None, 50.0)
    assert ending(mission) is None
    mission.step(None, None, 50.25)
    text = "the device was lost and is back, but the operator did not continue the run"
    assert ending(mission) == Ending("stopped", text, 5)
    assert mission.requests() == [Request("stop", StopCause.SESSION_END)]
    assert mission.resume(51.0) is False


def test_nothing_is_asked_while_it_drives_or_waits() -> None:
    mission = driving(resume=Resume.ASK)
    mission.asking = True
    assert mission.resume(17.0) is False
    assert phase(mission) is Phase.DRIVING
    mission = made(resume=Resume.ASK)
    mission.on_ready(0.0)
    mission.on_lost(1.0)
    assert mission.resume(1.0) is False


def test_a_simulated_run_continues_by_itself() -> None:
    mission = driving(plan := Plan(), resume=Resume.AUTO)
    mission.on_lost(18.0)
    mission.on_ready(20.0)
    assert phase(mission) is Phase.WAITING
    resume_run(mission, 21.0)
    assert (mission.phase, plan.printed) == (Phase.DRIVING, ["held", "released"])


def test_by_default_it_ends() -> None:
    mission = driving()
    mission.on_lost(18.0)
    mission.on_ready(20.0)
    assert mission.ending is not None
    assert (mission.ending.outcome, mission.ending.exit_status) == ("stopped", 5)


def test_a_free_device_that_is_moved_on_is_no_stop() -> None:
    mission = driving()
    mission.on_status(status(StopCause.NONE), 17.0)
    assert ending(mission) is None


@pytest.mark.parametrize("mode", [Mode.IDLE, Mode.BRINGUP, Mode.ONBOARD, 77])
def test_a_device_in_another_mode_than_it_acknowledged_ends_the_drive(mode: int) -> None:
    mission = driving()
    mission.on_status(status(StopCause.NONE, mode), 17.0)
    end = ending(mission)
    assert end is not None
    assert "the device is in mode" in end.reason
    assert (end.exit_status, end.cause) == (5, StopCause.SUPERVISE)
    assert mission.requests() == [Request("stop", StopCause.SUPERVISE)]


@pytest.mark.parametrize("exit_status", [0, 1, 4, 5])
def test_a_drive_whose_stop_is_not_confirmed_ends_with_status_3(exit_status: int) -> None:
    mission = driving()
    mission.request_end(Ending("stopped", "so", exit_status, StopCause.SUPERVISE), 17.0)
    mission.on_lost(17.5)
    reason = "so; the device did not confirm the stop"
    assert mission.ending == Ending("fault", reason, 3, StopCause.SUPERVISE)


def test_a_stop_that_a_status_shows_keeps_the_runs_own_status() -> None:
    mission = driving()
    mission.request_end(Ending("stopped", "so", 5, StopCause.SUPERVISE), 17.0)
    mission.on_status(status(StopCause.LINK), 17.2)
    mission.on_lost(17.5)
    reason = "so; the device did not confirm the stop"
    assert mission.ending == Ending("stopped", reason, 5, StopCause.SUPERVISE)


def test_a_drive_whose_session_fails_reports_that_no_stop_is_confirmed() -> None:
    mission = driving()
    mission.on_failed("another device", 4, 17.0)
    end = ending(mission)
    assert end is not None
    assert end.reason == "another device; the device did not confirm the stop"
    assert end.exit_status == 3


@pytest.mark.parametrize("enabled", [False, True], ids=["asked to", "settling"])
def test_a_device_that_dies_before_the_first_move_gives_status_3(*, enabled: bool) -> None:
    """Motion may have been enabled, so the run must not end as if the stop were confirmed."""
    mission = made(at_rest_s=2.0)
    mission.on_ready(10.0)
    mission.on_status(status(), 12.0)
    if enabled:
        mission.on_command(accepted(SetMode(1, 1)), 14.0)
    mission.on_lost(15.0)
    mission.end_unconfirmed(Ending("stopped", "so", 0), 16.0)
    assert ending(mission) == Ending("fault", "so; the device did not confirm the stop", 3)
