"""Files that a command is asked to write, looked at before any work is done."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tools.cli.paths import is_file

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

PNG, PAGE, RERUN, LOG = (".png",), (".html", ".htm"), (".rrd",), (".mcap",)
"""Endings of what the commands write."""
_FORMATS = frozenset(
    (
        *(*PNG, *PAGE, *RERUN, *LOG, ".jpg", ".jpeg", ".gif", ".svg", ".webp", ".bmp", ".tif"),
        *(".tiff", ".pdf", ".ps", ".eps", ".csv", ".parquet", ".json", ".toml", ".txt", ".md"),
        *(".bag", ".db3", ".xlsx", ".docx", ".zip", ".gz", ".zst", ".mp4", ".log"),
    )
)
"""Endings that name a format. Another one is taken for a part of the name, as in ``run-1.5``."""


def check_format(option: str, path: Path | None, *endings: str) -> None:
    """Refuse a name that says another format than the one that would be written.

    Raises:
        click.UsageError: it does.

    """
    if path is None:
        return
    ending = path.suffix.lower()
    if ending in _FORMATS and ending not in endings:
        wanted = " or ".join(endings)
        raise click.UsageError(f"{option} {path}: it writes {wanted}, not {ending}")


def check_outputs(
    wanted: Iterable[Path | None], sources: Iterable[Path], *, force: bool = False
) -> None:
    """Refuse to write over what exists, over a log that is read, or twice into one file.

    /dev/null holds nothing to lose.

    Raises:
        click.UsageError: two outputs have one name.
        LogWriteError: an output is one of ``sources``, whatever ``force`` is.
        LogWriteError: its folder may not be entered, or it is a pipe, a socket or a device.
        OutputExistsError: it exists and ``force`` is not set.

    """
    from bridge.errors import OutputExistsError
    from bridge.files import check_target
    from bridge.record.errors import LogWriteError

    given = [path for path in wanted if path is not None]
    whole = [_resolved(path) for path in given]
    if len(set(whole)) < len(whole):
        raise click.UsageError("give each file to write a name of its own")
    read = {_resolved(path) for path in sources}
    for path, resolved in zip(given, whole, strict=True):
        if resolved in read:
            raise LogWriteError(path, "it is the file to read; give another name")
        try:
            check_target(path)
            is_there = is_file(path)
        except OSError as error:  # a name too long, a folder that may not be entered
            raise LogWriteError.of(path, error) from None
        if is_there and not force:
            raise OutputExistsError(path)


def _resolved(path: Path) -> Path:
    """Give the whole path; where it cannot be found out, what was given."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # the working directory is gone; links in a circle
        return path
