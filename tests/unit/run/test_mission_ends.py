"""Ends of a run that are not the planner's: a slow link, an unconfirmed stop, a failed loop."""

from __future__ import annotations

import pytest

from bridge.errors import Remedy
from bridge.motion.observation import HALT
from bridge.run.ending import Ending
from bridge.run.mission import (
    AT_REST_S,
    DATA_TIMEOUT_S,
    END_TIMEOUT_S,
    Mission,
    Phase,
    Request,
    Resume,
)
from bridge.session.round_trip import LinkTrouble
from protocol.messages.host import SetMode, Stop
from protocol.messages.values import NackReason, StopCause
from protocol.retransmission import Outcome
from support.missions import driving, ending, phase, planned, seen, settling, status

SLOW, UNMEASURED = LinkTrouble("too slow", known=True), LinkTrouble("not measured", known=False)
COMPLETE = Ending("complete", "swept", 0)
BROKEN = Ending("fault", "broken", 1)


def ready() -> Mission:
    mission = planned()
    mission.on_ready(0.0)
    return mission


def at(mission: Mission, now_s: float, link: LinkTrouble | None) -> None:
    mission.link = link
    mission.step(None, None, now_s)


# ---- a slow link -----------------------------------------------------------------------------


def test_the_link_may_be_slow_for_four_seconds_before_the_first_move() -> None:
    mission = settling()
    at(mission, 1.0, SLOW)
    at(mission, 5.0, SLOW)
    assert mission.ending is None
    at(mission, 5.01, SLOW)
    assert (ending(mission).reason, ending(mission).cause) == ("too slow", StopCause.LINK)
    assert ending(mission).exit_status == 5
    assert mission.requests() == [Request("stop", StopCause.LINK)]


@pytest.mark.parametrize("between", [None, UNMEASURED])
def test_a_link_that_was_quick_in_between_gets_the_whole_time_again(
    between: LinkTrouble | None,
) -> None:
    mission = settling()
    at(mission, 0.5, SLOW)
    at(mission, 1.0, between)
    at(mission, 1.5, SLOW)
    at(mission, 5.4, SLOW)
    assert mission.ending is None


def test_a_new_session_gets_the_whole_time_again() -> None:
    mission = planned(resume=Resume.AUTO)
    mission.on_ready(0.0)
    at(mission, 1.0, SLOW)
    mission.on_ready(3.0)
    at(mission, 5.1, SLOW)
    assert mission.ending is None


def test_a_link_that_is_not_measured_yet_does_not_end_the_run() -> None:
    mission = settling()
    for k in range(50):
        mission.link = UNMEASURED
        mission.step(None, None, 0.05 * k)
    assert mission.ending is None


def test_a_slow_link_ends_no_run_that_only_monitors_or_has_no_session() -> None:
    for mission in (Mission(None), planned()):
        if mission.runner is None:
            mission.on_ready(0.0)
        for now_s in (1.0, 4.0, 9.0):
            at(mission, now_s, SLOW)
        assert mission.ending is None


def test_a_slow_link_does_not_replace_the_end_of_a_run() -> None:
    mission = settling()
    mission.request_end(BROKEN, 0.5)
    for now_s in (1.0, 2.0, 9.0):
        at(mission, now_s, SLOW)
    assert phase(mission) is Phase.DONE
    assert ending(mission).reason.startswith("broken")


def test_a_robot_in_motion_halts_at_once_if_the_link_becomes_slow() -> None:
    mission = driving()
    mission.link = UNMEASURED
    assert mission.step(seen(3.0), None, 3.0) == HALT
    assert ending(mission).reason == "not measured"
    assert mission.drive_ended_s == 3.0


def test_without_a_status_the_reason_is_the_link_if_it_allows_no_motion() -> None:
    mission = ready()
    at(mission, 0.0, UNMEASURED)
    at(mission, DATA_TIMEOUT_S + 0.01, UNMEASURED)
    assert ending(mission).reason == "not measured"


@pytest.mark.parametrize(
    ("link", "observed", "stale", "reason"),
    [
        (UNMEASURED, True, None, "not measured"),
        (UNMEASURED, False, None, "no range data from the device"),
        (UNMEASURED, True, "fresh IMU", "no fresh IMU data from the device"),
        (None, False, None, "no range data from the device"),
        (None, True, "IMU", "no IMU data from the device"),
    ],
)
def test_what_is_missing_after_the_standstill_is_the_reason(
    link: LinkTrouble | None, stale: str | None, reason: str, *, observed: bool
) -> None:
    mission = settling()
    mission.link = link
    due_s = 0.3 + AT_REST_S
    for now_s in (due_s, due_s + DATA_TIMEOUT_S - 0.01, due_s + DATA_TIMEOUT_S + 0.01):
        assert mission.ending is None
        assert mission.step(seen(now_s) if observed else None, stale, now_s) == HALT
    assert ending(mission).reason == reason
    assert ending(mission).exit_status == 5


# ---- the stop at the end ---------------------------------------------------------------------


def test_a_stop_of_another_program_does_not_finish_a_drive() -> None:
    mission = driving()
    mission.on_command(Outcome(Stop(3, StopCause.OPERATOR), accepted=True, reason=None), 3.0)
    assert phase(mission) is Phase.DRIVING
    assert mission.confirmed == StopCause.OPERATOR


