"""Columns of the library of runs: names, SQL types and meanings, in one table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping


class RunColumn(NamedTuple):
    """One column of the table ``runs``."""

    name: str
    kind: str
    """SQL type: TEXT, REAL or INTEGER."""
    meaning: str
    keys: tuple[str, ...] = ()
    """Path of the value in the summary. If empty, the value is from the log's metadata or its
    file."""


COLUMNS = (
    RunColumn("log", "TEXT", "path of the log"),
    RunColumn("folder", "TEXT", "folder of the log"),
    RunColumn("date", "TEXT", "start of the run in UTC, as 2026-11-25T03:42:01Z"),
    RunColumn("kind", "TEXT", "`live`, `simulated`, `truth` (of an emulator) or `bringup`"),
    RunColumn("robot", "TEXT", "name in the robot file"),
    RunColumn("room", "TEXT", "name of the room", ("room",)),
    RunColumn("planner", "TEXT", "planner; `manual` for a drive by hand", ("planner",)),
    RunColumn("seed", "INTEGER", "seed of a simulated run", ("seed",)),
    RunColumn("noise", "TEXT", "noise level of a simulated run"),
    RunColumn(
        "outcome",
        "TEXT",
        "`complete`, `timeout`, `stopped` or `fault`; null: the log has no end",
        ("outcome",),
    ),
    RunColumn("reason", "TEXT", "why the run ended", ("reason",)),
    RunColumn(
        "coverage",
        "REAL",
        "coverage: share of the sweepable floor that the mouth swept, 0 to 1",
        ("coverage", "mouth_sweepable"),
    ),
    RunColumn(
        "mouth_passing",
        "REAL",
        "swept share of the floor that the mouth reaches while the robot drives, 0 to 1",
        ("coverage", "mouth_passing"),
    ),
    RunColumn(
        "mouth_free",
        "REAL",
        "floor swept by the mouth over the free floor, 0 to 1",
        ("coverage", "mouth_free"),
    ),
    RunColumn(
        "body_reachable",
        "REAL",
        "floor covered by the body over the reachable floor, 0 to 1",
        ("coverage", "body_reachable"),
    ),
    RunColumn(
        "body_free",
        "REAL",
        "floor covered by the body over the free floor, 0 to 1",
        ("coverage", "body_free"),
    ),
    RunColumn("eq8", "REAL", "lane lengths times mouth width over free floor", ("coverage", "eq8")),
    RunColumn("duration_s", "REAL", "duration of the drive, s", ("duration_s",)),
    RunColumn("path_m", "REAL", "length of the path, m", ("path_m",)),
    RunColumn("turns", "INTEGER", "number of turns", ("turns",)),
    RunColumn("t90_s", "REAL", "time until 90 % was swept, s", ("t90_s",)),
    RunColumn("t99_s", "REAL", "time until 99 % was swept, s", ("t99_s",)),
    RunColumn("largest_hole_cm2", "REAL", "largest missed piece, cm²", ("largest_hole_cm2",)),
    RunColumn(
        "hole_inradius_m", "REAL", "largest disc in a missed piece, radius, m", ("hole_inradius_m",)
    ),
    RunColumn("repeat_ratio", "REAL", "floor swept again over floor swept", ("repeat_ratio",)),
    RunColumn("collisions", "INTEGER", "number of collisions", ("collisions",)),
    RunColumn("contact_s", "REAL", "time in contact, s", ("contact_s",)),
    RunColumn("energy_wh", "REAL", "energy, Wh", ("energy_wh",)),
    RunColumn("pose_error_m", "REAL", "pose error at the end, m", ("pose_error_m", "end")),
    RunColumn("max_pose_error_m", "REAL", "largest pose error, m", ("pose_error_m", "max")),
    RunColumn("faults", "TEXT", "faults that were requested with `--fault`"),
    RunColumn(
        "device_faults", "INTEGER", "faults that the device reported", ("events", "device_faults")
    ),
    RunColumn("supervision", "INTEGER", "events of the supervision", ("events", "supervise")),
    RunColumn("lost", "INTEGER", "frames lost on the link", ("wire", "lost")),
    RunColumn("crc_errors", "INTEGER", "damaged frames", ("wire", "crc_errors")),
    RunColumn("version", "TEXT", "version of sweepctl that wrote the log"),
    RunColumn("port", "TEXT", "port of the robot"),
    RunColumn("firmware", "TEXT", "name and version of the firmware"),
    RunColumn("uid", "TEXT", "unique number of the device, hexadecimal"),
    RunColumn("bytes", "INTEGER", "size of the log, all its files together, bytes"),
    RunColumn(
        "whole", "INTEGER", "1: complete; 0: the end is missing, or it is still being written"
    ),
    RunColumn("problem", "TEXT", "damage that was found"),
    RunColumn("tags", "TEXT", "tags, with a space before and after each"),
    RunColumn("note", "TEXT", "note"),
)

NAMES = tuple(column.name for column in COLUMNS)
PLACED = ("log", "folder")
"""Columns that depend on the folder's path, so the index does not store them."""
MARKED = ("tags", "note")
"""Columns that people write."""
INDEXED = tuple(c for c in COLUMNS if c.name not in {*PLACED, *MARKED})
"""Columns that are read from a log."""


def number_cell(row: Mapping[str, Any], column: str, form: str, factor: float = 1.0) -> str:
    """Return a number of a run as text for a table; ``-`` if the run has no value."""
    value = row[column]
    return "-" if value is None else form.format(value * factor)
