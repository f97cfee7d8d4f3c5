"""Reader of one log as a row of the library, from its metadata and attachments."""

from __future__ import annotations

import re
import tomllib
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

from bridge.library.columns import INDEXED
from bridge.record.errors import LogReadError
from bridge.record.family import parts_of
from bridge.record.log_head import LogHead, read_head
from bridge.record.names import (
    DEVICE_METADATA,
    EMULATED_PORT,
    ROBOT_ATTACHMENT,
    ROOM_ATTACHMENT,
    VIRTUAL_PORT,
)

if TYPE_CHECKING:
    from pathlib import Path

_KINDS = {VIRTUAL_PORT: "simulated", EMULATED_PORT: "truth"}
"""Map of a virtual port's name to the kind of its log. Logs of real ports are not listed."""
_STAMP = re.compile(r"(\d{8}T\d{6})Z-")
"""Pattern of the start of a log's default name."""
_LARGEST = 1 << 63
"""Limit of SQLite's integers. All SQLite integers are smaller."""
_NS = 1_000_000_000


class Entry(NamedTuple):
    """Index entry of one file."""

    values: dict[str, Any] | None
    """Values by column; None: the file is not the first file of a run."""
    first: str | None = None
    """Name of the run's first file, if this is a later file of a run."""
    problem: str | None = None
    """Reason why the file cannot be read."""


def read_entry(path: Path, modified_ns: int) -> Entry:
    """Read one log. A file that cannot be read gives an entry with a problem."""
    try:
        head = read_head(path)
        run = head.run
        if not run:
            text = "no run of sweepctl" if head.whole else "no run of sweepctl, or its beginning"
            return Entry(None, problem=None if head.whole else f"{text} is lost")
        if "previous" in run:
            return Entry(None, first=_first_name(path, run))
        parts = parts_of(path) if run.get("part") == "1" else [path]
        for part in parts[1:]:
            _join(head, read_head(part))
    except LogReadError as error:
        return Entry(None, problem=error.reason)
    return Entry(_values(path, head, modified_ns))


def _first_name(path: Path, run: dict[str, str]) -> str:
    """Return the name of the run's first file, from a later file of the same run."""
    number = f"-{int(run['part']):04d}" if run.get("part", "").isdecimal() else ""
    return path.stem.removesuffix(number) + path.suffix


def _join(head: LogHead, following: LogHead) -> None:
    """Add a later file of the same run. The last file has the run's summary."""
    head.file_bytes += following.file_bytes
    head.whole = following.whole
    head.attachments |= following.attachments
    head.metadata[DEVICE_METADATA] = {
        **head.metadata.get(DEVICE_METADATA, {}),
        **following.metadata.get(DEVICE_METADATA, {}),
    }
    head.problems += following.problems


def _values(path: Path, head: LogHead, modified_ns: int) -> dict[str, Any]:
    run, device = head.run, head.metadata.get(DEVICE_METADATA, {})
    summary = head.summary or {}
    kind = _KINDS.get(run.get("port", ""), "bringup" if "command" in run else "live")
    found: dict[str, Any] = {
        "date": _date(path, run, kind, modified_ns),
        "kind": kind,
        "robot": _robot_name(head.attachments.get(ROBOT_ATTACHMENT, b"")),
        "room": run.get("room") or _room_name(head),
        "planner": run.get("planner") or run.get("command"),
        "seed": int(run["seed"]) if run.get("seed", "").isdecimal() else None,
        **{name: run.get(name) for name in ("noise", "faults", "version", "port")},
        **{name: device.get(name) for name in ("firmware", "uid")},
        "bytes": head.file_bytes,
        "whole": int(head.whole),
        "problem": "; ".join(head.problems[:3]) or None,
    }
    values = {}
    for name, kind_, _, keys in INDEXED:
        value: Any = summary if keys else None
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else None
        values[name] = _stored(kind_, found.get(name) if value is None else value)
    return values


def _stored(kind: str, value: object) -> str | float | None:
    """Convert a value to the SQLite type of its column; None: the value does not fit."""
    if kind == "TEXT":
        return value.encode("utf-8", "replace").decode() if isinstance(value, str) else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if isinstance(value, int) and kind == "INTEGER":
        return value if -_LARGEST <= value < _LARGEST else None
    return float(value)


def _date(path: Path, run: dict[str, str], kind: str, modified_ns: int) -> str | None:
    """Return the date and time at which the run began.

    A simulated run has a virtual clock. For its log, the result is the time in a default file name.
    For another file name, it is the modification time of the file.
    """
    opened = run.get("opened_unix_ns", "")
    stamp = _STAMP.match(path.name)
    if kind != "simulated" and opened.isdecimal():
        return _text(int(opened))
    if stamp is not None:
        try:
            begun = datetime.strptime(stamp[1], "%Y%m%dT%H%M%S").replace(tzinfo=UTC)
        except ValueError:  # month 13
            return _text(modified_ns)
        return f"{begun:%Y-%m-%dT%H:%M:%SZ}"
    return _text(modified_ns)


def _text(unix_ns: int) -> str | None:
    try:
        return f"{datetime.fromtimestamp(unix_ns // _NS, UTC):%Y-%m-%dT%H:%M:%SZ}"
    except (ValueError, OverflowError, OSError):  # beyond the year 9999
        return None


@lru_cache(maxsize=64)
def _robot_name(data: bytes) -> str | None:
    """Return the name in a robot file. It is cached, because most logs have one of a few robots."""
    try:
        name = tomllib.loads(data.decode()).get("name")
    except (ValueError, RecursionError):
        return None
    return name if isinstance(name, str) else None


def _room_name(head: LogHead) -> str | None:
    import json  # noqa: PLC0415 - only for a run without an end

    try:
        room = json.loads(head.attachments.get(ROOM_ATTACHMENT, b""))
    except (ValueError, RecursionError):
        return None
    name = room.get("name") if isinstance(room, dict) else None
    return name if isinstance(name, str) else None
