"""Access to a log from any supported file. A capture is converted to a log."""

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
    """Yield an MCAP file: the file itself, or a temporary conversion of a capture.

    Raises:
        LogReadError: the file cannot be read, or has no frame of a device.

    """
    if kind_of(path) == MCAP:
        yield path
        return
    from bridge.convert.captures import convert  # noqa: PLC0415 - slow to import

    with tempfile.TemporaryDirectory(prefix="sweepctl-capture-") as folder:
        made = Path(folder) / f"{path.stem}.mcap"
        convert(path, made)
        yield made


def describe_any(path: Path) -> RunDescription:
    """Return the statistics of a log or capture.

    Raises:
        LogReadError: the file is missing, cannot be read, or has no frame of a device.

    """
    kind = kind_of(path)
    with readable(path) as log:
        description = describe(log)
    if kind != MCAP:
        description.path, description.format = path, kind
        description.file_bytes = path.stat().st_size
    return description
