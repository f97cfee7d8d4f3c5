"""Errors as one line, with the option that solves the problem."""

from __future__ import annotations

from bridge.errors import Remedy

_WORDS = {
    Remedy.CLEAR_STOP: ", then add --clear-stop",  # after "look at the robot"
    Remedy.KEY: ": give it with --key-file",
    Remedy.NODE: "; choose one with --node N",
    Remedy.FORCE: ", or --force to replace it",
}


def with_remedy(text: str, remedy: Remedy | None) -> str:
    """Append the option to use to an error's text."""
    return text if remedy is None else text + _WORDS[remedy]


def error_line(error: Exception) -> str:
    """Return an error and the option to use as one line."""
    from bridge.errors import BridgeError

    if isinstance(error, BridgeError):
        return with_remedy(error.bare, error.remedy)
    return str(error)
