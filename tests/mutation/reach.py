"""Finds the lines of a module that run during its import, and in each test."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextmanager
def lines_run(path: Path) -> Iterator[set[int]]:
    """Collect the lines of one file that run within the context."""
    name = str(path)
    lines: set[int] = set()

    def within(frame: Any, event: str, _argument: object) -> Any:
        if event == "line":
            lines.add(frame.f_lineno)
        return within

    def called(frame: Any, _event: str, _argument: object) -> Any:
        if frame.f_code.co_filename != name:
            return None
        lines.add(frame.f_lineno)
        return within

    before = sys.gettrace()
    sys.settrace(called)
    try:
        yield lines
    finally:
        sys.settrace(before)
