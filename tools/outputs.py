"""Files that a command is asked to write, looked at before any work is done."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

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
        if _is_there(path) and not force:
            raise LogExistsError(path)


def _is_there(path: Path) -> bool:
    """Whether a file is there; a folder or a name that cannot be is told when it is written."""
    try:
        return path.is_file()
    except OSError:
        return False
