"""Run the jobs of a campaign in processes; an interrupted campaign can continue.

A file stores each result at once.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from typing import TYPE_CHECKING, Any

from support.root import ROOT
from tools.experiment.store import code_version

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path


class Kept:
    """Result of each named run; it is valid as long as all code is unchanged."""

    def __init__(self, path: Path | None) -> None:
        """Read the file; without a path nothing is stored."""
        self._path = path
        self._digest = _digest()
        self._known: dict[str, Any] = {}
        if path is None or not path.exists():
            return
        text = path.read_text(encoding="utf-8")
        if text and not text.endswith("\n"):  # the writer was killed: begin a new line
            path.write_text(f"{text}\n", encoding="utf-8")
        for line in text.splitlines():
            try:
                digest, name, reported = json.loads(line)
            except ValueError:
                continue  # an incomplete line of a killed writer
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


def stored_results(
    work: Callable[[Any], Any], jobs: Mapping[str, Any], kept: Kept, processes: int
) -> Iterator[Any]:
    """Yield every job's result in order; jobs with a stored result are not run again.

    Args:
        work: runs one job in a process and returns a value that JSON can represent.
        jobs: each job and the name under which its result is stored.
        kept: the stored results.
        processes: number of processes.

    """
    waiting = [job for name, job in jobs.items() if kept.of(name) is None]
    with ProcessPoolExecutor(processes, initializer=os.nice, initargs=(10,)) as pool:
        new = pool.map(work, waiting)
        for number, name in enumerate(jobs, 1):
            result = kept.of(name)
            if result is None:
                result = next(new)
                kept.add(name, result)
                print(f"{number} of {len(jobs)}: {name}: {result}", file=sys.stderr, flush=True)
            yield result


def _digest() -> str:
    """Return a hash of the packages, the firmware, the campaigns and their helpers."""
    digest = hashlib.sha256(code_version().encode())
    sources = [
        path
        for folder in ("sim_device/firmware", "tests/campaign", "tests/support")
        for path in (ROOT / folder).rglob("*")
        if path.suffix in {".py", ".c", ".h"}
    ]
    for path in sorted(sources):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
