"""A trial for another process, which may be on a machine without the files of the command line."""

from __future__ import annotations

import functools
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bridge.errors import BridgeError
from tools.experiment.ending import run_until_ended
from tools.experiment.store import code_version, planner_version
from tools.experiment.trials import ROBOTS_HERE, ROOMS_HERE, is_file

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel
    from tools.experiment.trials import Trial

_ONE_AT_A_TIME = threading.Lock()
"""Lock that prevents two runs at the same time in one worker with several threads: such runs are
slower, and not tested."""


class WorkerVersionError(BridgeError):
    """A worker has another version of the code, so its results would differ."""


@dataclass(frozen=True, slots=True)
class Shipped:
    """A trial with the content of its files."""

    trial: Trial
    version: str
    """Version of the sender's code."""
    plan: FloorPlan | None
    """The room, if it is a file of the sender."""
    model: RobotModel | None
    """The robot, if it is a file of the sender."""


def shipped(trial: Trial) -> Shipped:
    """Read the files of a trial."""
    plan = trial.plan if is_file(trial.room) else None
    model = trial.model if trial.robot else None
    return Shipped(trial, _version(trial.planner), plan, model)


def run_shipped(each: Shipped) -> dict[str, Any]:
    """Run a trial in the process of a worker.

    Raises:
        WorkerVersionError: this process has another version of the code.

    """
    own = _version(each.trial.planner)
    if own != each.version:
        raise WorkerVersionError(
            f"a worker has version {own}, but this is {each.version}: install the same version "
            "of sweepctl on every machine"
        )
    with _ONE_AT_A_TIME:
        if each.plan is not None:
            ROOMS_HERE[each.trial.room] = each.plan
        if each.model is not None:
            ROBOTS_HERE[each.trial.robot] = each.model
        return run_until_ended(each.trial)


_LOADED = code_version()
"""Version of the code that this process has loaded: a later change of the files has no effect."""


@functools.cache
def _version(planner: str) -> str:
    return f"{_LOADED}{planner_version(planner)}"
