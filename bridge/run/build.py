"""Puts a run together, live or virtual: what drives, the host, and its supervision."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.run.host import Host
from bridge.run.mission import Mission, Resume
from bridge.run.onboard_mission import OnboardMission
from bridge.supervise import Supervisor

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.motion.robot_model import RobotModel
    from bridge.record.sink import Sink
    from bridge.run.options import HostOptions
    from bridge.run.runner import Runner
    from bridge.supervise import SuperviseSettings
    from protocol.values import OnboardPlanner


def build_run(  # noqa: PLR0913 - what a run can be asked for
    model: RobotModel,
    sink: Sink,
    options: HostOptions,
    new_session_id: Callable[[], int],
    *,
    runner: Runner | None = None,
    onboard: OnboardPlanner | None = None,
    supervise: SuperviseSettings | None = None,
    clear_stop: bool = False,
    max_time_s: float | None = None,
    resume: Resume = Resume.NEVER,
) -> Host:
    """Make the host of a run.

    Args:
        model: The robot.
        sink: Takes every record of the run.
        options: Clock, port and device.
        new_session_id: Gives a random number that is not 0, for each session.
        runner: Drives the robot from the host; None: nothing on the host does.
        onboard: The device's planner, which drives instead.
        supervise: Rules for a run that moves; None: it is not supervised.
        clear_stop: A stop of any cause may be cleared when the run begins.
        max_time_s: The drive ends with outcome ``timeout`` after this time.
        resume: What becomes of the run after the device was lost.

    """
    mission = (
        Mission(runner, clear_stop=clear_stop, max_time_s=max_time_s, resume=resume)
        if onboard is None
        else OnboardMission(onboard, clear_stop=clear_stop, max_time_s=max_time_s)
    )
    mission.signed = options.key is not None
    host = Host(model, sink, options, mission, new_session_id)
    if supervise is not None and mission.runner is not None:
        host.supervise(Supervisor(model, supervise))
    return host
