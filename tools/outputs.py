"""Files that a command is asked to write, looked at before any work is done."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


def check_outputs(
    wanted: Iterable[Path | None], sources: Iterable[Path], *, force: bool = False
) -> None:
    """Refuse to write over what exists, over a log that is read, or twice into one file.

    A device holds nothing to lose.

    Raises:
        click.UsageError: two outputs have one name.
        LogWriteError: an output is one of ``sources``, whatever ``force`` is.
        LogExistsError: it exists and ``force`` is not set.

    """
    from bridge.record.errors import LogExistsError, LogWriteError

    given = [path for path in wanted if path is not None]
    if len({path.resolve() for path in given}) < len(given):
        raise click.UsageError("give each file to write a name of its own")
    read = {path.resolve() for path in sources}
    for path in given:
        if path.resolve() in read:
            raise LogWriteError(path, "it is the file to read; give another name")
        if path.is_file() and not force:
            raise LogExistsError(path)
