"""How a worker process ends on SIGTERM: in the middle of a trial, never of telling its result.

A process that dies while it writes to the pool's pipe leaves the reader waiting for the rest for
ever, and the whole command with it. In a trial it writes nothing there, and leaves at once: an
exception from the signal's handler could come anywhere, also while an extension is loaded. One
that tells a result, or waits for a trial, has a grace to be done with it.
"""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING, Any

from tools.cli.signals import let_come
from tools.experiment.worker import run_trial

if TYPE_CHECKING:
    from types import FrameType

    from tools.experiment.trials import Trial

GRACE_S = 5.0
"""Enough to tell a result, and for the pool to say that there are no more trials."""


class EndedEarlyError(Exception):
    """The trial was not begun."""


class Ending:
    """What the signal's handler and the trial know of each other."""

    asked = False
    busy = False


def prepare_worker() -> None:
    """Leave Ctrl-C and a lost terminal to the parent; SIGTERM ends the trial under way."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _on_sigterm)
    let_come()


def _on_sigterm(_number: int, _frame: FrameType | None) -> None:
    if Ending.busy:
        os._exit(1)
    Ending.asked = True
    if hasattr(signal, "setitimer"):  # not on Windows, where SIGTERM is not caught either
        signal.setitimer(signal.ITIMER_REAL, GRACE_S)


def run_until_ended(trial: Trial) -> dict[str, Any]:
    """Run a trial.

    Raises:
        EndedEarlyError: SIGTERM came before.

    """
    Ending.busy = True
    try:
        if Ending.asked:
            raise EndedEarlyError
        return run_trial(trial)
    finally:
        Ending.busy = False
