"""End of a run: outcome, reason, exit status and latched stop."""

from __future__ import annotations

import traceback
from dataclasses import dataclass

from bridge.errors import (
    BridgeError,
    CommandRejectedError,
    DeviceLostError,
    ExitStatus,
    Remedy,
    StoppedForSafetyError,
)
from protocol.messages.values import StopCause


@dataclass(frozen=True, slots=True)
class Ending:
    """Result of a run."""

    outcome: str
    """``complete``, ``timeout``, ``stopped`` or ``fault``."""
    reason: str
    exit_status: int
    cause: StopCause = StopCause.SESSION_END
    """Stop cause that the host latches on the device at the end."""
    latched: StopCause = StopCause.NONE
    """Stop cause that the device latched itself, if this stop ended the run."""
    remedy: Remedy | None = None
    """Remedy for the user, if any."""

    @property
    def gravity(self) -> StopCause:
        """The higher of the host's and the device's stop cause."""
        return max(self.cause, self.latched)

    def outranks(self, other: Ending | None) -> bool:
        """Return True if this end replaces ``other``, which occurred at the same time.

        The host uses the same order of causes as the device
        (:func:`protocol.messages.values.by_severity`). If both causes are equal, the first end
        stays.
        """
        return other is None or self.gravity > other.gravity


def cannot_move(ending: Ending | None) -> BridgeError:
    """Return the error for a velocity command after the run's end; None: no run was started."""
    if ending is None:
        return StoppedForSafetyError("the robot is not enabled: call enable() first")
    error: BridgeError = StoppedForSafetyError(ending.reason)
    if ending.exit_status == ExitStatus.NO_DEVICE:
        error = DeviceLostError(ending.reason)
    elif ending.exit_status == ExitStatus.REJECTED:
        error = CommandRejectedError("to move", ending.reason)
    error.remedy = ending.remedy
    return error


CRASH_CAUSE = StopCause.SUPERVISE
"""Stop cause that a failed loop latches: an operator must check the robot before it moves again."""


def crash_ending(error: BaseException, cause: StopCause, confirmed: StopCause | None) -> Ending:
    """Return the end of a run after its loop failed; ``confirmed`` is None without a device."""
    if confirmed is None:
        how = "no device was connected"
    elif confirmed < cause:
        how = "the device did not confirm the stop; check that the robot stands still"
    else:
        how = "the device has confirmed the stop"
    return Ending(
        "fault", f"the run's loop failed ({described(error)}); {how}", ExitStatus.FAILURE, cause
    )


def described(error: BaseException) -> str:
    """Return an exception as one line: its class, the first line of its text, and its notes."""
    lines = str(error).splitlines()
    text = f": {lines[0][:200]}" if lines else ""
    notes = "".join(f"; {note}" for note in getattr(error, "__notes__", ()))
    return f"{type(error).__name__}{text}{notes}"


def traced(error: BaseException) -> str:
    """Return the traceback as text, for the log."""
    return "".join(traceback.format_exception(error))
