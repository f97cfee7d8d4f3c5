"""How a run ends: outcome, reason, exit status and the stop that is latched for it."""

from __future__ import annotations

import traceback
from dataclasses import dataclass

from bridge.errors import (
    BridgeError,
    CommandRejectedError,
    DeviceLostError,
    Remedy,
    StoppedForSafetyError,
)
from protocol.values import StopCause


@dataclass(frozen=True, slots=True)
class Ending:
    """How a run ended."""

    outcome: str
    """``complete``, ``timeout``, ``stopped`` or ``fault``."""
    reason: str
    exit_status: int
    cause: StopCause = StopCause.SESSION_END
    """What is latched on the device for it."""
    latched: StopCause = StopCause.NONE
    """What the device has latched by itself, where that ended the run."""
    remedy: Remedy | None = None
    """What the caller can do, where something can be done."""

    @property
    def gravity(self) -> StopCause:
        """The cause by which this end is judged: the graver of the host's and the device's."""
        return max(self.cause, self.latched)

    def outranks(self, other: Ending | None) -> bool:
        """Whether this end takes the place of another one that it coincides with.

        The order of gravity is the protocol's (:func:`protocol.values.by_gravity`), here as on
        the device. Of two causes of equal gravity the first one stays.
        """
        return other is None or self.gravity > other.gravity


def cannot_move(ending: Ending | None) -> BridgeError:
    """Why a robot does not obey a velocity: how its run has ended; None: none was begun."""
    if ending is None:
        return StoppedForSafetyError("the robot is not enabled: call enable() first")
    error: BridgeError = StoppedForSafetyError(ending.reason)
    if ending.exit_status == 3:  # noqa: PLR2004 - the contract's status for a lost device
        error = DeviceLostError(ending.reason)
    elif ending.exit_status == 4:  # noqa: PLR2004 - the contract's status for a refusal
        error = CommandRejectedError("to move", ending.reason)
    error.remedy = ending.remedy
    return error


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
