"""A log to read a named file by: itself, or one made from a capture."""

from __future__ import annotations

import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.convert.file_kinds import MCAP, kind_of
from bridge.record.info import RunDescription, describe

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def readable(path: Path) -> Iterator[Path]:
    """An MCAP file of what a file holds: itself, or one made from a capture while needed.

    Raises:
        LogReadError: it cannot be read, or holds nothing of a sweeper.

    """
    if kind_of(path) == MCAP:
        yield path
        return
    from bridge.convert.captures import convert  # noqa: PLC0415 - loads a live run's decoding

    with tempfile.TemporaryDirectory(prefix="sweepctl-capture-") as folder:
        made = Path(folder) / f"{path.stem}.mcap"
        convert(path, made)
        yield made


def describe_any(path: Path) -> RunDescription:
    """Read a log or a capture of another program to its end and count.

    Raises:
        LogReadError: the file is missing, cannot be read, or holds nothing of a sweeper.

    """
    kind = kind_of(path)
    with readable(path) as log:
        description = describe(log)
    if kind != MCAP:
        description.path, description.format = path, kind
        description.file_bytes = path.stat().st_size
    return description
