"""Detection of a file's kind by its first bytes."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from bridge.files import open_to_read
from bridge.record.errors import LogReadError
from bridge.record.mcap_file import MAGIC

if TYPE_CHECKING:
    from pathlib import Path

CANDUMP, RAW, MCAP = "candump", "raw", "mcap"
_SNIFFED = 1 << 16
"""Number of bytes that are read for the detection."""
_LINE = 512
"""Maximum length of the first line, bytes."""
LOG_LINE = re.compile(
    rb"\((\d{1,10})\.(\d{1,9})\)\s+\S+\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?:(R)[0-9A-Fa-f]?)?"
    rb"((?:[0-9A-Fa-f]{2})*)(?:_[0-9A-Fa-f])?(?=\s|$)"
)
"""Pattern of a line of ``candump -l`` and ``-L``."""
SHOWN_LINE = re.compile(
    rb"\((\d{1,10})\.(\d{1,9})\)\s+\S+\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+(?:[RT]X\s+\S*\s+)?"
    rb"\[\d+\]\s*(remote)?\s*((?:[0-9A-Fa-f]{2} ?)*)"
)
"""Pattern of a line of ``candump -ta``."""


def kind_of(path: Path) -> str:
    """Return the kind of a file: ``mcap``, ``candump`` or ``raw``.

    Raises:
        LogReadError: the file cannot be read.

    """
    try:
        with open_to_read(path) as file:
            begin = file.read(_SNIFFED)
    except OSError as error:
        raise LogReadError(path, error.strerror or str(error)) from None
    if begin.startswith(MAGIC[:5]):
        return MCAP
    first = begin.lstrip().split(b"\n", 1)[0][:_LINE]
    return CANDUMP if LOG_LINE.match(first) or SHOWN_LINE.match(first) else RAW
