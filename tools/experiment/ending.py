"""How a worker process ends on SIGTERM: in the middle of a trial, never of telling its result.

A process that dies while it writes to the pool's pipe leaves the reader waiting for the rest for
ever, and the whole command with it at its exit.
"""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING, Any

from tools.experiment.worker import run_trial

if TYPE_CHECKING:
    from types import FrameType

    from tools.experiment.trials import Trial


class EndedEarlyError(Exception):
    """The trial was broken off."""


class Ending:
    """What the signal's handler and the trial know of each other."""

    asked = False
    busy = False


def prepare_worker() -> None:
    """Leave Ctrl-C to the parent, and take SIGTERM as the end of the trial under way."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _on_sigterm)


def _on_sigterm(_number: int, _frame: FrameType | None) -> None:
    Ending.asked = True
    if Ending.busy:
        raise EndedEarlyError


def run_until_ended(trial: Trial) -> dict[str, Any]:
    """Run a trial.

    Raises:
        EndedEarlyError: SIGTERM came, now or before.

    """
    Ending.busy = True
    try:
        if Ending.asked:
            raise EndedEarlyError
        return run_trial(trial)
    finally:
        Ending.busy = False
