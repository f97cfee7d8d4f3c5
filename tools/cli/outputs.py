"""Checks of a command's output files, before it does any work."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tools.cli.paths import is_file

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

PNG, PAGE, RERUN, LOG = (".png",), (".html", ".htm"), (".rrd",), (".mcap",)
TOML, JSON = (".toml",), (".json",)
"""Suffixes of the formats that the commands write."""
_FORMATS = frozenset(
    (
        *(*PNG, *PAGE, *RERUN, *LOG, ".jpg", ".jpeg", ".gif", ".svg", ".webp", ".bmp", ".tif"),
        *(".tiff", ".pdf", ".ps", ".eps", ".csv", ".parquet", ".json", ".toml", ".txt", ".md"),
        *(".bag", ".db3", ".xlsx", ".docx", ".zip", ".gz", ".zst", ".mp4", ".log"),
    )
)
"""Suffixes that name a format. Any other suffix is part of the name, as in ``run-1.5``."""


def check_format(option: str, path: Path | None, *endings: str) -> None:
    """Reject a file name with the suffix of another format.

    Raises:
        click.UsageError: the suffix names another format.

    """
    if path is None:
        return
    ending = path.suffix.lower()
    if ending in _FORMATS and ending not in endings:
        wanted = " or ".join(endings)
        raise click.UsageError(f"{option} {path}: the format is {wanted}, not {ending}")


def check_outputs(
    wanted: Iterable[Path | None], sources: Iterable[Path], *, force: bool = False
) -> None:
    """Check that no output replaces an existing file, an input or another output.

    /dev/null is always allowed.

    Raises:
        click.UsageError: two outputs have the same name.
        LogWriteError: an output is one of ``sources``, even with ``force``.
        LogWriteError: access to the folder is denied, or an output is a pipe, socket or device.
        OutputExistsError: an output exists and ``force`` is not set.

    """
    from bridge.errors import OutputExistsError
    from bridge.files import check_target
    from bridge.record.errors import LogWriteError

    given = [path for path in wanted if path is not None]
    whole = [_resolved(path) for path in given]
    if len(set(whole)) < len(whole):
        raise click.UsageError("two outputs have the same name: give each its own")
    read = {_resolved(path) for path in sources}
    for path, resolved in zip(given, whole, strict=True):
        if resolved in read:
            raise LogWriteError(path, "it is also the input; give another name")
        try:
            check_target(path)
            is_there = is_file(path)
        except OSError as error:  # such as a name that is too long, or access denied
            raise LogWriteError.of(path, error) from None
        if is_there and not force:
            raise OutputExistsError(path)


def _resolved(path: Path) -> Path:
    """Return the absolute path; if it cannot be resolved, the path as given."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # no working directory; symbolic links in a loop
        return path
