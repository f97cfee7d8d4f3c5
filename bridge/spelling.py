"""Suggestions for misspelt names."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_SHOWN = 40
"""Maximum number of characters of a wrong name that a line shows."""


_LONGEST = 200
"""Maximum number of characters of a name that are compared. Every known name is shorter."""
_CUTOFF = 0.6
"""Minimum share of equal letters (Ratcliff and Obershelp) at which two names are similar."""


def nearest(name: str, known: Iterable[str], cutoff: float = _CUTOFF) -> str | None:
    """Return the known name that is most similar to ``name``, ignoring case; None: no such name."""
    from difflib import get_close_matches  # noqa: PLC0415 - needed only for an error

    lower = {each.lower(): each for each in known if len(each) <= _LONGEST}
    found = get_close_matches(name[:_LONGEST].lower(), lower, 1, cutoff)
    return lower[found[0]] if found else None


def unknown_key(prefix: str, key: str, known: Iterable[str]) -> str:
    """Return the text for an unknown key of a file, with the nearest known key."""
    known = list(known)
    near = nearest(key, known)
    shown = key if len(key) <= _SHOWN else f"{key[:_SHOWN]}…"
    hint = f"did you mean {prefix}{near}?" if near else f"known are {', '.join(sorted(known))}"
    return f"{prefix}{shown}: no such key; {hint}"
