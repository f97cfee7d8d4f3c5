"""End of a worker process on SIGTERM: at once during a trial, but never while it writes a result.

If a process dies while it writes to the pool's pipe, the reader of the pipe blocks, and with it the
whole command. During a trial a worker does not use the pipe, so it can exit at once. The signal
handler cannot raise an exception instead, because an extension module may be loading. If a worker
writes a result or waits for a trial, it gets a grace period.
"""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING, Any

from tools.cli.signals import unblock_signals
from tools.experiment.worker import run_trial

if TYPE_CHECKING:
    from types import FrameType

    from tools.experiment.trials import Trial

GRACE_S = 5.0
"""Grace period after SIGTERM, s: enough to write a result and to detect that no trial remains."""


class EndedEarlyError(Exception):
    """The trial was not started."""


class EarlyEnd:
    """State that the signal handler and the trial share."""

    asked = False
    """True once SIGTERM has arrived."""
    busy = False
    """True while a trial runs."""


def prepare_worker() -> None:
    """Ignore Ctrl-C and SIGHUP, which the parent handles; let SIGTERM end the current trial."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _on_sigterm)
    unblock_signals()


def _on_sigterm(_number: int, _frame: FrameType | None) -> None:
    if EarlyEnd.busy:
        os._exit(1)
    EarlyEnd.asked = True
    if hasattr(signal, "setitimer"):  # Windows has neither this nor a SIGTERM to catch
        signal.setitimer(signal.ITIMER_REAL, GRACE_S)


def run_until_ended(trial: Trial) -> dict[str, Any]:
    """Run a trial; in a process of the local pool SIGTERM ends it.

    Raises:
        EndedEarlyError: SIGTERM arrived before the trial.

    """
    EarlyEnd.busy = True
    try:
        if EarlyEnd.asked:
            raise EndedEarlyError
        return run_trial(trial)
    finally:
        EarlyEnd.busy = False
