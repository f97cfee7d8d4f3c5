"""Results on disk, one line for each trial, so that completed trials are not repeated."""

from __future__ import annotations

import csv
import hashlib
import importlib.util
import json
import os
import weakref
from contextlib import contextmanager
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sweepctl_plugins
from bridge.errors import BridgeError
from tools.cli.planners import PLANNERS
from tools.dev import kernels
from tools.experiment.parts import Parts
from tools.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from importlib.resources.abc import Traversable

    from tools.experiment.trials import Trial

Row = dict[str, Any]
"""Result of a trial: its parameters and metrics."""
LINES = "runs.jsonl"
"""File with the results, in the experiment's folder."""
_PLAIN = (str, int, float, bool, type(None))
"""Types of the values that a CSV file can have."""


class ExperimentFolderError(BridgeError):
    """The folder cannot be written, or contains results of another version."""

    exit_status = 1


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turn a failed write, for example to a full disk, into an error that names the folder."""
    try:
        yield
    except OSError as error:
        raise ExperimentFolderError(f"cannot write {folder}: {error.strerror or error}") from None


def code_version(planners: Iterable[str] = ()) -> str:
    """Return release and hash of the code, so that results of different code are not mixed.

    Args:
        planners: names of planners; the hash includes the modules of plug-ins and files.

    """
    digest = hashlib.sha256()
    for name, source in sorted(_outside(set(planners)).items()):
        digest.update(f"{name}\0".encode())
        digest.update(source)
    for package in ("protocol", "bridge", "sim_device", "tools"):
        root = resources.files(package)
        for name, data in sorted(_sources(root)):
            digest.update(f"{package}/{name}\0".encode())
            digest.update(data)
    return f"{VERSION}-{digest.hexdigest()[:8]}"


def planner_version(planner: str) -> str:
    """Return a hash of the module of a planner that is not from sweepctl; empty for the others."""
    return "".join(
        f"-{hashlib.sha256(source).hexdigest()[:8]}" for source in _outside({planner}).values()
    )


def _outside(planners: set[str]) -> dict[str, bytes]:
    """Return the source of the module of each planner that is a plug-in or ``module:callable``."""
    plugins = sweepctl_plugins.found("planners")
    found: dict[str, bytes] = {}
    for name in planners - set(PLANNERS):
        path = plugins[name].entry.value if name in plugins else name
        spec = importlib.util.find_spec(path.partition(":")[0]) if ":" in path else None
        if spec is not None and spec.origin is not None and spec.has_location:
            found[name] = Path(spec.origin).read_bytes()
    return found


def _sources(folder: Traversable, prefix: str = "") -> Iterator[tuple[str, bytes]]:
    for entry in folder.iterdir():
        if entry.is_dir() and entry.name != "__pycache__":
            yield from _sources(entry, f"{prefix}{entry.name}/")
        elif entry.name.endswith((".py", ".json")):
            yield prefix + entry.name, entry.read_bytes()


def check_compiled() -> None:
    """Check that the compiled modules of a source tree are those of its sources.

    The version is a hash of the sources, so a stale module would give results of another version.

    Raises:
        ExperimentFolderError: a module is not compiled, or from another source.

    """
    if not (kernels.ROOT / "pyproject.toml").exists():
        return  # an installed package has no sources of its own
    if (stale := kernels.complaint(kernels.sources())) is not None:
        raise ExperimentFolderError(stale)


def _locked(folder: Path) -> int:
    """Return the descriptor of a file whose lock keeps others out of the folder until its end."""
    lock = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        import fcntl  # not on every platform
    except ImportError:
        return lock
    try:
        fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        os.close(lock)
        raise ExperimentFolderError(
            f"another experiment uses {folder}: wait for its end, or choose another folder with "
            "--out"
        ) from None
    return lock


class Store:
    """The folder of one experiment."""

    def __init__(self, folder: Path, version: str, *, force: bool = False) -> None:
        """Open or create the folder; with ``force`` discard its results.

        Raises:
            ExperimentFolderError: it cannot be written, another process uses it, or it contains
                results of another version.

        """
        self.folder = folder
        self._version = version
        self._rows: dict[str, Row] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            weakref.finalize(self, os.close, _locked(folder))
            if force:
                (folder / LINES).unlink(missing_ok=True)
            self._read()
            self._parts = Parts(folder, self._rows)
        except OSError as error:
            raise ExperimentFolderError(f"cannot use {folder}: {error.strerror}") from None

    def _read(self) -> None:
        path = self.folder / LINES
        if not path.exists():
            return
        text = path.read_text("utf-8")
        if text and not text.endswith("\n"):  # the writer was killed: begin a new line
            with path.open("a", encoding="utf-8") as file:
                file.write("\n")
        for number, line in enumerate(text.splitlines(), 1):
            try:
                row = json.loads(line)
                key, version = row["key"], row["version"]
            except (ValueError, KeyError, TypeError):
                continue  # an incomplete line of a killed writer: the trial is run again
            if version != self._version:
                raise ExperimentFolderError(
                    f"{path}:{number} is from version {version}, but this is {self._version}: "
                    "choose another folder, or discard the results with --force"
                )
            self._rows[key] = row

    def missing(self, trials: Iterable[Trial]) -> list[Trial]:
        """Return the trials without a result, in their order."""
        return [trial for trial in trials if trial.key not in self._rows]

    def add(self, trial: Trial, row: Row) -> None:
        """Write one result to the file at once.

        Raises:
            ExperimentFolderError: it cannot be written.

        """
        row = {"key": trial.key, "version": self._version, **asdict(trial), **row}
        # through JSON, so that a new result equals one that was read from the file
        row = json.loads(json.dumps(row))
        self._rows[trial.key] = row
        with writing(self.folder):
            with (self.folder / LINES).open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            self._parts.add(row)

    def seal(self) -> None:
        """Complete the Parquet dataset with the results so far."""
        with writing(self.folder):
            self._parts.seal()

    def rows(self, trials: Iterable[Trial]) -> list[Row]:
        """Return the results in the order of the trials."""
        return [self._rows[trial.key] for trial in trials if trial.key in self._rows]


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write the plain values of the rows; lists are only in the JSON lines."""
    names = dict.fromkeys(
        name
        for row in rows
        for name, value in row.items()
        if isinstance(value, _PLAIN) and name not in {"key", "version"}
    )
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(names), extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
