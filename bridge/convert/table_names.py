"""File names for topics: short, unique and safe on every file system."""

from __future__ import annotations

import re
import unicodedata
from typing import TYPE_CHECKING
from zlib import crc32

if TYPE_CHECKING:
    from collections.abc import Iterable

_LONGEST = 180
"""Maximum length of a table's name without its suffix, bytes. File systems allow 255 bytes. Some
encrypted file systems allow only 143 bytes because of their overhead."""
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\.|$)", re.IGNORECASE)
"""Names that Windows reserves for devices, with any suffix."""


def table_names(topics: Iterable[str]) -> dict[str, str]:
    """Return a name without suffix for each topic; the same topics always get the same names."""
    names: dict[str, str] = {}
    used: set[str] = set()
    for topic in sorted(topics):
        stem = name = _name(topic)
        number = 2
        while _folded(name) in used:  # topics differ only in special characters or case
            name = f"{stem}-{number}"
            number += 1
        used.add(_folded(name))
        names[topic] = name
    return names


def _name(topic: str) -> str:
    text = unicodedata.normalize("NFC", topic).strip("/").replace("/", ".")
    name = re.sub(r"[^\w.-]", "_", text).strip(".").lstrip("-") or "topic"
    if _RESERVED.match(name):
        name = f"_{name}"
    if len(name.encode()) > _LONGEST:
        mark = f"~{crc32(topic.encode()):08x}"
        name = name.encode()[: _LONGEST - len(mark)].decode("utf-8", "ignore") + mark
    return name


def _folded(name: str) -> str:
    """Return the form of a name that case-insensitive file systems compare."""
    return unicodedata.normalize("NFKC", name).casefold()
