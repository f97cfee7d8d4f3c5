"""The names ``latest`` and ``latest~N`` of runs."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.library.errors import NoRunError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

DEFAULT_FOLDER = Path("runs")
"""Folder of the default logs."""
_LATEST = re.compile(r"latest(?:~(\d{1,9}))?")


def resolve_latest(path: Path, runs_of: Callable[[Path], Sequence[Path]]) -> Path:
    """Return the log for a path. ``latest`` is the newest run, ``latest~N`` the N-th run before it.

    Without a folder, these names refer to :data:`DEFAULT_FOLDER`. If a file with such a name
    exists, the file is used.

    Args:
        path: A path of a log, or such a name, with or without a folder.
        runs_of: Returns the logs of the runs in a folder, the newest last.

    Raises:
        NoRunError: there is no such run.

    """
    named = _LATEST.fullmatch(path.name)
    if named is None or os.path.lexists(path):
        return path
    back = int(named[1] or 0)
    folder = DEFAULT_FOLDER if path.parent == Path() and path.name == str(path) else path.parent
    runs = runs_of(folder)
    if back >= len(runs):
        count = f"it has {len(runs)} run{'' if len(runs) == 1 else 's'}"
        raise NoRunError(f"no run {path.name} in {folder}: {count}")
    return runs[-1 - back]
