"""How the command line says what can be done about an error."""

from __future__ import annotations

from bridge.errors import Remedy

_WORDS = {
    Remedy.CLEAR_STOP: ", then add --clear-stop",
    Remedy.KEY: ": give it with --key-file",
    Remedy.NODE: "; choose one with --node N",
    Remedy.FORCE: ", or --force to replace it",
}


def with_remedy(text: str, remedy: Remedy | None) -> str:
    """The text and what to type."""
    return text if remedy is None else text + _WORDS[remedy]


def error_line(error: Exception) -> str:
    """What is wrong and what to type, in one line."""
    from bridge.errors import BridgeError

    if isinstance(error, BridgeError):
        return with_remedy(error.bare, error.remedy)
    return str(error)
