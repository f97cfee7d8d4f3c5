"""A file of campaign results; each is appended at once, so the campaign can be interrupted."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


class Kept:
    """Result of each named run; it is valid as long as its source files are unchanged."""

    def __init__(self, path: Path | None, sources: Iterable[Path]) -> None:
        """Read the file; without a path nothing is stored."""
        self._path = path
        text = b"".join(source.read_bytes() for source in sorted(sources))
        self._digest = hashlib.sha256(text).hexdigest()[:16]
        self._known: dict[str, Any] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                digest, name, reported = json.loads(line)
                if digest == self._digest:
                    self._known[name] = reported

    def of(self, name: str) -> Any:  # noqa: ANN401 - any stored value
        """Return the stored result of a run, or None."""
        return self._known.get(name)

    def add(self, name: str, reported: object) -> None:
        """Store one result."""
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps([self._digest, name, reported]) + "\n")
