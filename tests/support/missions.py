"""Missions with a planner that turns in place, at the beginning of their phases."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict, Unpack

from bridge.coverage.runner import PlanRunner
from bridge.motion.robot_model import RobotModel
from bridge.run.mission import Mission, Phase, Resume
from protocol.messages.device import Status
from protocol.messages.host import ClearStop, SetMode, Stop
from protocol.messages.values import StopCause
from protocol.retransmission import Outcome
from support.ends import Spinning
from support.observed import AT_REST

if TYPE_CHECKING:
    from bridge.motion.observation import Observation
    from bridge.run.ending import Ending

MODEL = RobotModel()
CLEARED = Outcome(ClearStop(1, 1), accepted=True, reason=None)
ENABLED = Outcome(SetMode(2, 1), accepted=True, reason=None)
STOPPED = Outcome(Stop(3, 1), accepted=True, reason=None)


class MissionOptions(TypedDict, total=False):
    """Options of :class:`Mission`, by name."""

    clear_stop: bool
    max_time_s: float | None
    at_rest_s: float
    resume: Resume


def planned(**options: Unpack[MissionOptions]) -> Mission:
    """Return a mission that waits for its session."""
    return Mission(PlanRunner(Spinning(MODEL), MODEL), **options)


def settling(**options: Unpack[MissionOptions]) -> Mission:
    """Return a mission that has stood still since 0.3 s, before its first move."""
    mission = planned(**options)
    mission.on_ready(0.0)
    mission.on_status(status(StopCause.SESSION_END), 0.1)
    mission.on_command(CLEARED, 0.2)
    mission.on_command(ENABLED, 0.3)
    mission.on_status(status(), 0.3)
    assert phase(mission) is Phase.SETTLING
    mission.requests()
    return mission


def driving(**options: Unpack[MissionOptions]) -> Mission:
    """Return a mission that has been driving since 3 s."""
    mission = settling(**options)
    mission.step(seen(3.0), None, 3.0)
    assert phase(mission) is Phase.DRIVING
    return mission


def phase(mission: Mission) -> Phase:
    """Return the phase. The call hides from the type checker that it cannot change."""
    return mission.phase


def ending(mission: Mission) -> Ending:
    """Return the ending of a mission that ends."""
    assert mission.ending is not None
    return mission.ending


def stop_confirmed(mission: Mission) -> bool:
    """Return True if the device has confirmed the stop of the highest cause."""
    return mission.ending is not None and mission.confirmed >= mission.stop_cause


def status(cause: int = 0) -> Status:
    """Return a status with a stop cause."""
    return Status(0, cause, 0, 0, 0)


def seen(now_s: float) -> Observation:
    """Return an observation of a robot at rest."""
    return AT_REST._replace(time_s=now_s)
