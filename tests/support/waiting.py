"""Waiting for a condition that another thread or process fulfils."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE_S = 60.0
"""Maximum time of a step, s; only a hang is longer."""


def until(
    condition: Callable[[], object],
    meanwhile: Callable[[], None] = lambda: None,
    *,
    within_s: float = PATIENCE_S,
    what: str = "the condition is true",
) -> None:
    """Wait until the condition is true; call ``meanwhile`` before each new check."""
    limit_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < limit_s, f"not within {within_s:g} s: {what}"
        meanwhile()
        time.sleep(0.01)
