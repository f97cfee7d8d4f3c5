"""Two flash pages for the parameters; a loss of supply at any time leaves one page valid.

A save erases the older page and writes the new image there, with the checksum last. Until the last
byte is written, a boot uses the other page. An STM32F429 has two flash banks, so the program can
run during the save (RM0090, section 3: read while write).
"""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING
from zlib import crc32

if TYPE_CHECKING:
    from collections.abc import Mapping

_HEAD = struct.Struct("<IH")
"""Layout of a page's header: number of the save, length of the image."""
_CHECK = struct.Struct("<I")
_SPAN, _HALF = 1 << 32, 1 << 31
ERASE_MS = 250
"""Time to erase a 16 KiB sector, ms: typical value for 32-bit parallelism (STM32F429 data sheet,
flash programming)."""
BYTES_PER_MS = 250
"""Programming speed, bytes/ms: a word of four bytes takes 16 µs (STM32F429 data sheet, flash
programming)."""


class Flash:
    """Both pages as bytes; tests may read and damage ``pages``."""

    def __init__(self) -> None:
        """Start with erased pages, as from the factory."""
        self.pages = [b"", b""]
        self.key: bytes | None = None
        """Key that authenticates motion, in a separate page; None: no key."""
        self.worn = False
        """True: the flash is worn out and does not store written data."""
        self._job: bytes | None = None
        self._written = b""
        self._page = 0
        self._erase_ms = 0
        self._done = 0

    def load(self) -> dict[str, int]:
        """Return the newest complete image; empty if no page is complete."""
        newest = self._newest()
        return {} if newest is None else _read(self.pages[newest])[1]  # type: ignore[index]  # whole

    def erase(self) -> None:
        """Erase everything, and abort a save."""
        self.pages = [b"", b""]
        self.key = None
        self._job = None

    @property
    def busy(self) -> bool:
        """True while a save is in progress."""
        return self._job is not None

    def begin(self, image: Mapping[str, int]) -> None:
        """Start a save; :meth:`advance` continues it."""
        newest = self._newest()
        number = 0 if newest is None else _number(self.pages[newest]) + 1
        self._page = 0 if newest is None else 1 - newest
        content = json.dumps(dict(image), separators=(",", ":")).encode()
        record = _HEAD.pack(number % _SPAN, len(content)) + content
        self._job = self._written = record + _CHECK.pack(crc32(record))
        self._erase_ms, self._done = ERASE_MS, 0
        self.pages[self._page] = b""

    def advance(self, ms: int) -> bool:
        """Erase and write for ``ms``; return True when the save is complete."""
        if self._job is None:
            return False
        erased_ms = min(ms, self._erase_ms)
        self._erase_ms -= erased_ms
        self._done += (ms - erased_ms) * BYTES_PER_MS
        self.pages[self._page] = b"" if self.worn else self._job[: self._done]
        if self._done < len(self._job):
            return False
        self._job = None
        return True

    def reads_back(self) -> bool:
        """Return whether the page contains the last written image."""
        return self.pages[self._page] == self._written

    def power_lost(self) -> None:
        """Abort a save at a reset or a loss of supply; the page stays incomplete."""
        self._job = None

    def _newest(self) -> int | None:
        whole = [page for page in (0, 1) if _read(self.pages[page]) is not None]
        if len(whole) < len(self.pages):
            return whole[0] if whole else None
        ahead = (_number(self.pages[1]) - _number(self.pages[0])) % _SPAN
        return 1 if 0 < ahead < _HALF else 0


def _number(page: bytes) -> int:
    number: int = _HEAD.unpack_from(page)[0]
    return number


def _read(page: bytes) -> tuple[int, dict[str, int]] | None:
    """Return save number and image of a page; None if the page is incomplete."""
    if len(page) < _HEAD.size + _CHECK.size:
        return None
    number, length = _HEAD.unpack_from(page)
    end = _HEAD.size + length
    if len(page) != end + _CHECK.size or _CHECK.unpack_from(page, end)[0] != crc32(page[:end]):
        return None
    return number, json.loads(page[_HEAD.size : end])
