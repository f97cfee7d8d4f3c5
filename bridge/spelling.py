"""Names that are not known: the one that was probably meant."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_SHOWN = 40
"""Characters of a wrong name that a line shows."""


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that ``name`` resembles most; None: it resembles none."""
    from difflib import get_close_matches  # noqa: PLC0415 - only where something is wrong

    lower = {each.lower(): each for each in known}
    found = get_close_matches(name[:200].lower(), lower, n=1)
    return lower[found[0]] if found else None


def unknown_key(prefix: str, key: str, known: Iterable[str]) -> str:
    """Text for a key of a file that is not known, with the nearest known one."""
    known = list(known)
    near = nearest(key, known)
    shown = key if len(key) <= _SHOWN else f"{key[:_SHOWN]}…"
    hint = f"did you mean {prefix}{near}?" if near else f"known are {', '.join(sorted(known))}"
    return f"{prefix}{shown}: no such key; {hint}"
