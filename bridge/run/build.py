"""Construction of a run, live or simulated: mission, host and supervision."""

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
    from protocol.messages.values import OnboardPlanner


def build_run(  # noqa: PLR0913 - the options of a run
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
    """Create the host of a run.

    Args:
        model: The robot.
        sink: Receives every record of the run.
        options: Clock, port and device.
        new_session_id: Returns a random 32-bit number other than 0 for each session.
        runner: Drives the robot from the host; None: the host does not drive.
        onboard: The device's planner that drives instead.
        supervise: Rules for a run with motion; None: no supervision.
        clear_stop: Clear a latched stop of any cause at the start of the run.
        max_time_s: Maximum time of the drive, s; the run then ends with outcome ``timeout``.
        resume: Continuation of the run after a loss of the device; ignored with ``onboard``.

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
