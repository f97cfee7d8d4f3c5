"""How a run ends whose loop has failed: an exception that nobody has foreseen, for people."""

from __future__ import annotations

import traceback

from bridge.run.mission import Ending
from protocol.values import StopCause

CRASH_CAUSE = StopCause.SUPERVISE
"""What a loop that has failed latches: a person looks before the robot moves again."""


def crash_ending(error: BaseException, cause: StopCause, confirmed: StopCause | None) -> Ending:
    """The end of such a run, as a fault; ``confirmed`` is None where there was no device."""
    if confirmed is None:
        how = "no device was connected"
    elif confirmed < cause:
        how = "the device did not confirm the stop; see that the robot stands"
    else:
        how = "the device has confirmed the stop"
    return Ending("fault", f"the run's loop failed ({described(error)}); {how}", 1, cause)


def described(error: BaseException) -> str:
    """An exception in one line: its kind and the first line of its text."""
    lines = str(error).splitlines()
    text = f": {lines[0][:200]}" if lines else ""
    return f"{type(error).__name__}{text}"


def traced(error: BaseException) -> str:
    """Its traceback, for the log."""
    return "".join(traceback.format_exception(error))