def test_a_rejected_stop_is_not_confirmed() -> None:
    mission = driving()
    mission.request_end(COMPLETE, 3.0)
    mission.on_command(Outcome(Stop(3, COMPLETE.cause), accepted=False, reason=None), 3.1)
    assert phase(mission) is Phase.DONE
    assert ending(mission).reason == "swept; the device did not confirm the stop"
    assert (ending(mission).outcome, ending(mission).exit_status) == ("fault", 3)


def test_the_same_stop_is_not_requested_twice() -> None:
    mission = driving()
    mission.request_end(COMPLETE, 3.0)
    device = Ending("stopped", "latched", 5, latched=StopCause.OPERATOR)
    mission.request_end(device, 3.1)
    assert ending(mission) is device
    assert mission.requests() == [Request("stop", StopCause.SESSION_END)]


def test_an_unconfirmed_stop_before_the_first_move_is_a_fault_too() -> None:
    """The motors may be enabled. After a new session, an old status says nothing."""
    mission = planned()
    mission.on_ready(0.0)
    mission.on_status(status(StopCause.SESSION_END), 0.1)
    mission.on_ready(0.2)
    mission.ending = None
    mission.request_end(COMPLETE, 0.3)
    mission.step(None, None, 0.3 + END_TIMEOUT_S + 0.01)
    assert (ending(mission).outcome, ending(mission).exit_status) == ("fault", 3)


def test_an_unconfirmed_end_of_monitoring_is_no_fault() -> None:
    mission = Mission(None)
    mission.on_ready(0.0)
    mission.request_end(COMPLETE, 0.1)
    mission.step(None, None, 0.1 + END_TIMEOUT_S + 0.01)
    assert phase(mission) is Phase.DONE
    assert (ending(mission).outcome, ending(mission).exit_status) == ("complete", 0)


@pytest.mark.parametrize(
    ("reason", "remedy"),
    [(NackReason.NOT_AUTHENTICATED, Remedy.KEY), (NackReason.STOP_LATCHED, None)],
)
def test_a_rejected_mode_names_the_remedy(reason: NackReason, remedy: Remedy | None) -> None:
    mission = ready()
    mission.on_status(status(), 0.1)
    mission.on_command(Outcome(SetMode(2, 1), accepted=False, reason=reason), 0.2)
    assert ending(mission).remedy is remedy


# ---- an end that the device cannot confirm ---------------------------------------------------


def test_an_end_without_a_device_is_unconfirmed_and_final() -> None:
    mission = driving()
    mission.end_unconfirmed(BROKEN, 4.0)
    assert phase(mission) is Phase.DONE
    assert ending(mission).reason == "broken; the device did not confirm the stop"
    assert mission.drive_ended_s == 4.0
    mission.request_end(Ending("stopped", "later", 5, StopCause.OPERATOR), 4.1)
    assert ending(mission).reason.startswith("broken"), "there is no device that could stop"
    assert mission.requests() == []


def test_an_end_without_a_device_leaves_a_finished_run_finished() -> None:
    mission = driving()
    mission.request_end(COMPLETE, 3.0)
    mission.on_command(Outcome(Stop(3, COMPLETE.cause), accepted=True, reason=None), 3.1)
    mission.end_unconfirmed(BROKEN, 4.0)
    assert (phase(mission), mission.drive_ended_s) == (Phase.DONE, 3.0)


@pytest.mark.parametrize("runs", [False, True])
def test_without_motion_there_is_no_stop_to_confirm(*, runs: bool) -> None:
    """A run without a session, and a session without a run."""
    mission = planned() if runs else Mission(None)
    if not runs:
        mission.on_ready(0.0)
    mission.end_unconfirmed(BROKEN, 1.0)
    assert ending(mission) == BROKEN
    assert phase(mission) is Phase.DONE


# ---- a failed loop ---------------------------------------------------------------------------


def test_a_failed_loop_ends_the_drive_with_what_it_has_confirmed() -> None:
    mission = driving()
    mission.crashed(BROKEN, StopCause.SUPERVISE, 7.0)
    assert (mission.ending, mission.phase) == (BROKEN, Phase.DONE)
    assert (mission.drive_ended_s, mission.confirmed) == (7.0, StopCause.SUPERVISE)


def test_a_failed_loop_changes_neither_an_ended_drive_nor_a_higher_confirmation() -> None:
    mission = driving()
    mission.request_end(COMPLETE, 3.0)
    mission.on_command(Outcome(Stop(3, StopCause.OPERATOR), accepted=True, reason=None), 3.1)
    mission.crashed(BROKEN, StopCause.SESSION_END, 7.0)
    assert (mission.drive_ended_s, mission.confirmed) == (3.0, StopCause.OPERATOR)
    idle = ready()
    idle.crashed(BROKEN, StopCause.NONE, 7.0)
    assert idle.drive_ended_s is None


# ---- times -----------------------------------------------------------------------------------


def test_a_run_is_under_way_until_it_is_done() -> None:
    assert not settling().under_way
    mission = driving()
    assert mission.under_way
    mission.end_unconfirmed(BROKEN, 4.0)
    assert not mission.under_way


def test_a_run_with_a_lost_device_ends_thirty_seconds_later() -> None:
    mission = driving()
    assert mission.ends_s is None
    mission.on_lost(4.0)
    assert mission.ends_s == 34.0
