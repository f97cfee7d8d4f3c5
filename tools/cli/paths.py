"""Paths from the command line: their parameter type, and tests that never raise."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Any

import click


class PathName(click.Path):
    """Parameter type: a path. An empty text is rejected, because it means the folder itself."""

    def __init__(
        self, *, exists: bool = False, file_okay: bool = True, dir_okay: bool = True
    ) -> None:
        super().__init__(exists=exists, file_okay=file_okay, dir_okay=dir_okay, path_type=Path)

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Any:  # noqa: ANN401 - click's interface
        """Convert the text to a path."""
        if not str(value):
            self.fail("the name is empty: give a path.", param, ctx)
        path: Any = super().convert(value, param, ctx)
        if not self.file_okay and is_there(path) and not is_folder(path):  # such as a device
            self.fail(f"{str(path)!r} is not a folder.", param, ctx)
        return path


def is_there(path: Path) -> bool:
    """Return whether the path exists; False also if it cannot be accessed."""
    return _mode(path) is not None


def is_file(path: Path) -> bool:
    """Return whether the path is a regular file."""
    mode = _mode(path)
    return mode is not None and stat.S_ISREG(mode)


def is_folder(path: Path) -> bool:
    """Return whether the path is a folder."""
    mode = _mode(path)
    return mode is not None and stat.S_ISDIR(mode)


def _mode(path: Path) -> int | None:
    try:
        return path.stat().st_mode
    except (OSError, ValueError):  # ValueError: the path contains a zero byte
        return None
