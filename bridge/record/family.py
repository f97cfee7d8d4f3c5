"""Files of a run that was recorded into several files."""

from __future__ import annotations

import glob
from typing import TYPE_CHECKING

from bridge.record.errors import LogReadError
from bridge.record.mcap_records import Metadata, Opcode, parse
from bridge.record.names import METADATA
from bridge.record.scan import DamagedBytes, opened, records

if TYPE_CHECKING:
    from pathlib import Path

_SAME = ("opened_unix_ns", "port")
"""Metadata that is equal in all files of a run."""


def part_name(first: Path, number: int) -> Path:
    """Return the name of a run's n-th file."""
    return first if number == 1 else first.with_name(f"{first.stem}-{number:04d}{first.suffix}")


def parts_of(path: Path) -> list[Path]:
    """Return the files of the run that starts with ``path``, in order.

    If ``path`` is not the first file of a run, the list has only this file. A file whose name
    matches but which belongs to another run ends the list.

    Raises:
        LogReadError: the file is missing, cannot be read, or is not an MCAP file.

    """
    found, first = [path], _run(path)
    while (following := _part_after(path, first, len(found))) is not None:
        found.append(following)
    return found


def part_after(first: Path, number: int) -> Path | None:
    """Return the file that continues a run after its n-th file, or None if no such file exists.

    Raises:
        LogReadError: the first file is missing, cannot be read, or is not an MCAP file.

    """
    return _part_after(first, _run(first), number)


def stray_part(first: Path) -> Path | None:
    """Return an existing file that has the name of a later part of this run; None: no such file."""
    pattern = f"{glob.escape(first.stem)}-[0-9][0-9][0-9][0-9]{glob.escape(first.suffix)}"
    return min(first.parent.glob(pattern), default=None)


def _part_after(first: Path, run: dict[str, str], number: int) -> Path | None:
    if run.get("part") != "1":
        return None
    following = part_name(first, number + 1)
    expected = {name: run.get(name) for name in _SAME}
    expected["previous"] = part_name(first, number).name
    try:
        other = _run(following)
    except LogReadError:  # missing, or without content
        return None
    return following if all(other.get(name) == it for name, it in expected.items()) else None


def _run(path: Path) -> dict[str, str]:
    """Return the run's metadata, which are stored before all messages."""
    with opened(path) as data:
        for found in records(data):
            if isinstance(found, DamagedBytes) or found.opcode in {Opcode.CHUNK, Opcode.DATA_END}:
                break
            if found.opcode == Opcode.METADATA:
                metadata = parse(Metadata, data[found.start : found.end])
                if metadata.name == METADATA:
                    run: dict[str, str] = metadata.metadata
                    return run
    return {}
