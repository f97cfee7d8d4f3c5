"""Text of an exception that a driver raises."""

from __future__ import annotations


def reason(error: BaseException) -> str:
    """Return the first line of an error's text, or the name of its class."""
    strerror = getattr(error, "strerror", None)
    return str(strerror or error).strip().splitlines()[0] if str(error) else type(error).__name__
